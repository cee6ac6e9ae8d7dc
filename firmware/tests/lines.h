/* For the tests of lines: the real device with ten real processors, two of its lines, and what a host does on them. */
#ifndef LINES_H
#define LINES_H

#include <string.h>

#include "check.h"
#include "con.h"
#include "processor.h"
#include "ser.h"
#include "sums.h"

/* A board of memory and a clock that the tests turn ---------------------------------------------------------------- */

#define LATE_ANSWERS 32u

static struct pw_processor processors[PW_PROCESSORS];
static struct pw_device device;
static struct pw_line line, other;
static uint16_t wiring[PW_CHANNELS];
static uint64_t clock_now;
static bool chain_slow; /* answers stay where they are */
static uint8_t late[LATE_ANSWERS][PW_MESSAGE];
static size_t late_size[LATE_ANSWERS];
static size_t late_count;

static inline uint64_t now(void *self)
{
    (void)self;
    return clock_now;
}

static inline void deliver(const uint8_t *answer, size_t size)
{
    pw_device_chain(&device, answer[2], &answer[3], size - 3u);
}

static inline bool chain(void *self, const uint8_t *message, size_t size)
{
    (void)self;
    const uint32_t node = ((uint32_t)message[0] << 8) | message[1];
    uint32_t to = 0;
    if (node == PW_UNNUMBERED_NODE) {
        while ((to < PW_PROCESSORS) && (processors[to].number != PW_NO_NUMBER)) {
            to++;
        }
    } else {
        to = node;
    }
    if (to < PW_PROCESSORS) {
        uint8_t answer[PW_MESSAGE];
        const bool last = to == (PW_PROCESSORS - 1u);
        const size_t got =
            pw_processor_message(&processors[to], message[2], &message[3], size - 3u, last, answer);
        /* Never within the call: answers take time. */
        if ((got != 0u) && (late_count < LATE_ANSWERS)) {
            memcpy(late[late_count], answer, got);
            late_size[late_count] = got;
            late_count++;
        }
    }
    return true;
}

static inline void sync_line(void *self)
{
    (void)self;
    for (size_t i = 0; i < PW_PROCESSORS; i++) {
        pw_processor_sync(&processors[i], clock_now);
    }
}

static inline void identify(void *self, uint8_t board)
{
    (void)self;
    (void)board;
}

static const struct pw_port port = {NULL, now, chain, sync_line, identify, NULL, NULL, NULL, NULL, NULL, NULL, NULL, NULL};
static const struct pw_about about = {
    {1, 2, 3, 4, 5, 6, 7, 8}, {1, 2, 3}, PW_BANK_A, 0, 1, "lines", "PW-0001", wiring, 20, 16, 10300,
};

static inline void answer_chain(void)
{
    while (late_count > 0u) {
        uint8_t answers[LATE_ANSWERS][PW_MESSAGE];
        size_t sizes[LATE_ANSWERS];
        const size_t count = late_count;
        memcpy(answers, late, sizeof answers);
        memcpy(sizes, late_size, sizeof sizes);
        late_count = 0;
        for (size_t i = 0; i < count; i++) {
            deliver(answers[i], sizes[i]);
        }
    }
}

/* Some periods pass. */
static inline void pass(uint64_t periods)
{
    for (uint64_t i = 0; i < periods; i++) {
        clock_now += PW_TICKS - (clock_now % PW_TICKS);
        for (size_t k = 0; k < PW_PROCESSORS; k++) {
            (void)pw_processor_period(&processors[k], (clock_now - device.origin) / PW_TICKS);
        }
        pw_device_poll(&device);
        if (!chain_slow) {
            answer_chain();
        }
        pw_line_poll(&line, &device);
        pw_line_poll(&other, &device);
    }
}

static inline void begin(void)
{
    clock_now = 0;
    chain_slow = false;
    late_count = 0;
    for (uint16_t i = 0; i < PW_CHANNELS; i++) {
        wiring[i] = i;
    }
    for (size_t i = 0; i < PW_PROCESSORS; i++) {
        const uint8_t firmware[3] = {1, 2, 3};
        const uint8_t id[8] = {(uint8_t)i};
        pw_processor_begin(&processors[i], firmware, id);
    }
    pw_device_begin(&device, &port, &about);
    pw_line_begin(&line, PW_DOOR_LINE(0u), false);
    pw_line_begin(&other, PW_DOOR_LINE(1u), false);
    line.may_text = true;
    other.may_text = true;
    static const uint8_t early[] = {0, 'x', 0}; /* a damaged frame, if it were kept: TIM-002 */
    CHECK_EQ(pw_line_receive(&line, &device, early, sizeof early), sizeof early);
    pw_device_poll(&device);
    while (!pw_device_serving(&device) && (clock_now < 10000u)) {
        clock_now += 10u;
        answer_chain();
        pw_device_poll(&device);
    }
    CHECK(pw_device_serving(&device));
    CHECK_EQ(device.faults, 0);
    CHECK_EQ(device.dropped_frames, 0);
    CHECK(!line.frames);
    pass(1);
}

/* What a host does ------------------------------------------------------------------------------------------------- */

static uint8_t got[2u * PW_LINE_BYTES];
static size_t got_size, got_read;

/* Behind what was fetched before. */
static inline void fetch_more(struct pw_line *from)
{
    size_t size = 1;
    got_read = 0;
    while ((size > 0u) && (got_size < (sizeof got - 64u))) {
        size = pw_line_send(from, &device, &got[got_size], 1u + check_below(64));
        got_size += size;
    }
}

static inline void fetch(struct pw_line *from)
{
    got_size = 0;
    fetch_more(from);
}

static inline void give(struct pw_line *to, const void *bytes, size_t size)
{
    CHECK_EQ(pw_line_receive(to, &device, bytes, size), size);
}

static inline void give_frame(struct pw_line *to, uint8_t kind, const uint8_t *body, size_t size)
{
    uint8_t frame[PW_FRAME_MOST];
    give(to, frame, pw_frame_encode(frame, kind, body, size));
}

static inline void request(struct pw_line *to, uint8_t tag, uint8_t type, uint8_t code, uint16_t value, uint16_t length)
{
    uint8_t body[9] = {tag, type, code};
    pw_put16(&body[3], value);
    pw_put16(&body[7], length);
    give_frame(to, PW_FRAME_REQUEST, body, sizeof body);
}

/* A block of a kind without payload. */
static inline void block(struct pw_line *to, uint8_t kind, uint32_t number, uint64_t period)
{
    uint8_t bytes[PW_BLOCK] = {0x50, 0x57, 1, kind};
    pw_put32(&bytes[4], number);
    pw_put64(&bytes[8], period);
    bytes[27] = kind == PW_OUTPUT ? PW_END_MODULATION : 0u;
    pw_put32(&bytes[28], pw_crc32(0u, bytes, sizeof bytes));
    give_frame(to, PW_FRAME_BLOCK, bytes, sizeof bytes);
}

static uint8_t frame_bytes[PW_FRAME_MOST];

/* The next frame of what was fetched; kind 0 if there is none. Empty ones are skipped. */
static inline struct pw_frame next_frame(void)
{
    struct pw_frame frame = {0};
    while ((got_read < got_size) && (got[got_read] == 0u)) {
        got_read++;
    }
    size_t size = 0;
    while ((got_read < got_size) && (got[got_read] != 0u) && (size < sizeof frame_bytes)) {
        frame_bytes[size] = got[got_read];
        size++;
        got_read++;
    }
    if (size > 0u) {
        CHECK(pw_frame_decode(&frame, frame_bytes, size));
    }
    return frame;
}

static inline void expect_reply(uint8_t tag, uint8_t outcome, size_t data)
{
    const struct pw_frame frame = next_frame();
    CHECK_EQ(frame.kind, PW_FRAME_REPLY);
    CHECK_EQ(frame.size, 2u + data);
    if (frame.kind == PW_FRAME_REPLY) {
        CHECK_EQ(frame.body[0], tag);
        CHECK_EQ(frame.body[1], outcome);
    }
}

static inline void expect_ack(uint32_t number, uint8_t reason)
{
    const struct pw_frame frame = next_frame();
    CHECK_EQ(frame.kind, PW_FRAME_RECORD);
    CHECK_EQ(frame.size, PW_ACK);
    if (frame.size == PW_ACK) {
        CHECK_EQ(pw_get32(&frame.body[4]), number);
        CHECK_EQ(frame.body[3], reason);
    }
}

/* Returns the record, or NULL. */
static inline const uint8_t *expect_status(uint8_t state)
{
    const struct pw_frame frame = next_frame();
    CHECK_EQ(frame.kind, PW_FRAME_RECORD);
    CHECK_EQ(frame.size, PW_STATUS);
    if (frame.size != PW_STATUS) {
        return NULL;
    }
    CHECK_EQ(frame.body[3], state);
    return frame.body;
}

static inline void expect_end(void)
{
    CHECK_EQ(next_frame().kind, 0);
    CHECK_EQ(got_read, got_size);
}

static inline void expect_text(struct pw_line *from, const char *text)
{
    fetch(from);
    CHECK_EQ(got_size, strlen(text));
    CHECK_BYTES(got, (const uint8_t *)text, strlen(text));
}

static inline void type(struct pw_line *to, const char *text, const char *answer)
{
    give(to, text, strlen(text));
    expect_text(to, answer);
}

static inline void enter(struct pw_line *to)
{
    const uint8_t zero = 0;
    give(to, &zero, 1);
    fetch(to);
    CHECK_EQ(got_size, 1);
    CHECK_EQ(got[0], 0);
}

static inline void enable(struct pw_line *through)
{
    request(through, 1, PW_REQUEST_OUT, PW_REQ_ENABLE, 0, 0);
    fetch(through);
    expect_reply(1, PW_DONE, 0);
}

/* Changes for far-off periods fill the queue; returns the number of the next block. */
static inline uint32_t fill(struct pw_line *through)
{
    uint32_t number = 1;
    while (pw_device_has_room(&device)) {
        block(through, PW_OUTPUT, number, 100000u + number);
        number++;
    }
    fetch(through);
    for (uint32_t i = 1; i < number; i++) {
        expect_ack(i, PW_ACCEPTED);
    }
    expect_end();
    return number;
}

#endif
