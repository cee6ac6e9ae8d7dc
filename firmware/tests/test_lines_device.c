/* Lines over the real device: modes, order, the block that waits, what is answered LATER. */
#include "lines.h"
#include "vectors.h"

/* Modes (SER-010) -------------------------------------------------------------------------------------------------- */

/* The vectors' records go to the host: a device drops and counts them. */
static void test_streams(void)
{
    for (size_t i = 0; i < VEC_COUNT(vec_streams); i++) {
        const struct vec_stream *v = &vec_streams[i];
        size_t event = 0;
        size_t text = 0;
        check_case = v->name;
        begin();
        for (size_t k = 0; k < v->size; k++) {
            const bool before = line.frames;
            const uint32_t dropped = device.dropped_frames;
            struct pw_frame frame = {0};
            uint8_t copy[PW_FRAME_MOST];
            memcpy(copy, line.frame, sizeof copy);
            const bool whole = before && (v->bytes[k] == 0u) && !line.too_long
                && pw_frame_decode(&frame, copy, line.frame_size);
            give(&line, &v->bytes[k], 1);
            const struct vec_event *e = event < v->event_count ? &v->events[event] : &v->events[0];
            if (!before && (v->bytes[k] != 0u)) {
                CHECK_EQ(e->what, VEC_TEXT);
                CHECK(text < e->size);
                CHECK_EQ(v->bytes[k], e->bytes[text < e->size ? text : 0u]);
                text++;
                event += text == e->size ? 1u : 0u;
            } else if (before != line.frames) {
                CHECK_EQ(e->what, line.frames ? VEC_FRAMES : VEC_CONSOLE);
                text = 0;
                event++;
            } else if (device.dropped_frames != dropped) {
                CHECK_EQ(e->what, whole ? VEC_FRAME : VEC_DROPPED);
                CHECK_EQ(frame.kind, e->kind);
                CHECK_EQ(frame.size, whole ? e->size : 0u);
                event++;
            } else {
                /* within a frame, or nothing between two zeros */
            }
        }
        CHECK_EQ(event, v->event_count);
    }
}

static void test_modes(void)
{
    check_case = "modes";
    begin();
    type(&line, "sta", "sta");
    enter(&line);
    request(&line, 7, PW_REQUEST_IN, PW_REQ_STATUS, 0, 64);
    request(&line, 8, PW_REQUEST_IN, 99, 0, 64);
    request(&line, 9, 0x21, 0, 0, 0);
    request(&line, 10, PW_REQUEST_IN, PW_REQ_INFO, 0, 10);
    fetch(&line);
    expect_reply(7, PW_DONE, 64);
    expect_reply(8, PW_STALL, 0);
    expect_reply(9, PW_STALL, 0);
    expect_reply(10, PW_DONE, 10);
    expect_end();
    /* 00, CONSOLE, 00 leads to frames, whatever was before; the answer is CONSOLE, prompt, 00. */
    const uint8_t again[] = {0x13, 0, 0x06, 0x05, 0x02, 0x1b, 0x68, 0xa2, 0, 0};
    give(&line, again, sizeof again);
    CHECK_EQ(device.dropped_frames, 1);
    fetch(&line);
    const uint8_t wanted[] = {0x06, 0x05, 0x02, 0x1b, 0x68, 0xa2, 0, '>', ' ', 0};
    CHECK_EQ(got_size, sizeof wanted);
    CHECK_BYTES(got, wanted, sizeof wanted);
    /* Echo outlives frames, not a hang-up; a frame that had begun is counted. */
    give_frame(&line, PW_FRAME_CONSOLE, NULL, 0);
    fetch(&line);
    type(&line, "echo 0\r", "echo 0\r\nok\r\n> ");
    enter(&line);
    give_frame(&line, PW_FRAME_CONSOLE, NULL, 0);
    fetch(&line);
    type(&line, "\n", "> ");
    enter(&line);
    give(&line, "abc", 3);
    pw_line_hang_up(&line, &device);
    CHECK_EQ(device.dropped_frames, 2);
    expect_text(&line, "");
    type(&line, "  \r\n", "  \r\n> ");
    /* Answers that were not sent are dropped. */
    give(&line, "status\r", 7);
    pw_line_hang_up(&line, &device);
    expect_text(&line, "");
    CHECK_EQ(device.listening, 0);
}

static void test_zero_after_a_pause(void)
{
    check_case = "zero after a pause";
    begin();
    pw_line_begin(&line, PW_DOOR_LINE(0u), true);
    enter(&line);
    for (uint8_t i = 0; i < 2u; i++) {
        request(&line, i, PW_REQUEST_OUT, PW_REQ_DISABLE, 0, 0);
    }
    fetch(&line);
    CHECK_EQ(got[0], 0);
    size_t zeros = 0;
    for (size_t i = 0; i < got_size; i++) {
        zeros += got[i] == 0u ? 1u : 0u;
    }
    CHECK_EQ(zeros, 3);
    expect_reply(0, PW_DONE, 0);
    expect_reply(1, PW_DONE, 0);
    expect_end();
}

static void test_dtr(void)
{
    check_case = "no DTR";
    begin();
    line.may_text = false;
    type(&line, "version\r", ""); /* USB-023 */
    CHECK(!line.answered);
    CHECK(pw_line_idle(&line));
    line.may_text = true;
    expect_text(&line, ""); /* it is dropped, not held back */
    CHECK(!line.answered);
    type(&line, "version\r", "version\r\noldest_version: 1\r\nnewest_version: 1\r\nfirmware: 1.2.3\r\nok\r\n> ");
    CHECK(line.answered);
    line.may_text = false;
    for (uint32_t i = 0; i < 3000u; i++) {
        give(&line, "help\r", 5); /* however much is dropped, frames get through */
    }
    enter(&line);
    request(&line, 1, PW_REQUEST_IN, PW_REQ_INFO, 0, 64);
    give_frame(&line, PW_FRAME_CONSOLE, NULL, 0);
    fetch(&line);
    expect_reply(1, PW_DONE, 64);
    CHECK_EQ(next_frame().kind, PW_FRAME_CONSOLE);
    CHECK_EQ(got_read + 1u, got_size); /* its zero is the last byte */
}

/* The block that waits (SER-011) ----------------------------------------------------------------------------------- */

static void test_block_waits(void)
{
    check_case = "block waits";
    begin();
    enter(&line);
    enable(&line);
    const uint32_t number = fill(&line);
    CHECK_EQ(number, PW_QUEUE_CHANGES + 1u);
    block(&line, PW_NO_OP, number, 0);
    const uint64_t arrived = device.now;
    fetch(&line);
    expect_end();
    /* A second one has no place: dropped and counted, the first stays. Requests are answered meanwhile. */
    block(&line, PW_NO_OP, number + 1u, 0);
    CHECK_EQ(device.dropped_frames, 1);
    request(&line, 5, PW_REQUEST_IN, PW_REQ_CLOCK, 0, 24);
    fetch(&line);
    expect_reply(5, PW_DONE, 24);
    expect_end();
    pass(40);
    /* DISABLE through this line empties the queue: its reply comes first, the block is judged in the new state. */
    request(&line, 6, PW_REQUEST_OUT, PW_REQ_DISABLE, 0, 0);
    fetch(&line);
    expect_reply(6, PW_DONE, 0);
    const struct pw_frame ack = next_frame();
    CHECK_EQ(ack.size, PW_ACK);
    CHECK_EQ(pw_get32(&ack.body[4]), number);
    CHECK_EQ(pw_get64(&ack.body[16]), arrived);
    CHECK_EQ(ack.body[26], PW_STATE_OFF);
    expect_end();
}

/* A block that comes before the port has polled the line does not overtake the one that waits. */
static void test_order_of_blocks(void)
{
    check_case = "order of blocks";
    begin();
    enter(&line);
    enable(&line);
    const uint32_t number = fill(&line);
    block(&line, PW_NO_OP, number, 0);
    const struct pw_setup disable = {PW_REQUEST_OUT, PW_REQ_DISABLE, 0, 0, 0};
    uint16_t size = 0;
    uint8_t answer[PW_ANSWER];
    CHECK_EQ(pw_device_request(&device, PW_DOOR_USB, &disable, answer, &size), PW_ANSWERED);
    block(&line, PW_NO_OP, number + 1u, 0);
    CHECK_EQ(device.dropped_frames, 0);
    fetch(&line);
    expect_ack(number, PW_ACCEPTED);
    expect_ack(number + 1u, PW_ACCEPTED);
    expect_status(PW_STATE_OFF);
    expect_end();
}

/* Of the records that nobody asked for one waits, the newest, and behind the answers (ACK-006). */
static void test_newest_record(void)
{
    check_case = "newest record";
    begin();
    enter(&line);
    enter(&other);
    request(&line, 1, PW_REQUEST_IN, PW_REQ_INFO, 0, 64);
    enable(&other);
    CHECK_EQ(pw_line_send(&line, &device, got, 1), 1);
    request(&other, 2, PW_REQUEST_OUT, PW_REQ_DISABLE, 0, 0);
    got_size = 1;
    fetch_more(&line);
    expect_reply(1, PW_DONE, 64);
    expect_status(PW_STATE_OFF);
    expect_end();
}

/* Of a frame that is too long nothing is carried out, although its beginning is a whole one (SER-005). */
static void test_too_long(void)
{
    const uint8_t one = 1;
    const uint8_t zero = 0;
    check_case = "too long";
    begin();
    enter(&line);
    for (size_t i = 0; i < VEC_COUNT(vec_frames); i++) {
        if (vec_frames[i].size == PW_FRAME_MOST) {
            give(&line, vec_frames[i].bytes, PW_FRAME_MOST - 1u);
            give(&line, &one, 1);
            give(&line, &zero, 1);
            CHECK_EQ(device.dropped_frames, 1);
            give(&line, vec_frames[i].bytes, PW_FRAME_MOST);
            fetch(&line);
            expect_reply(3, PW_STALL, 0);
            expect_end();
        }
    }
    CHECK_EQ(device.dropped_frames, 1);
}

static void test_watchdog_while_a_block_waits(void)
{
    check_case = "watchdog while a block waits";
    begin();
    enter(&line);
    enter(&other);
    enable(&line);
    fetch(&other);
    expect_status(PW_STATE_READY); /* what came through another door */
    const uint32_t number = fill(&line);
    block(&line, PW_OUTPUT, number, 0);
    pass((PW_WATCHDOG_MS + 2u) * PW_PERIODS_PER_MS);
    fetch(&line);
    expect_ack(number, PW_DISABLED);
    const uint8_t *status = expect_status(PW_STATE_OFF);
    CHECK(status != NULL);
    if (status != NULL) {
        CHECK_EQ(pw_get32(&status[28]), 1); /* the counters include the block */
        CHECK_EQ(status[7] & PW_WATCHDOG_FIRED, PW_WATCHDOG_FIRED);
    }
    expect_end();
    fetch(&other);
    expect_status(PW_STATE_OFF);
    expect_end();
}

static void test_mute_block(void)
{
    check_case = "nobody waits for the block's answer";
    for (uint32_t way = 0; way < 2u; way++) {
        begin();
        enter(&line);
        enable(&line);
        const uint32_t number = fill(&line);
        block(&line, PW_NO_OP, number, 0);
        if (way == 0u) {
            pw_line_hang_up(&line, &device);
        } else {
            give_frame(&line, PW_FRAME_CONSOLE, NULL, 0);
            fetch(&line);
        }
        enter(&line);
        block(&line, PW_NO_OP, number + 1u, 0); /* its place is still taken */
        CHECK_EQ(device.dropped_frames, 1);
        const uint32_t accepted = device.accepted;
        request(&line, 3, PW_REQUEST_OUT, PW_REQ_DISABLE, 0, 0);
        fetch(&line);
        expect_reply(3, PW_DONE, 0);
        expect_end();
        CHECK_EQ(device.accepted, accepted + 1u);
        block(&line, PW_NO_OP, number + 2u, 0);
        fetch(&line);
        expect_ack(number + 2u, PW_ACCEPTED);
    }
}

/* Order, and what is answered LATER -------------------------------------------------------------------------------- */

static void test_pulses(void)
{
    check_case = "pulses";
    begin();
    enter(&line);
    enter(&other);
    chain_slow = true;
    request(&line, 1, PW_REQUEST_IN, PW_REQ_PULSES, 0, 496);
    request(&other, 2, PW_REQUEST_IN, PW_REQ_PULSES, 0, 100); /* waits for the first */
    /* What comes next is taken up to the zero that would end it. */
    uint8_t frame[PW_FRAME_MOST];
    const uint8_t body[9] = {3, PW_REQUEST_IN, PW_REQ_INFO, 0, 0, 0, 0, 64, 0};
    const size_t size = pw_frame_encode(frame, PW_FRAME_REQUEST, body, sizeof body);
    CHECK_EQ(pw_line_receive(&line, &device, frame, size), size - 1u);
    pass(1);
    fetch(&line);
    expect_end();
    CHECK(!pw_line_idle(&line));
    chain_slow = false;
    pass(3);
    CHECK_EQ(pw_line_receive(&line, &device, &frame[size - 1u], 1), 1);
    fetch(&line);
    expect_reply(1, PW_DONE, 496);
    expect_reply(3, PW_DONE, 64);
    expect_end();
    fetch(&other);
    expect_reply(2, PW_DONE, 100);
    expect_end();
    /* An answer that is LATER outlives no hang-up, and does not turn up later. */
    chain_slow = true;
    request(&line, 4, PW_REQUEST_IN, PW_REQ_PULSES, 0, 496);
    pw_line_hang_up(&line, &device);
    chain_slow = false;
    pass(3);
    enter(&line);
    request(&line, 5, PW_REQUEST_IN, PW_REQ_PULSES, 0, 496);
    pass(3);
    fetch(&line);
    expect_reply(5, PW_DONE, 496);
    expect_end();
}

static void test_no_room(void)
{
    check_case = "no room for answers";
    begin();
    enter(&line);
    uint8_t frame[PW_FRAME_MOST];
    const uint8_t body[9] = {1, PW_REQUEST_IN, PW_REQ_WIRING, 0, 0, 0, 0, 0x80, 0x02};
    const size_t size = pw_frame_encode(frame, PW_FRAME_REQUEST, body, sizeof body);
    uint32_t taken = 0;
    while (pw_line_receive(&line, &device, frame, size) == size) {
        taken++;
    }
    CHECK(taken >= (PW_LINE_BYTES - PW_REPLY_MOST) / 651u);
    const uint64_t arrived = device.now;
    pass(10);
    CHECK_EQ(pw_line_receive(&line, &device, &frame[size - 1u], 1), 0);
    CHECK_EQ(line.held_since, arrived);
    fetch(&line);
    for (uint32_t i = 0; i < taken; i++) {
        expect_reply(1, PW_DONE, 640);
    }
    CHECK_EQ(pw_line_receive(&line, &device, &frame[size - 1u], 1), 1);
    fetch(&line);
    expect_reply(1, PW_DONE, 640);
    expect_end();
    /* The end of a connection: what had arrived whole is carried out, although nobody fetches the answers. */
    while (pw_line_receive(&line, &device, frame, size) == size) {
        taken++;
    }
    uint8_t rest[2u * PW_FRAME_MOST];
    const uint8_t enabling[9] = {2, PW_REQUEST_OUT, PW_REQ_ENABLE, 0, 0, 0, 0, 0, 0};
    rest[0] = 0;
    size_t at = 1u + pw_frame_encode(&rest[1], PW_FRAME_REQUEST, enabling, sizeof enabling);
    rest[at] = 1;
    at++;
    pw_line_finish(&line, &device, rest, at);
    CHECK_EQ(device.state, PW_STATE_READY);
    CHECK_EQ(device.dropped_frames, 1);
    expect_text(&line, "");
    CHECK(!line.frames);
}

static void test_leaving(void)
{
    check_case = "reset and dfu";
    begin();
    enter(&line);
    request(&line, 9, PW_REQUEST_OUT, PW_REQ_RESET, 1, 0); /* another value: STALL, and nothing happens */
    request(&line, 9, PW_REQUEST_OUT, PW_REQ_RESET, 0, 0);
    give(&line, "anything", 8);
    CHECK(!pw_line_idle(&line));
    fetch(&line);
    expect_reply(9, PW_STALL, 0);
    expect_reply(9, PW_DONE, 0);
    CHECK_EQ(next_frame().kind, PW_FRAME_CONSOLE);
    got_read++;
    expect_end();
    CHECK(pw_line_idle(&line));
    pass(100);
    CHECK_EQ(pw_device_leaving(&device), PW_LEAVE_RESET);
    begin();
    type(&line, "reset\rstatus\r", "reset\r\nok\r\n> ");
    pass(100);
    CHECK_EQ(pw_device_leaving(&device), PW_LEAVE_RESET);
    begin();
    type(&line, "dfu\r", "dfu\r\nok\r\n> ");
    CHECK_EQ(device.state, PW_STATE_DFU);
    type(&line, "dfu\r", "dfu\r\nerror 6 not in state DFU\r\n> ");
}

static void test_answered(void)
{
    check_case = "answered";
    begin();
    type(&line, "halt\r\rstatus 1\rpulses 320\r",
         "halt\r\nerror 3 no command halt; help lists them\r\n> \r\n> "
         "status 1\r\nerror 4 status takes no argument\r\n> "
         "pulses 320\r\nerror 5 pulses takes transducer 0 to 319, not 320\r\n> ");
    enter(&line);
    give(&line, "\1\1\1", 4);
    block(&line, PW_NO_OP, 1, 0);
    fetch(&line);
    CHECK(!line.answered);
    request(&line, 1, PW_REQUEST_IN, PW_REQ_INFO, 0, 64);
    CHECK(!line.answered);
    fetch(&line);
    CHECK(line.answered);
    begin();
    type(&line, "test 1\r", "test 1\r\nerror 6 DISABLED: the outputs are not enabled\r\n> ");
    CHECK(line.answered);
    begin();
    enter(&line);
    fetch(&line);
    request(&line, 1, PW_REQUEST_IN, 99, 0, 64); /* STALL is an answer */
    fetch(&line);
    CHECK(line.answered);
    begin();
    enter(&line);
    fetch(&line);
    request(&line, 1, PW_REQUEST_IN, PW_REQ_INFO, 0, 64);
    pw_line_hang_up(&line, &device); /* but not one that is dropped: FWU-020 */
    fetch(&line);
    CHECK(!line.answered);
}

int main(void)
{
    test_streams();
    test_modes();
    test_zero_after_a_pause();
    test_dtr();
    test_block_waits();
    test_order_of_blocks();
    test_newest_record();
    test_too_long();
    test_watchdog_while_a_block_waits();
    test_mute_block();
    test_pulses();
    test_no_room();
    test_leaving();
    test_answered();
    return check_end();
}
