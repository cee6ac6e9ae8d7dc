/* A USB/IP client for the tests, in the same process as the server: each wait gives the server its turn. */
#ifndef USBIP_CLIENT_H
#define USBIP_CLIENT_H

#include "usb_fixture.h"

#include <arpa/inet.h>
#include <errno.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include "usbip.h"
#include "usbip_urbs.h"

enum { REQ_DEVLIST = 0x8005, REQ_IMPORT = 0x8003, CMD_SUBMIT = 1, CMD_UNLINK = 2, RET_SUBMIT = 3, RET_UNLINK = 4 };
#define NO_ISO 0xFFFFFFFFu
#define ANSWER_BYTES (4u << 20)

static struct usbip *server;
static int peer = -1;
static uint8_t got[ANSWER_BYTES]; /* what the client has read */
static size_t got_size;
static bool still; /* the device's time is */

/* The client --------------------------------------------------------------------------------------------------- */

/* The server's turn, and a little of the device's time. */
static inline void turn(void)
{
    struct pollfd fds[USBIP_FDS];
    CHECK(usbip_fds(server, fds) <= USBIP_FDS);
    usbip_serve(server);
    if (!still) {
        run_until(now + PW_TICKS);
    }
    usbip_work(server);
}

/* False: the server has ended the connection. */
static inline bool read_more(void)
{
    const ssize_t size = recv(peer, got + got_size, ANSWER_BYTES - got_size, MSG_DONTWAIT);
    if (size > 0) {
        got_size += (size_t)size;
    }
    return size > 0 || (size < 0 && errno == EAGAIN);
}

/* What has been sent may take a moment on its way. */
static inline void pause_1ms(void)
{
    struct pollfd fd = {peer, POLLIN, 0};
    (void)poll(&fd, 1, 1);
}

/* Waits until so many bytes have come; false if they do not. */
static inline bool wait_for(size_t size)
{
    bool open = true;
    for (uint32_t i = 0; i < 3000u && got_size < size && open; i++) {
        turn();
        open = read_more();
        if (got_size < size) {
            pause_1ms();
        }
    }
    return got_size >= size;
}

static inline void forget_got(size_t size)
{
    CHECK(size <= got_size);
    got_size -= size <= got_size ? size : got_size;
    memmove(got, got + size, got_size);
}

static inline void client_send(const uint8_t *bytes, size_t size)
{
    size_t at = 0;
    for (uint32_t i = 0; i < 100000u && at < size; i++) {
        const ssize_t sent = send(peer, bytes + at, size - at, MSG_DONTWAIT | MSG_NOSIGNAL);
        at += sent > 0 ? (size_t)sent : 0u;
        turn();
        (void)read_more();
    }
    CHECK_EQ(at, size);
}

static inline void client_open(void)
{
    struct sockaddr_in at;
    memset(&at, 0, sizeof at);
    at.sin_family = AF_INET;
    at.sin_port = htons((uint16_t)usbip_port(server));
    at.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    const int yes = 1;
    peer = socket(AF_INET, SOCK_STREAM, 0);
    (void)setsockopt(peer, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
    got_size = 0;
    CHECK_EQ(connect(peer, (const struct sockaddr *)&at, sizeof at), 0);
}

/* The server sees that the client has gone. */
static inline void client_close(void)
{
    (void)close(peer);
    peer = -1;
    for (uint32_t i = 0; i < 1000u && usb.configured; i++) {
        turn();
        pause_1ms();
    }
    turn();
}

static inline void client_op(uint16_t code, const char *bus_id)
{
    uint8_t bytes[40] = {0x01, 0x11};
    usbip_put16(bytes + 2, code);
    if (bus_id != NULL) {
        memcpy(bytes + 8, bus_id, strlen(bus_id));
    }
    client_send(bytes, bus_id == NULL ? 8u : 40u);
}

/* The status of the answer. */
static inline uint32_t client_import(const char *bus_id)
{
    client_open();
    client_op(REQ_IMPORT, bus_id);
    CHECK(wait_for(8));
    CHECK_EQ(usbip_get32(got), 0x01110003);
    return usbip_get32(got + 4);
}

static inline void attach(void)
{
    CHECK_EQ(client_import("1-1"), 0);
    CHECK(wait_for(320));
    forget_got(320);
    CHECK_EQ(got_size, 0);
}

/* A SUBMIT, without its data. */
static inline void submit(uint32_t seq, uint8_t endpoint, uint32_t flags, uint32_t size, const uint8_t setup[8])
{
    uint8_t bytes[48] = {0};
    usbip_put32(bytes, CMD_SUBMIT);
    usbip_put32(bytes + 4, seq);
    usbip_put32(bytes + 8, 0x00010002);
    usbip_put32(bytes + 12, endpoint >> 7);
    usbip_put32(bytes + 16, endpoint & 0x0Fu);
    usbip_put32(bytes + 20, flags);
    usbip_put32(bytes + 24, size);
    usbip_put32(bytes + 32, NO_ISO);
    if (setup != NULL) {
        memcpy(bytes + 40, setup, 8);
    }
    client_send(bytes, sizeof bytes);
}

static inline void unlink_urb(uint32_t seq, uint32_t unlinked)
{
    uint8_t bytes[48] = {0};
    usbip_put32(bytes, CMD_UNLINK);
    usbip_put32(bytes + 4, seq);
    usbip_put32(bytes + 20, unlinked);
    client_send(bytes, sizeof bytes);
}

/* The next answer is this one; its data, if it is of an URB in, stay at the beginning of `got`. */
static inline void expect(uint32_t code, uint32_t seq, int status, uint32_t actual, bool is_in)
{
    const size_t size = is_in ? actual : 0u;
    CHECK(wait_for(48u + size));
    CHECK_EQ(usbip_get32(got), code);
    CHECK_EQ(usbip_get32(got + 4), seq);
    CHECK_EQ((int)usbip_get32(got + 20), status);
    CHECK_EQ(usbip_get32(got + 24), actual);
    CHECK_EQ(usbip_get32(got + 32), code == RET_SUBMIT ? NO_ISO : 0u);
    forget_got(48);
}

static inline void expect_nothing(void)
{
    for (uint32_t i = 0; i < 10u; i++) {
        turn();
        CHECK(read_more());
        pause_1ms();
    }
    CHECK_EQ(got_size, 0);
}

/* The server ends the connection; what it has sent before is thrown away. */
static inline void expect_end(void)
{
    bool open = true;
    for (uint32_t i = 0; i < 3000u && open; i++) {
        turn();
        got_size = 0;
        open = read_more();
        if (open) {
            pause_1ms();
        }
    }
    CHECK(!open);
    (void)close(peer);
    peer = -1;
}

static inline void control_in(uint32_t seq, const uint8_t setup[8], int status, uint32_t actual)
{
    submit(seq, 0x80, 0, pw_get16(setup + 6), setup);
    expect(RET_SUBMIT, seq, status, actual, true);
    memcpy(in, got, actual);
    forget_got(actual);
}

static inline void control_out(uint32_t seq, const uint8_t setup[8], int status)
{
    submit(seq, 0x00, 0, 0, setup);
    expect(RET_SUBMIT, seq, status, 0, false);
}

static const uint8_t CONFIGURE[8] = {0x00, 9, 1, 0, 0, 0, 0, 0};
static const uint8_t FIRST_DESCRIPTOR[8] = {0x80, 6, 0, 1, 0, 0, 64, 0};
static const uint8_t WHOLE_DESCRIPTOR[8] = {0x80, 6, 0, 1, 0, 0, 18, 0};

/* Attached and configured by URB 1. */
static inline void start(bool high_speed)
{
    begin(high_speed, false);
    attach();
    control_out(1, CONFIGURE, 0);
}

static inline void stop(void)
{
    client_close();
    CHECK(!usb.configured);
}

static inline size_t put_blocks(uint8_t *bytes, uint32_t count)
{
    for (uint32_t i = 0; i < count; i++) {
        make_block(bytes + (size_t)i * PW_BLOCK, PW_NO_OP, 0);
    }
    return (size_t)count * PW_BLOCK;
}

#endif
