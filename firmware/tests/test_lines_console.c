/* The console over the real device, and lines that get any bytes. */
#include "lines.h"
#include "vectors.h"

static void test_session(void)
{
    check_case = "session";
    begin();
    type(&line, "echo 0\r\n", "echo 0\r\nok\r\n> ");
    type(&line, "watchdog 5000\n", "ok\r\n> ");
    type(&line, "test 17\n", "error 6 DISABLED: the outputs are not enabled\r\n> ");
    type(&line, "enable\n", "ok\r\n> ");
    type(&line, "test 17\n", "ok\r\n> ");
    pass(10);
    type(&line, "pulses 17\n", "");
    pass(2);
    expect_text(&line, "phase: 0\r\nwidth: 2\r\nok\r\n> ");
    type(&line, "limit 400\n", "error 5 limit takes transducers 0 to 320, not 400\r\n> ");
    type(&line, "limit 300\n", "error 6 not while the outputs are enabled\r\n> ");
    type(&line, "halt\n", "error 3 no command halt; help lists them\r\n> ");
    type(&line, "stop\n", "ok\r\n> ");
    CHECK_EQ(device.state, PW_STATE_OFF);
    type(&line, "frames\n", "frames: send the byte 00\r\nok\r\n> ");
    type(&line, "faults\n", "faults: none\r\nok\r\n> ");
    CHECK_EQ(device.accepted, 1);
    CHECK_EQ(device.watchdog_ms, 5000);
    /* A full queue: `test` is refused, without a reason's name. */
    type(&line, "enable\n", "ok\r\n> ");
    enter(&other);
    (void)fill(&other);
    type(&line, "test 17\n", "error 6 the queue has no room\r\n> ");
    for (size_t i = 0; i < VEC_COUNT(vec_exchanges); i++) {
        if ((vec_exchanges[i].of == NULL) && (strcmp(vec_exchanges[i].line, "clock") != 0)
            && (strcmp(vec_exchanges[i].line, "pulses 17") != 0)) {
            check_case = vec_exchanges[i].name;
            give(&line, vec_exchanges[i].line, strlen(vec_exchanges[i].line));
            give(&line, "\r", 1);
            fetch(&line);
            CHECK_EQ(got_size, vec_exchanges[i].size);
            CHECK_BYTES(got, vec_exchanges[i].answer, got_size);
        }
    }
}

/* What the device says no to, and lines that are too long. */
static void test_refusals(void)
{
    static const char boards[] = "boards\r";
    uint8_t spaces[82];
    check_case = "refusals";
    begin();
    type(&line, "echo 0\r", "echo 0\r\nok\r\n> ");
    memset(spaces, ' ', sizeof spaces);
    spaces[81] = '\r';
    give(&line, spaces, sizeof spaces);
    expect_text(&line, "error 1 more than 80 characters\r\n> ");
    type(&line, "\t\r", "error 2 a character that is not printable ASCII\r\n> ");
    type(&line, "stat\r", "error 3 no command stat; help lists them\r\n> ");
    type(&line, "echo 4294967297\r", "error 5 echo takes on 0 to 1, not 4294967297\r\n> ");
    type(&line, "limit\r", "error 4 limit takes transducers 0 to 320\r\n> ");
    type(&line, "identify 99999999999999999999\r",
         "error 5 identify takes board 0 to 4, not 99999999999999999999\r\n> ");
    type(&line, "limit 0\r", "ok\r\n> ");
    type(&line, "enable\r", "ok\r\n> ");
    type(&line, "test 0\r", "error 6 DRIVE: more power than the limit\r\n> ");
    CHECK_EQ(device.refused, 1);
    device.persisting = PW_FAULT_SUPPLY;
    device.faults = PW_FAULT_SUPPLY;
    device.state = PW_STATE_FAULT;
    type(&line, "test 0\r", "error 6 FAULT: a fault is not cleared\r\n> ");
    type(&line, "enable\r", "error 6 not in state FAULT\r\n> ");
    type(&line, "clear\r", "ok\r\n> ");
    CHECK_EQ(device.state, PW_STATE_FAULT);
    device.persisting = 0;
    type(&line, "clear\rstop\r", "ok\r\n> ok\r\n> ");
    CHECK_EQ(device.state, PW_STATE_OFF);
    /* A console whose text is not fetched takes no more; nothing of it is lost. */
    give(&line, boards, 7);
    fetch(&line);
    const size_t answer = got_size;
    size_t taken = 0;
    CHECK(answer > 1000u);
    while (pw_line_receive(&line, &device, (const uint8_t *)boards, 7) == 7u) {
        taken++;
    }
    fetch(&line);
    CHECK(taken > 0u);
    CHECK_EQ(got_size, taken * answer);
    /* At the end of a connection the same, and what was typed last is carried out; what only answers is not. */
    pw_line_finish(&line, &device, (const uint8_t *)"\025enable\rpulses 1\rst", 20);
    CHECK_EQ(device.state, PW_STATE_READY);
    CHECK(!device.reading);
    expect_text(&line, "");
}

/* What a host makes of a line: text until 00, then frames until CONSOLE. */
struct host {
    bool frames;
    uint32_t count;
};

static void read_as_host(struct host *host, struct pw_line *from)
{
    fetch(from);
    while (got_read < got_size) {
        if (host->frames) {
            const struct pw_frame frame = next_frame();
            const bool whole = (frame.kind == 0u) || ((got_read < got_size) && (got[got_read] == 0u));
            CHECK(whole);
            CHECK((frame.kind != PW_FRAME_BLOCK) && (frame.kind != PW_FRAME_REQUEST));
            host->frames = frame.kind != PW_FRAME_CONSOLE;
            host->count += frame.kind != 0u ? 1u : 0u;
            got_read += host->frames ? 0u : 1u;
        } else {
            const uint8_t byte = got[got_read];
            const bool control = (byte == 7u) || (byte == 8u) || (byte == 10u) || (byte == 13u);
            CHECK((byte == 0u) || control || ((byte >= 0x20u) && (byte <= 0x7Eu)));
            host->frames = byte == 0u;
            got_read++;
        }
    }
}

static size_t any_piece(uint8_t *bytes, uint8_t tag)
{
    static const char commands[] = "boards\rpulses 3\renable\rtest 5\r";
    uint8_t body[PW_BLOCK] = {tag, PW_REQUEST_IN};
    size_t size = 0;
    switch (check_below(6)) {
    case 0:
        size = check_below(700);
        for (size_t i = 0; i < size; i++) {
            bytes[i] = (uint8_t)check_below(1u + check_below(256));
        }
        break;
    case 1:
        bytes[0] = 0;
        size = 1;
        break;
    case 2:
        size = pw_frame_encode(bytes, PW_FRAME_BLOCK, body, sizeof body);
        break;
    case 3:
        size = sizeof commands - 1u;
        memcpy(bytes, commands, size);
        break;
    case 4:
        size = pw_frame_encode(bytes, PW_FRAME_CONSOLE, NULL, 0);
        break;
    default:
        body[1] = check_below(2) == 0u ? PW_REQUEST_IN : PW_REQUEST_OUT;
        body[2] = (uint8_t)check_below(PW_REQ_RESET);
        body[7] = body[1] == PW_REQUEST_IN ? 64u : 0u;
        size = pw_frame_encode(bytes, PW_FRAME_REQUEST, body, 9);
        break;
    }
    return size;
}

/* Any bytes, in pieces, with hang-ups: a host can read all that is sent, and every byte is taken in the end. */
static void test_any_bytes(void)
{
    struct host hosts[2] = {{0}};
    check_case = "any bytes";
    begin();
    for (uint32_t round = 0; round < 6000u; round++) {
        uint8_t bytes[PW_FRAME_MOST + 100u];
        struct pw_line *to = check_below(2) == 0u ? &line : &other;
        struct host *host = &hosts[to == &line ? 0 : 1];
        to->is_uart = to == &other;
        const size_t size = any_piece(bytes, (uint8_t)round);
        size_t taken = pw_line_receive(to, &device, bytes, size);
        CHECK(to->out.used <= PW_LINE_BYTES);
        pass(check_below(3));
        if (check_below(40) == 0u) {
            to->may_text = check_below(3) != 0u;
            pw_line_finish(to, &device, &bytes[taken], size - taken);
            taken = size;
            CHECK_EQ(to->out.used, 0);
            host->frames = false;
        }
        for (uint32_t i = 0; (taken < size) && (i < 100u); i++) {
            pass(1);
            read_as_host(host, to);
            taken += pw_line_receive(to, &device, &bytes[taken], size - taken);
        }
        CHECK_EQ(taken, size);
        if (check_below(3) != 0u) {
            read_as_host(host, to);
            CHECK_EQ(host->frames, to->frames);
        }
    }
    CHECK(hosts[0].count > 500u);
    CHECK(hosts[1].count > 500u);
    CHECK(device.dropped_frames > 500u);
    CHECK(device.refused > 100u);
}

int main(void)
{
    test_session();
    test_refusals();
    test_any_bytes();
    return check_end();
}
