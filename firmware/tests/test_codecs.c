/* Vectors for the pure units: pulses, blocks, records, states and messages of the chain. */
#include "ack.h"
#include "blk.h"
#include "check.h"
#include "chn.h"
#include "pul.h"
#include "sta.h"
#include "sums.h"
#include "vectors.h"

/* Runs of phase, width, how many; returns how many pulses there were. */
static uint32_t pack_runs(const uint16_t *runs, uint32_t run_count, uint8_t *packed)
{
    uint32_t at = 0;
    for (uint32_t i = 0; i < run_count; i++) {
        const struct pw_pulse pulse = { (uint8_t)runs[3u * i], (uint8_t)runs[(3u * i) + 1u] };
        for (uint32_t n = 0; n < runs[(3u * i) + 2u]; n++) {
            pw_pulse_put(packed, at, pulse);
            at++;
        }
    }
    return at;
}

static void test_pulse_pairs(void)
{
    for (size_t i = 0; i < VEC_COUNT(vec_pulse_pairs); i++) {
        const struct vec_pulse_pair *v = &vec_pulse_pairs[i];
        uint8_t packed[3] = { 0xFF, 0xFF, 0xFF };
        check_case = v->name;
        for (uint32_t k = 0; k < 2u; k++) {
            const struct pw_pulse wanted = { v->pulses[k][0], v->pulses[k][1] };
            const struct pw_pulse got = pw_pulse_get(v->bytes, k);
            pw_pulse_put(packed, k, wanted);
            CHECK_EQ(got.phase, wanted.phase);
            CHECK_EQ(got.width, wanted.width);
            CHECK_EQ(pw_pulse_begin(got), v->begins[k]);
        }
        CHECK_BYTES(packed, v->bytes, 3);
        CHECK(pw_pulses_valid(v->bytes, 2));
    }
}

static void test_widths_and_powers(void)
{
    check_case = "modulated_widths";
    for (uint32_t sample = 0; sample < 256u; sample++) {
        for (uint32_t width = 0; width < 26u; width++) {
            CHECK_EQ(pw_modulated_width((uint8_t)width, (uint8_t)sample), vec_modulated_widths[sample][width]);
        }
    }
    check_case = "powers";
    for (uint32_t width = 0; width < 26u; width++) {
        const struct pw_pulse pulse = { (uint8_t)check_below(100), (uint8_t)width };
        uint8_t packed[3] = { 0 };
        pw_pulse_put(packed, width & 1u, pulse);
        CHECK_EQ(pw_pulses_power(packed, 2), vec_powers[width]);
    }
    for (size_t i = 0; i < VEC_COUNT(vec_drives); i++) {
        uint8_t packed[PW_PAYLOAD] = { 0 };
        check_case = vec_drives[i].name;
        CHECK_EQ(pack_runs(vec_drives[i].runs, vec_drives[i].run_count, packed), PW_CHANNELS);
        CHECK_EQ(pw_pulses_power(packed, PW_CHANNELS), vec_drives[i].power);
    }
}

static void test_blocks(void)
{
    for (size_t i = 0; i < VEC_COUNT(vec_blocks); i++) {
        const struct vec_block *v = &vec_blocks[i];
        struct pw_block block = { 0 };
        uint8_t payload[PW_PAYLOAD] = { 0 };
        check_case = v->name;
        CHECK_EQ(pw_block_check(v->bytes, PW_BLOCK, &block), PW_ACCEPTED);
        if (block.payload == NULL) {
            continue;
        }
        CHECK_EQ(block.kind, v->kind);
        CHECK_EQ(block.flags, v->flags);
        CHECK_EQ(block.action, v->action);
        CHECK_EQ(block.sequence, v->sequence);
        CHECK_EQ(block.period, v->period);
        CHECK_EQ(block.first, v->first);
        CHECK_EQ(block.count, v->count);
        CHECK_EQ(block.hold, v->hold);
        CHECK_EQ(block.repeats, v->repeats);
        CHECK_EQ(pw_block_number(v->bytes, PW_BLOCK), v->sequence);
        (void)pack_runs(v->runs, v->run_count, payload);
        for (uint32_t n = 0; n < v->entry_count; n++) {
            const struct pw_entry entry = pw_entry_get(block.payload, n);
            CHECK_EQ(entry.slot, v->entries[2u * n]);
            CHECK_EQ(entry.periods, v->entries[(2u * n) + 1u]);
            pw_put16(&payload[4u * n], v->entries[2u * n]);
            pw_put16(&payload[(4u * n) + 2u], v->entries[(2u * n) + 1u]);
        }
        for (uint32_t n = 0; n < v->sample_count; n++) {
            payload[n] = v->samples[n];
        }
        CHECK_BYTES(block.payload, payload, PW_PAYLOAD);
    }
    for (size_t i = 0; i < VEC_COUNT(vec_refused_blocks); i++) {
        const struct vec_refused *v = &vec_refused_blocks[i];
        struct pw_block block = { 0 };
        check_case = v->name;
        CHECK_EQ(pw_block_check(v->bytes, v->size, &block), v->reason);
        CHECK_EQ(v->reason, v->code);
        CHECK(block.payload == NULL);
    }
    check_case = "number of a block that is cut off"; /* ACK-002 */
    for (uint32_t size = 0; size < 10u; size++) {
        const uint8_t bytes[10] = { 0x50, 0x57, 1, 1, 0x44, 0x33, 0x22, 0x11, 0x99, 0x99 };
        static const uint32_t numbers[10] = { 0, 0, 0, 0, 0, 0x44, 0x3344, 0x223344, 0x11223344, 0x11223344 };
        CHECK_EQ(pw_block_number(bytes, size), numbers[size]);
    }
    CHECK_EQ(pw_block_number(NULL, 0), 0);
}

/* BLK-004 and VER-005, said once more. */
static void test_kinds(void)
{
    static const struct {
        uint8_t kind, flags, action;
        uint16_t features;
        bool change, store;
    } wanted[] = {
        { PW_UPDATE, 0, 0, 0, true, false },
        { PW_SLOT, 0, 0, PW_HAS_SEQUENCES, false, true },
        { PW_STORE_ENTRIES, 0, 0, PW_HAS_SEQUENCES, false, true },
        { PW_SEQUENCE, PW_RESTART, 0, PW_HAS_SEQUENCES, true, false },
        { PW_SEQUENCE, PW_UNATTENDED, 0, PW_HAS_SEQUENCES | PW_HAS_UNATTENDED, true, false },
        { PW_STORE_SAMPLES, 0, 0, PW_HAS_MODULATION, false, true },
        { PW_MODULATION, 0, 0, PW_HAS_MODULATION, true, false },
        { PW_OUTPUT, 0, PW_END_MODULATION, PW_HAS_MODULATION, true, false },
        { PW_OUTPUT, 0, PW_SILENCE, 0, true, false },
        { PW_OUTPUT, 0, PW_DISABLE, 0, true, false },
        { PW_CLOCK, 0, 0, 0, false, false },
        { PW_NO_OP, PW_RESTART, 0, 0, false, false },
    };
    check_case = "kinds";
    for (size_t i = 0; i < VEC_COUNT(wanted); i++) {
        struct pw_block block = { 0 };
        block.kind = wanted[i].kind;
        block.flags = wanted[i].flags;
        block.action = wanted[i].action;
        CHECK_EQ(pw_block_features(&block), wanted[i].features);
        CHECK_EQ(pw_kind_is_change(block.kind), wanted[i].change);
        CHECK_EQ(pw_kind_is_store(block.kind), wanted[i].store);
    }
}

static void test_records(void)
{
    for (size_t i = 0; i < VEC_COUNT(vec_acks); i++) {
        uint8_t bytes[PW_ACK];
        check_case = vec_acks[i].name;
        (void)memset(bytes, 0xA5, sizeof bytes);
        pw_ack_put(bytes, &vec_acks[i].fields);
        CHECK_BYTES(bytes, vec_acks[i].bytes, PW_ACK);
    }
    for (size_t i = 0; i < VEC_COUNT(vec_statuses); i++) {
        uint8_t bytes[PW_STATUS];
        check_case = vec_statuses[i].name;
        (void)memset(bytes, 0xA5, sizeof bytes);
        pw_status_put(bytes, &vec_statuses[i].fields);
        CHECK_BYTES(bytes, vec_statuses[i].bytes, PW_STATUS);
    }
}

static void test_transitions(void)
{
    check_case = "device_transitions";
    for (size_t i = 0; i < VEC_COUNT(vec_device_transitions); i++) {
        const struct vec_transition *v = &vec_device_transitions[i];
        const enum pw_state state = (enum pw_state)v->state;
        const enum pw_event event = (enum pw_event)v->event;
        CHECK_EQ(pw_state_after(state, event), v->next);
        CHECK_EQ(pw_state_allows(state, event), (v->next != v->state) || (event == PW_EVENT_RESTART));
        CHECK_EQ(pw_state_enabled(state), (v->state >= 1u) && (v->state <= 3u));
    }
}

/* Reads a body into a vector's struct as its receiver does; false if the message is damaged. */
static bool body_get(struct vec_chain *to, uint8_t pulses[PW_SLICE], const uint8_t *body, size_t size)
{
    struct pw_load load = { 0 };
    struct pw_program program = { 0 };
    struct pw_report report = { 0 };
    struct pw_playing playing = { 0 };
    struct pw_identity identity = { 0 };
    bool good = false;
    switch (to->end) {
    case PW_END_SLICE:
        good = (to->node < PW_PROCESSORS) && (size == PW_SLICE);
        (void)memcpy(pulses, body, good ? PW_SLICE : 0);
        break;
    case PW_END_COMMIT:
        good = (to->node < PW_PROCESSORS) && pw_commit_get(&to->period, &to->checksum, body, size);
        break;
    case PW_END_LOAD:
        good = pw_load_get(&load, to->node, body, size);
        if (good) {
            to->memory = load.memory;
            to->first = load.first;
            to->count = load.count;
            (void)memcpy(pulses, load.data, PW_SLICE);
        }
        break;
    case PW_END_PROGRAM:
        good = pw_program_get(&program, to->node, body, size);
        if (good) {
            to->memory = program.memory;
            to->first = program.first;
            to->count = program.count;
            to->hold = program.hold;
            to->repeats = program.repeats;
            to->period = program.period;
        }
        break;
    case PW_END_COLLECT:
        good = pw_collect_get(&to->answer, to->node, body, size);
        break;
    case PW_END_NUMBER:
        good = pw_number_get(&to->number, body, size) && (to->node == PW_UNNUMBERED_NODE);
        break;
    case PW_END_REPORT:
        good = pw_report_get(&report, body, size) && (to->node == PW_CONTROLLER_NODE);
        if (good) {
            to->processor = report.processor;
            to->temperature_c = report.temperature_c;
            to->faults = report.faults;
            (void)memcpy(to->firmware, report.firmware, 3);
            to->drift = report.drift;
            to->carried_out = report.carried_out;
            to->missed_commits = report.missed_commits;
            to->damaged_messages = report.damaged_messages;
        }
        break;
    case PW_END_PLAYING:
        good = pw_playing_get(&playing, body, size) && (to->node == PW_CONTROLLER_NODE);
        if (good) {
            to->processor = playing.processor;
            to->period = playing.period;
            (void)memcpy(pulses, playing.pulses, PW_SLICE);
        }
        break;
    case PW_END_IDENTITY:
        good = pw_identity_get(&identity, body, size) && (to->node == PW_CONTROLLER_NODE);
        if (good) {
            to->processor = identity.processor;
            to->last = identity.last;
            (void)memcpy(to->firmware, identity.firmware, 3);
            to->unique_id = pw_get64(identity.unique_id);
        }
        break;
    default:
        break;
    }
    return good;
}

/* The message of a vector's fields. */
static size_t message_put(uint8_t *message, const struct vec_chain *v, const uint8_t pulses[PW_SLICE])
{
    const struct pw_program program = { v->memory, v->first, v->count, v->hold, v->repeats, v->period };
    const struct pw_report report = { v->processor, v->temperature_c, v->faults,
                                      { v->firmware[0], v->firmware[1], v->firmware[2] }, v->drift,
                                      v->carried_out, v->missed_commits, v->damaged_messages };
    struct pw_identity identity = { v->processor, v->last, { v->firmware[0], v->firmware[1], v->firmware[2] }, { 0 } };
    struct pw_load load = { v->memory, v->first, (uint8_t)v->count, { 0 } };
    struct pw_playing playing = { v->processor, v->period, { 0 } };
    size_t size = 0;
    pw_put64(identity.unique_id, v->unique_id);
    (void)memcpy(load.data, pulses, PW_SLICE);
    (void)memcpy(playing.pulses, pulses, PW_SLICE);
    switch (v->end) {
    case PW_END_SLICE:
        size = pw_slice_put(message, v->node, pulses);
        break;
    case PW_END_COMMIT:
        size = pw_commit_put(message, v->node, v->period, v->checksum);
        break;
    case PW_END_LOAD:
        size = pw_load_put(message, v->node, &load);
        break;
    case PW_END_PROGRAM:
        size = pw_program_put(message, v->node, &program);
        break;
    case PW_END_COLLECT:
        size = pw_collect_put(message, v->node, v->answer);
        break;
    case PW_END_NUMBER:
        size = pw_number_put(message, v->number);
        break;
    case PW_END_REPORT:
        size = pw_report_put(message, &report);
        break;
    case PW_END_PLAYING:
        size = pw_playing_put(message, &playing);
        break;
    case PW_END_IDENTITY:
        size = pw_identity_put(message, &identity);
        break;
    default:
        break;
    }
    return size;
}

/* A whole message, as the switches and the receiver together take it. */
static bool message_get(struct vec_chain *to, uint8_t pulses[PW_SLICE], const uint8_t *message, size_t size)
{
    (void)memset(to, 0, sizeof *to);
    (void)memset(pulses, 0, PW_SLICE);
    if (size < 3u) {
        return false;
    }
    to->node = (uint16_t)(((unsigned)message[0] << 8) | message[1]);
    to->end = message[2];
    return body_get(to, pulses, &message[3], size - 3u);
}

static void test_chain(void)
{
    for (size_t i = 0; i < VEC_COUNT(vec_chain_messages); i++) {
        const struct vec_chain *v = &vec_chain_messages[i];
        struct vec_chain got;
        uint8_t wanted_pulses[PW_SLICE] = { 0 };
        uint8_t pulses[PW_SLICE];
        uint8_t message[PW_MESSAGE];
        check_case = v->name;
        if (v->data_size > 0u) {
            (void)memcpy(wanted_pulses, v->data, v->data_size);
        } else {
            (void)pack_runs(v->runs, v->run_count, wanted_pulses);
        }
        CHECK_EQ(message_put(message, v, wanted_pulses), v->size);
        CHECK_BYTES(message, v->bytes, v->size);
        CHECK(message_get(&got, pulses, v->bytes, v->size));
        CHECK_BYTES(pulses, wanted_pulses, PW_SLICE);
        (void)memset(message, 0, sizeof message);
        CHECK_EQ(message_put(message, &got, pulses), v->size); /* so every field came out as it went in */
        CHECK_BYTES(message, v->bytes, v->size);
        /* One bit off anywhere in what a checksum covers, or one byte more or less, and the receiver drops it. */
        (void)memcpy(message, v->bytes, v->size);
        for (size_t bit = 0; (v->end > (uint8_t)PW_END_COMMIT) && (bit < (8u * (size_t)v->size)); bit++) {
            message[bit / 8u] ^= (uint8_t)(1u << (bit % 8u));
            CHECK(!message_get(&got, pulses, message, v->size));
            message[bit / 8u] ^= (uint8_t)(1u << (bit % 8u));
        }
        CHECK(!message_get(&got, pulses, message, v->size - 1u));
        CHECK((v->size == sizeof message) || !message_get(&got, pulses, message, v->size + 1u));
    }
    for (size_t i = 0; i < VEC_COUNT(vec_refused_chain_messages); i++) {
        struct vec_chain got;
        uint8_t pulses[PW_SLICE];
        check_case = vec_refused_chain_messages[i].name;
        CHECK(!message_get(&got, pulses, vec_refused_chain_messages[i].bytes, vec_refused_chain_messages[i].size));
    }
    for (size_t i = 0; i < VEC_COUNT(vec_slices_and_commits); i++) {
        const struct vec_commit *v = &vec_slices_and_commits[i];
        uint64_t period = 0;
        uint32_t checksum = 0;
        check_case = v->name;
        CHECK(pw_commit_get(&period, &checksum, &v->commit[3], 12));
        CHECK_EQ(pw_commit_checksum(&v->slice[3], period) == checksum, v->plays);
    }
}

int main(void)
{
    test_pulse_pairs();
    test_widths_and_powers();
    test_blocks();
    test_kinds();
    test_records();
    test_transitions();
    test_chain();
    return check_end();
}
