/* Chapter CHN: the layouts of its messages. Encoders count from the route header on, decoders from behind it. */
#include "chn.h"

#include <string.h>

#include "sums.h"

#define ROUTE 3u
#define CHECK 4u

static void route_put(uint8_t *message, uint16_t node, enum pw_channel_end end)
{
    message[0] = (uint8_t)(node >> 8); /* high byte first: CHN-008 */
    message[1] = (uint8_t)(node & 0xFFu);
    message[2] = (uint8_t)end;
}

/* Ends a message with the checksum of its `size` bytes (CHN-010); the size with it. */
static size_t checksum_put(uint8_t *message, size_t size)
{
    pw_put32(&message[size], pw_crc32(0, message, size));
    return size + CHECK;
}

/* Whether a body has its size, and the checksum under the receiver's own route header (CHN-010). */
static bool intact(uint16_t node, enum pw_channel_end end, const uint8_t *body, size_t size, size_t expected)
{
    bool good = false;
    if (size == expected) {
        uint8_t route[ROUTE];
        route_put(route, node, end);
        good = pw_get32(&body[size - CHECK]) == pw_crc32(pw_crc32(0, route, ROUTE), body, size - CHECK);
    }
    return good;
}

size_t pw_slice_put(uint8_t *message, uint16_t node, const uint8_t pulses[PW_SLICE])
{
    route_put(message, node, PW_END_SLICE);
    (void)memcpy(&message[ROUTE], pulses, PW_SLICE);
    return ROUTE + PW_SLICE;
}

uint32_t pw_commit_checksum(const uint8_t pulses[PW_SLICE], uint64_t period)
{
    uint8_t bytes[8];
    pw_put64(bytes, period);
    return pw_crc32(pw_crc32(0, pulses, PW_SLICE), bytes, sizeof bytes);
}

size_t pw_commit_put(uint8_t *message, uint16_t node, uint64_t period, uint32_t checksum)
{
    route_put(message, node, PW_END_COMMIT);
    pw_put64(&message[3], period);
    pw_put32(&message[11], checksum);
    return 15;
}

bool pw_commit_get(uint64_t *period, uint32_t *checksum, const uint8_t *body, size_t size)
{
    const bool good = size == 12u;
    if (good) {
        *period = pw_get64(body);
        *checksum = pw_get32(&body[8]);
    }
    return good;
}

size_t pw_load_put(uint8_t *message, uint16_t node, const struct pw_load *load)
{
    route_put(message, node, PW_END_LOAD);
    message[3] = load->memory;
    pw_put16(&message[4], load->first);
    message[6] = load->count;
    (void)memcpy(&message[7], load->data, PW_SLICE);
    return checksum_put(message, 55);
}

/* CHN-012. The first row is for a memory that does not exist: it has no place for any item. */
static const struct {
    uint16_t items;
    uint8_t item_bytes;
} memories[PW_MEMORY_SAMPLES + 1] = {
    { 0, PW_SLICE },
    [PW_MEMORY_SLOTS] = { PW_SLOTS, PW_SLICE },
    [PW_MEMORY_ENTRIES] = { PW_ENTRIES, 4 },
    [PW_MEMORY_SAMPLES] = { PW_SAMPLES, 1 }
};

static bool load_valid(const struct pw_load *load)
{
    const uint32_t memory = (load->memory <= (uint8_t)PW_MEMORY_SAMPLES) ? load->memory : 0u;
    const size_t used = (size_t)load->count * memories[memory].item_bytes;
    bool valid = (load->count >= 1u) && (used <= PW_SLICE);
    valid = valid && (((uint32_t)load->first + load->count) <= memories[memory].items);
    return valid && pw_all_zero(&load->data[used], PW_SLICE - used);
}

bool pw_load_get(struct pw_load *load, uint16_t node, const uint8_t *body, size_t size)
{
    bool good = (node < PW_PROCESSORS) && intact(node, PW_END_LOAD, body, size, 56);
    if (good) {
        load->memory = body[0];
        load->first = pw_get16(&body[1]);
        load->count = body[3];
        (void)memcpy(load->data, &body[4], PW_SLICE);
        good = load_valid(load);
    }
    return good;
}

size_t pw_program_put(uint8_t *message, uint16_t node, const struct pw_program *program)
{
    route_put(message, node, PW_END_PROGRAM);
    message[3] = program->memory;
    pw_put16(&message[4], program->first);
    pw_put16(&message[6], program->count);
    pw_put16(&message[8], program->hold);
    pw_put16(&message[10], program->repeats);
    pw_put64(&message[12], program->period);
    return checksum_put(message, 20);
}

/* CHN-014 */
static bool program_valid(const struct pw_program *program)
{
    const uint32_t end = (uint32_t)program->first + program->count;
    const bool entries = program->memory == (uint8_t)PW_MEMORY_ENTRIES;
    const bool samples = program->memory == (uint8_t)PW_MEMORY_SAMPLES;
    bool valid = entries || samples;
    if (program->count == 0u) {
        valid = valid && (program->first == 0u) && (program->hold == 0u) && (program->repeats == 0u);
    } else if (entries) {
        valid = (end <= PW_ENTRIES) && (program->hold == 0u);
    } else {
        valid = valid && (end <= PW_SAMPLES) && (program->hold != 0u) && (program->repeats == 0u);
    }
    return valid;
}

bool pw_program_get(struct pw_program *program, uint16_t node, const uint8_t *body, size_t size)
{
    bool good = (node < PW_PROCESSORS) && intact(node, PW_END_PROGRAM, body, size, 21);
    if (good) {
        program->memory = body[0];
        program->first = pw_get16(&body[1]);
        program->count = pw_get16(&body[3]);
        program->hold = pw_get16(&body[5]);
        program->repeats = pw_get16(&body[7]);
        program->period = pw_get64(&body[9]);
        good = program_valid(program);
    }
    return good;
}

size_t pw_collect_put(uint8_t *message, uint16_t node, uint8_t answer)
{
    route_put(message, node, PW_END_COLLECT);
    message[3] = answer;
    return checksum_put(message, 4);
}

bool pw_collect_get(uint8_t *answer, uint16_t node, const uint8_t *body, size_t size)
{
    bool good = (node < PW_PROCESSORS) && intact(node, PW_END_COLLECT, body, size, 5);
    if (good) {
        *answer = body[0];
        good = (*answer == (uint8_t)PW_END_REPORT) || (*answer == (uint8_t)PW_END_PLAYING);
    }
    return good;
}

size_t pw_number_put(uint8_t *message, uint8_t number)
{
    route_put(message, PW_UNNUMBERED_NODE, PW_END_NUMBER);
    message[3] = number;
    return checksum_put(message, 4);
}

bool pw_number_get(uint8_t *number, const uint8_t *body, size_t size)
{
    bool good = intact(PW_UNNUMBERED_NODE, PW_END_NUMBER, body, size, 5);
    if (good) {
        *number = body[0];
        good = *number < PW_PROCESSORS;
    }
    return good;
}

size_t pw_report_put(uint8_t *message, const struct pw_report *report)
{
    route_put(message, PW_CONTROLLER_NODE, PW_END_REPORT);
    message[3] = report->processor;
    message[4] = (uint8_t)report->temperature_c;
    pw_put16(&message[5], report->faults);
    (void)memcpy(&message[7], report->firmware, sizeof report->firmware);
    message[10] = (uint8_t)report->drift;
    pw_put32(&message[11], report->carried_out);
    pw_put32(&message[15], report->missed_commits);
    pw_put32(&message[19], report->damaged_messages);
    return checksum_put(message, 23);
}

bool pw_report_get(struct pw_report *report, const uint8_t *body, size_t size)
{
    bool good = intact(PW_CONTROLLER_NODE, PW_END_REPORT, body, size, 24);
    if (good) {
        report->processor = body[0];
        report->temperature_c = (int8_t)body[1];
        report->faults = pw_get16(&body[2]);
        (void)memcpy(report->firmware, &body[4], sizeof report->firmware);
        report->drift = (int8_t)body[7];
        report->carried_out = pw_get32(&body[8]);
        report->missed_commits = pw_get32(&body[12]);
        report->damaged_messages = pw_get32(&body[16]);
        good = report->processor < PW_PROCESSORS;
    }
    return good;
}

size_t pw_playing_put(uint8_t *message, const struct pw_playing *playing)
{
    route_put(message, PW_CONTROLLER_NODE, PW_END_PLAYING);
    message[3] = playing->processor;
    pw_put64(&message[4], playing->period);
    (void)memcpy(&message[12], playing->pulses, PW_SLICE);
    return checksum_put(message, 60);
}

bool pw_playing_get(struct pw_playing *playing, const uint8_t *body, size_t size)
{
    bool good = intact(PW_CONTROLLER_NODE, PW_END_PLAYING, body, size, 61);
    if (good) {
        playing->processor = body[0];
        playing->period = pw_get64(&body[1]);
        (void)memcpy(playing->pulses, &body[9], PW_SLICE);
        good = playing->processor < PW_PROCESSORS;
    }
    return good;
}

size_t pw_identity_put(uint8_t *message, const struct pw_identity *identity)
{
    route_put(message, PW_CONTROLLER_NODE, PW_END_IDENTITY);
    message[3] = identity->processor;
    message[4] = identity->last;
    (void)memcpy(&message[5], identity->firmware, sizeof identity->firmware);
    (void)memcpy(&message[8], identity->unique_id, sizeof identity->unique_id);
    return checksum_put(message, 16);
}

bool pw_identity_get(struct pw_identity *identity, const uint8_t *body, size_t size)
{
    bool good = intact(PW_CONTROLLER_NODE, PW_END_IDENTITY, body, size, 17);
    if (good) {
        identity->processor = body[0];
        identity->last = body[1];
        (void)memcpy(identity->firmware, &body[2], sizeof identity->firmware);
        (void)memcpy(identity->unique_id, &body[5], sizeof identity->unique_id);
        good = (identity->processor < PW_PROCESSORS) && (identity->last <= 1u);
    }
    return good;
}
