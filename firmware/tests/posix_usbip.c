/* The USB/IP server over loopback. An argument makes it measure the throughput. */
#define _POSIX_C_SOURCE 200809L
#include "usbip_client.h"

#include <time.h>

/* Tests -------------------------------------------------------------------------------------------------------- */

static void test_list(void)
{
    static const uint8_t ids[] = {0x12, 0x09, 0x00, 0x01, 0x01, 0x23, 0xEF, 0x02, 0x01, 0x00, 0x01, 0x04};
    static const uint8_t interfaces[] = {0xFF, 0x50, 1, 0, 2, 2, 0, 0, 0x0A, 0, 0, 0, 0xFE, 1, 1, 0};
    check_case = "list";
    begin(true, false);
    client_open();
    client_op(REQ_DEVLIST, NULL);
    CHECK(wait_for(12 + 312 + 16));
    CHECK_EQ(usbip_get32(got), 0x01110005);
    CHECK_EQ(usbip_get32(got + 8), 1);
    CHECK_BYTES(got + 12 + 256, (const uint8_t *)"1-1\0\0", 5);
    CHECK_EQ(usbip_get32(got + 12 + 296), 3); /* high speed */
    CHECK_BYTES(got + 12 + 300, ids, sizeof ids);
    CHECK_BYTES(got + 12 + 312, interfaces, sizeof interfaces);
    expect_end();
    check_case = "refused imports";
    CHECK(client_import("2-1") != 0);
    expect_end();
    attach();
    const int first = peer;
    CHECK(client_import("1-1") != 0);
    expect_end();
    peer = first;
    client_close();
    usb.attached = false;
    CHECK(client_import("1-1") != 0);
    expect_end();
    check_case = "nonsense of a guest";
    client_open();
    client_send((const uint8_t *)"GET / HTTP", 10);
    expect_end();
    client_open();
    client_close();
    begin(true, false);
    attach();
    client_close();
}

static void test_control(void)
{
    static const uint8_t status[8] = {0xC1, 2, 0, 0, 0, 0, 64, 0};
    static const uint8_t unknown[8] = {0xC1, 99, 0, 0, 0, 0, 64, 0};
    static const uint8_t pulses[8] = {0xC1, 10, 0, 0, 0, 0, 0xF0, 1};
    static const uint8_t set_coding[8] = {0x21, 0x20, 0, 0, 1, 0, 7, 0};
    static const uint8_t coding[7] = {1, 2, 3, 4, 0, 0, 8};
    check_case = "control";
    begin(true, false);
    usb.address = 77;
    attach();
    CHECK_EQ(usb.address, 0); /* the bus was reset */
    control_in(5, WHOLE_DESCRIPTOR, 0, 18);
    control_in(6, status, USBIP_EPIPE, 0);
    control_out(7, CONFIGURE, 0);
    CHECK(usb.configured);
    control_in(8, status, 0, 64);
    control_in(9, unknown, USBIP_EPIPE, 0);
    control_in(10, pulses, 0, 496);
    submit(11, 0x00, 0, 7, set_coding);
    client_send(coding, 7);
    expect(RET_SUBMIT, 11, 0, 7, false);
    CHECK_BYTES(usb.coding, coding, 7);
    check_case = "control: data that are not there, an URB too short, one that must not be short";
    submit(12, 0x00, 0, 0, set_coding);
    expect(RET_SUBMIT, 12, USBIP_EPROTO, 0, false);
    submit(13, 0x80, 0, 7, set_coding);
    expect(RET_SUBMIT, 13, USBIP_EPROTO, 0, false);
    submit(14, 0x80, 0, 10, status);
    expect(RET_SUBMIT, 14, USBIP_EOVERFLOW, 10, true);
    forget_got(10);
    submit(15, 0x80, USBIP_SHORT_NOT_OK, 64, FIRST_DESCRIPTOR);
    expect(RET_SUBMIT, 15, USBIP_EREMOTEIO, 18, true);
    forget_got(18);
    check_case = "control: given up";
    still = true;
    submit(16, 0x80, 0, 496, pulses);
    unlink_urb(17, 16);
    expect(RET_UNLINK, 17, USBIP_ECONNRESET, 0, false);
    CHECK(device.reading);
    still = false;
    run_ms(10);
    CHECK(!device.reading);
    stop();
}

static void test_reset(void)
{
    static const uint8_t configuration[8] = {0x80, 8, 0, 0, 0, 0, 1, 0};
    check_case = "a port reset is seen";
    start(true);
    control_in(2, FIRST_DESCRIPTOR, 0, 18);
    CHECK(usb.configured);
    control_in(3, WHOLE_DESCRIPTOR, 0, 18);
    CHECK(!usb.configured);
    check_case = "what is none";
    control_out(4, CONFIGURE, 0);
    control_in(20, FIRST_DESCRIPTOR, 0, 18);
    submit(21, 0x01, 0, 0, NULL);
    expect(RET_SUBMIT, 21, 0, 0, false);
    control_in(5, WHOLE_DESCRIPTOR, 0, 18);
    control_in(6, FIRST_DESCRIPTOR, 0, 18);
    control_in(7, configuration, 0, 1);
    control_in(8, WHOLE_DESCRIPTOR, 0, 18);
    control_in(9, FIRST_DESCRIPTOR, 0, 18);
    submit(10, 0x81, 0, 512, NULL);
    control_in(11, WHOLE_DESCRIPTOR, 0, 18);
    control_in(12, FIRST_DESCRIPTOR, 0, 18);
    control_in(13, WHOLE_DESCRIPTOR, 0, 18);
    CHECK(usb.configured);
    unlink_urb(14, 10);
    expect(RET_UNLINK, 14, USBIP_ECONNRESET, 0, false);
    stop();
}

static void test_bulk(void)
{
    static uint8_t bytes[64u * PW_BLOCK];
    for (uint32_t high_speed = 0; high_speed < 2u; high_speed++) {
        check_case = high_speed == 1u ? "bulk, high speed" : "bulk, full speed";
        start(high_speed == 1u);
        submit(2, 0x81, 0, 16384, NULL);
        submit(3, 0x01, USBIP_ZERO_PACKET, 3u * PW_BLOCK, NULL);
        (void)put_blocks(bytes, 3);
        for (size_t at = 0; at < 3u * PW_BLOCK; at += 96u) {
            client_send(bytes + at, 96); /* in pieces */
        }
        CHECK(wait_for(96 + 32));
        const bool in_first = usbip_get32(got + 4) == 2u;
        CHECK(!in_first); /* queues are worked on in order */
        expect(RET_SUBMIT, 3, 0, 3u * PW_BLOCK, false);
        CHECK_EQ(usbip_get32(got), RET_SUBMIT);
        const uint32_t size = usbip_get32(got + 24);
        CHECK_EQ(size, 96);
        expect(RET_SUBMIT, 2, 0, size, true);
        forget_got(size);
        CHECK_EQ(device.accepted, 3);
        check_case = "more blocks than records can wait";
        for (uint32_t i = 0; i < 64u; i++) {
            submit(10u + i, 0x01, 0, 64u * PW_BLOCK, NULL);
            client_send(bytes, put_blocks(bytes, 64));
        }
        CHECK(wait_for(48)); /* the first one is done, the next ones wait for a reader */
        uint32_t seq = 1000;
        while (device.accepted < 3u + 64u * 64u && seq < 3000u) {
            submit(seq, 0x81, 0, 65536, NULL);
            seq++;
            for (uint32_t i = 0; i < 4u; i++) {
                turn();
                (void)read_more();
            }
        }
        CHECK_EQ(device.accepted, 3u + 64u * 64u);
        CHECK_EQ(device.refused, 0);
        stop();
        got_size = 0;
    }
}

/* A transfer that ends with an empty packet, and commands in pieces. */
static void test_out_ends(void)
{
    uint8_t bytes[3u * 48u + 64u] = {0};
    check_case = "an empty packet behind an URB out";
    start(false);
    submit(2, 0x01, 0, 64, NULL);
    client_send(bytes, 64);
    expect(RET_SUBMIT, 2, 0, 64, false);
    CHECK_EQ(device.refused, 0);
    submit(3, 0x01, USBIP_ZERO_PACKET, 64, NULL);
    client_send(bytes, 64);
    expect(RET_SUBMIT, 3, 0, 64, false);
    CHECK_EQ(device.refused, 1);
    CHECK_EQ(device.last_refusal, PW_LENGTH);
    check_case = "commands in pieces";
    for (uint32_t i = 0; i < 3u; i++) {
        uint8_t *at = bytes + (size_t)48 * i;
        usbip_put32(at, CMD_SUBMIT);
        usbip_put32(at + 4, 10u + i);
        usbip_put32(at + 16, 1);
        usbip_put32(at + 32, NO_ISO);
    }
    client_send(bytes, 48 + 20);
    expect(RET_SUBMIT, 10, 0, 0, false);
    client_send(bytes + 68, 28 + 48);
    expect(RET_SUBMIT, 11, 0, 0, false);
    expect(RET_SUBMIT, 12, 0, 0, false);
    check_case = "what is no command";
    usbip_put32(bytes, RET_SUBMIT);
    client_send(bytes, 48);
    expect_end();
    CHECK(!usb.configured);
    start(false);
    submit(2, 0x01, 0, UINT32_MAX, NULL); /* too much */
    expect_end();
    CHECK(!usb.configured);
}

static void test_in_ends(void)
{
    static uint8_t bytes[16u * PW_BLOCK];
    check_case = "an URB in that is full, and the empty packet behind it";
    start(true);
    submit(2, 0x01, 0, 16u * PW_BLOCK, NULL);
    client_send(bytes, put_blocks(bytes, 16));
    expect(RET_SUBMIT, 2, 0, 16u * PW_BLOCK, false);
    submit(3, 0x81, 0, 512, NULL);
    expect(RET_SUBMIT, 3, 0, 512, true);
    forget_got(512);
    submit(4, 0x81, 0, 512, NULL);
    expect(RET_SUBMIT, 4, 0, 0, true);
    check_case = "overflow";
    submit(5, 0x01, 0, 2u * PW_BLOCK, NULL);
    client_send(bytes, put_blocks(bytes, 2));
    expect(RET_SUBMIT, 5, 0, 2u * PW_BLOCK, false);
    submit(6, 0x81, 0, 32, NULL);
    expect(RET_SUBMIT, 6, USBIP_EOVERFLOW, 32, true);
    forget_got(32);
    submit(7, 0x84, 0, 512, NULL);
    expect(RET_SUBMIT, 7, USBIP_EPIPE, 0, true);
    submit(8, 0x07, 0, 0, NULL);
    expect(RET_SUBMIT, 8, USBIP_EPIPE, 0, false);
    submit(9, 0x82, 0, 16, NULL); /* the console has nothing to tell */
    submit(10, 0x01, 0, 0, NULL); /* an empty packet */
    expect(RET_SUBMIT, 10, 0, 0, false);
    expect_nothing();
    stop();
}

static void test_unlink(void)
{
    static uint8_t bytes[(PW_QUEUE_RECORDS + 16u) * PW_BLOCK];
    const size_t size = sizeof bytes;
    check_case = "UNLINK on a new connection";
    start(true);
    stop();
    begin(true, false);
    attach();
    unlink_urb(900, 899);
    expect(RET_UNLINK, 900, USBIP_ECONNRESET, 0, false);
    control_out(901, CONFIGURE, 0);
    check_case = "UNLINK of an URB that waits";
    submit(902, 0x81, 0, 512, NULL);
    unlink_urb(903, 902);
    expect(RET_UNLINK, 903, USBIP_ECONNRESET, 0, false);
    check_case = "UNLINK of one that was answered";
    unlink_urb(904, 901);
    expect(RET_UNLINK, 904, 0, 0, false);
    check_case = "UNLINK before its SUBMIT";
    unlink_urb(906, 905);
    expect_nothing();
    submit(905, 0x01, 0, PW_BLOCK, NULL);
    client_send(bytes, put_blocks(bytes, 1));
    expect(RET_UNLINK, 906, USBIP_ECONNRESET, 0, false);
    expect_nothing();
    CHECK_EQ(device.accepted, 0);
    check_case = "UNLINK of one that is partly done";
    submit(907, 0x01, 0, (uint32_t)size, NULL);
    client_send(bytes, put_blocks(bytes, PW_QUEUE_RECORDS + 16u));
    for (uint32_t i = 0; i < 1000u && device.accepted < PW_QUEUE_RECORDS; i++) {
        turn();
    }
    unlink_urb(908, 907);
    expect(RET_SUBMIT, 907, USBIP_ECONNRESET, PW_QUEUE_RECORDS * PW_BLOCK, false);
    expect(RET_UNLINK, 908, 0, 0, false);
    CHECK_EQ(device.accepted, PW_QUEUE_RECORDS);
    check_case = "what is queued behind it goes on";
    submit(909, 0x81, 0, 16384, NULL);
    expect(RET_SUBMIT, 909, 0, PW_QUEUE_RECORDS * PW_ACK, true);
    forget_got((size_t)PW_QUEUE_RECORDS * PW_ACK);
    stop();
}

static void test_leaving(void)
{
    static const uint8_t detach[8] = {0x21, 0, 0xE8, 3, 3, 0, 0, 0};
    static const uint8_t dfu_state[8] = {0xA1, 5, 0, 0, 0, 0, 1, 0};
    check_case = "the device leaves and comes back in DFU mode";
    start(true);
    submit(2, 0x81, 0, 512, NULL);
    control_out(3, detach, 0);
    run_ms(30);
    CHECK_EQ(pw_device_leaving(&device), PW_LEAVE_DFU);
    usbip_leave(server);
    expect_end();
    CHECK(client_import("1-1") != 0);
    expect_end();
    begin(true, true);
    attach();
    control_out(1, CONFIGURE, 0);
    control_in(2, dfu_state, 0, 1);
    CHECK_EQ(in[0], PW_DFU_IDLE);
    control_in(3, FIRST_DESCRIPTOR, 0, 18);
    CHECK(!pw_dfu_leaves(&dfu));
    control_in(4, WHOLE_DESCRIPTOR, 0, 18);
    CHECK(pw_dfu_leaves(&dfu));
    stop();
    check_case = "RESET: its answer is the last one of this life";
    for (uint8_t code = PW_REQ_RESET; code <= PW_REQ_REVERT; code++) {
        const uint8_t leave[8] = {0x41, code, 0, 0, 0, 0, 0, 0};
        uint8_t twice[96] = {0};
        start(true);
        for (size_t at = 0; at < sizeof twice; at += 48u) {
            usbip_put32(twice + at, CMD_SUBMIT);
            usbip_put32(twice + at + 4, 2u + (uint32_t)at);
            usbip_put32(twice + at + 32, NO_ISO);
            memcpy(twice + at + 40, leave, 8);
        }
        client_send(twice, 48);
        expect(RET_SUBMIT, 2, 0, 0, false);
        (void)send(peer, twice + 48, 48, MSG_DONTWAIT | MSG_NOSIGNAL);
        expect_end();
        CHECK_EQ(device.leaving, code == PW_REQ_RESET ? PW_LEAVE_RESET : PW_LEAVE_REVERT);
        CHECK(client_import("1-1") != 0);
        expect_end();
    }
    check_case = "the client goes: no voltage";
    start(true);
    CHECK_EQ(pw_device_request(&device, PW_DOOR_LINE(0), &(struct pw_setup){0x41, PW_REQ_ENABLE, 0, 0, 0}, in,
                               &(uint16_t){0}), PW_ANSWERED);
    CHECK_EQ(device.state, PW_STATE_READY);
    stop();
    CHECK_EQ(device.state, PW_STATE_OFF);
}

/* Commands of any kind: nothing may break, and what is no command ends the connection. */
static void test_anything(void)
{
    check_case = "anything";
    for (uint32_t round = 0; round < 300u; round++) {
        start(round % 2u == 0u);
        for (uint32_t i = 0; i < 60u; i++) {
            static const uint8_t endpoints[] = {0x00, 0x80, 0x01, 0x81, 0x82, 0x03, 0x83, 0x04};
            static uint8_t data[4096];
            const uint8_t endpoint = endpoints[check_below(8)];
            const uint32_t size = check_below(3) == 0u ? check_below(4096) : 512u * check_below(8);
            uint8_t setup[8] = {0, (uint8_t)check_below(16), (uint8_t)check_below(3), (uint8_t)check_below(8),
                                (uint8_t)check_below(4), 0, (uint8_t)check_random(), 0};
            static const uint8_t types[] = {0, 1, 2, 0x21, 0x80, 0x81, 0x82, 0xA1, 0xC1, 0x41, 0xC0};
            setup[0] = types[check_below(sizeof types)];
            if (check_below(5) == 0u) {
                unlink_urb(100u + 2u * i + 1u, 100u + check_below(2u * i + 10u));
            } else {
                submit(100u + 2u * i, endpoint, check_below(2) == 0u ? 0u : 0x41u, size, setup);
                if ((endpoint & 0x80u) == 0u) {
                    client_send(data, size);
                }
            }
            got_size = 0;
        }
        turn();
        got_size = 0;
        CHECK(read_more());
        if (check_below(2) == 0u) {
            uint8_t noise[200];
            for (size_t i = 0; i < sizeof noise; i++) {
                noise[i] = (uint8_t)(check_random() | 1u);
            }
            client_send(noise, sizeof noise);
            expect_end();
            CHECK(!usb.configured);
        } else {
            client_close();
        }
    }
}

/* Blocks a second on this computer: the device stands still, so that this is the door's own cost. */
static void measure(uint32_t blocks, uint32_t in_flight)
{
    static uint8_t bytes[512u * PW_BLOCK];
    struct timespec from;
    struct timespec to;
    uint32_t seq = 2;
    start(true);
    (void)clock_gettime(CLOCK_MONOTONIC, &from);
    const uint32_t rounds = 100000u / (blocks * in_flight);
    for (uint32_t round = 0; round < rounds; round++) {
        for (uint32_t i = 0; i < in_flight; i++) {
            submit(seq, 0x01, 0, blocks * PW_BLOCK, NULL);
            client_send(bytes, put_blocks(bytes, blocks));
            submit(seq + 1u, 0x81, 0, 65536, NULL);
            seq += 2u;
        }
        for (uint32_t i = 0; i < 10000u && usb.device->accepted < (round + 1u) * blocks * in_flight; i++) {
            turn();
            (void)read_more();
            if (usb.ack_count != 0u) { /* nobody reads */
                submit(seq, 0x81, 0, 65536, NULL);
                seq++;
            }
            got_size = 0;
        }
    }
    (void)clock_gettime(CLOCK_MONOTONIC, &to);
    const double seconds_taken = (double)(to.tv_sec - from.tv_sec) + 1e-9 * (double)(to.tv_nsec - from.tv_nsec);
    printf("%lu blocks in transfers of %lu, client and checksums included: %.0f blocks/s\n",
           (unsigned long)device.accepted, (unsigned long)blocks, (double)device.accepted / seconds_taken);
    stop();
    got_size = 0;
}

int main(int count, char **arguments)
{
    (void)arguments;
    begin(true, false);
    server = usbip_open("127.0.0.1", 0, &usb, NULL);
    CHECK(server != NULL);
    if (server == NULL) {
        return check_end();
    }
    test_list();
    test_control();
    test_reset();
    test_bulk();
    test_out_ends();
    test_in_ends();
    test_unlink();
    test_leaving();
    test_anything();
    if (count > 1) {
        check_case = "throughput";
        measure(1, 32);
        measure(32, 8);
        measure(512, 2);
    }
    usbip_close(server);
    return check_end();
}
