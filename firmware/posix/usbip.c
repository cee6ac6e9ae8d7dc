/* The USB/IP server: connections, the way to an attachment, commands as they come. */
#define _POSIX_C_SOURCE 200809L
#include "usbip.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "ser.h"
#include "usbip_device.h"
#include "usbip_urbs.h"

#define VERSION 0x0111u
enum { REQ_DEVLIST = 0x8005, REQ_IMPORT = 0x8003, REP_DEVLIST = 0x0005, REP_IMPORT = 0x0003 };
enum { CMD_SUBMIT = 1, CMD_UNLINK = 2 };
enum { ST_OK = 0, ST_DEV_BUSY = 2, ST_NODEV = 4 };
#define OP_HEADER 8u
#define OP_IMPORT (OP_HEADER + USBIP_BUS_ID)
#define COMMANDS 65536u
#define MOST_HELD (64u << 20)   /* bytes of URBs; more are left in the socket */
#define READS_AT_ONCE 16u
#define GUEST_SECONDS 5

struct usbip {
    struct pw_usb *usb;
    char bus_id[USBIP_BUS_ID];
    int port;
    int listener;
    /* A connection that has not said what it wants. */
    int guest;
    time_t guest_since;
    size_t guest_used;
    uint8_t guest_bytes[OP_IMPORT];
    /* The attached client. */
    int client;
    struct urbs urbs;
    struct urb *filling; /* an OUT URB, and how much of its data is there */
    uint32_t filled;
    size_t used;
    uint8_t commands[COMMANDS];
};

static time_t seconds(void)
{
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec;
}

static bool set_non_blocking(int fd)
{
    const int flags = fcntl(fd, F_GETFL, 0);
    return flags >= 0 && fcntl(fd, F_SETFL, flags | O_NONBLOCK) == 0 && fcntl(fd, F_SETFD, FD_CLOEXEC) == 0;
}

/* Whether a read or write that failed may be tried later. */
static bool is_later(void)
{
    return errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR;
}

/* Opening ------------------------------------------------------------------------------------------------------ */

static int listen_on(const char *address, uint16_t port)
{
    struct sockaddr_in at;
    const int yes = 1;
    memset(&at, 0, sizeof at);
    at.sin_family = AF_INET;
    at.sin_port = htons(port);
    if (inet_pton(AF_INET, address, &at.sin_addr) != 1) {
        errno = EINVAL;
        return -1;
    }
    const int fd = socket(AF_INET, SOCK_STREAM, 0);
    if (fd < 0) {
        return -1;
    }
    (void)setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    if (bind(fd, (const struct sockaddr *)&at, sizeof at) != 0 || listen(fd, 4) != 0 || !set_non_blocking(fd)) {
        const int error = errno;
        (void)close(fd);
        errno = error;
        return -1;
    }
    return fd;
}

struct usbip *usbip_open(const char *address, uint16_t port, struct pw_usb *usb, const char *bus_id)
{
    struct sockaddr_in at;
    socklen_t size = sizeof at;
    struct usbip *server = calloc(1, sizeof *server);
    if (server == NULL) {
        return NULL;
    }
    server->usb = usb;
    server->guest = -1;
    server->client = -1;
    urbs_begin(&server->urbs, usb);
    (void)strncpy(server->bus_id, bus_id == NULL ? "1-1" : bus_id, USBIP_BUS_ID - 1u);
    server->listener = listen_on(address, port);
    if (server->listener < 0 || getsockname(server->listener, (struct sockaddr *)&at, &size) != 0) {
        usbip_close(server);
        return NULL;
    }
    server->port = ntohs(at.sin_port);
    return server;
}

int usbip_port(const struct usbip *server)
{
    return server->port;
}

/* Guests ------------------------------------------------------------------------------------------------------- */

static void end_guest(struct usbip *server)
{
    if (server->guest >= 0) {
        (void)close(server->guest);
    }
    server->guest = -1;
    server->guest_used = 0;
}

static void accept_guest(struct usbip *server)
{
    if (server->guest >= 0) {
        return;
    }
    const int fd = accept(server->listener, NULL, NULL);
    if (fd < 0) {
        return;
    }
    const int yes = 1;
    (void)setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
    server->guest = fd;
    server->guest_used = 0;
    server->guest_since = seconds();
    if (!set_non_blocking(fd)) {
        end_guest(server);
    }
}

/* An answer is small and the first on its connection: the socket has room for it. */
static bool send_guest(const struct usbip *server, const uint8_t *bytes, size_t size)
{
    const ssize_t sent = send(server->guest, bytes, size, MSG_NOSIGNAL);
    return sent >= 0 && (size_t)sent == size;
}

static void put_op(uint8_t *to, uint32_t code, uint32_t status)
{
    usbip_put16(to, VERSION);
    usbip_put16(to + 2, code);
    usbip_put32(to + 4, status);
}

/* A client that comes while the device is leaving would meet it as it was, and lose it. */
static bool offers_device(const struct usbip *server)
{
    return server->usb->attached && usbip_leaves(server->usb) == PW_STAY;
}

static void send_devices(struct usbip *server)
{
    uint8_t bytes[OP_HEADER + 4u + USBIP_DEVICE + 4u * USBIP_INTERFACES];
    size_t size = OP_HEADER + 4u;
    put_op(bytes, REP_DEVLIST, ST_OK);
    usbip_put32(bytes + OP_HEADER, offers_device(server) ? 1u : 0u);
    if (offers_device(server)) {
        usbip_put_device(server->usb, server->bus_id, bytes + size);
        size += USBIP_DEVICE;
        size += usbip_put_interfaces(server->usb, bytes + size);
    }
    (void)send_guest(server, bytes, size);
    end_guest(server);
}

static void import(struct usbip *server)
{
    uint8_t bytes[OP_HEADER + USBIP_DEVICE];
    const bool named = strncmp((const char *)server->guest_bytes + OP_HEADER, server->bus_id, USBIP_BUS_ID) == 0;
    if (!named || !offers_device(server) || server->client >= 0) {
        put_op(bytes, REP_IMPORT, named && server->client >= 0 ? ST_DEV_BUSY : ST_NODEV);
        (void)send_guest(server, bytes, OP_HEADER);
        end_guest(server);
        return;
    }
    put_op(bytes, REP_IMPORT, ST_OK);
    usbip_put_device(server->usb, server->bus_id, bytes + OP_HEADER);
    if (!send_guest(server, bytes, sizeof bytes)) {
        end_guest(server);
        return;
    }
    server->client = server->guest;
    server->guest = -1;
    server->used = 0;
    urbs_begin(&server->urbs, server->usb);
    pw_usb_bus_reset(server->usb);
}

static void serve_guest(struct usbip *server)
{
    const size_t wanted = server->guest_used < OP_HEADER ? OP_HEADER : OP_IMPORT;
    const ssize_t size = recv(server->guest, server->guest_bytes + server->guest_used, wanted - server->guest_used, 0);
    if (size <= 0) {
        const bool waits = size < 0 && is_later() && seconds() - server->guest_since < GUEST_SECONDS;
        if (!waits) {
            end_guest(server);
        }
        return;
    }
    server->guest_used += (size_t)size;
    if (server->guest_used < OP_HEADER) {
        return;
    }
    const uint32_t head = usbip_get32(server->guest_bytes);
    if (head == ((VERSION << 16) | REQ_DEVLIST)) {
        send_devices(server);
    } else if (head != ((VERSION << 16) | REQ_IMPORT)) {
        end_guest(server);
    } else if (server->guest_used == OP_IMPORT) {
        import(server);
    } else {
        /* The bus id is still to come. */
    }
}

/* The attached client ------------------------------------------------------------------------------------------ */

static void end_client(struct usbip *server)
{
    if (server->client < 0) {
        return;
    }
    (void)close(server->client);
    server->client = -1;
    urbs_free(server->filling);
    server->filling = NULL;
    urbs_clear(&server->urbs);
}

/* The client has gone, and with it the voltage of the bus. */
static void unplug(struct usbip *server)
{
    end_client(server);
    if (server->usb->attached) {
        pw_usb_unplugged(server->usb);
    }
}

/* A header has come. False: it is no command. */
static bool take_command(struct usbip *server, const uint8_t *header)
{
    const uint32_t code = usbip_get32(header);
    if (code == CMD_UNLINK) {
        urbs_unlink(&server->urbs, header);
        return true;
    }
    if (code != CMD_SUBMIT) {
        return false;
    }
    struct urb *urb = urbs_new(&server->urbs, header);
    if (urb == NULL) {
        return false;
    }
    if (urb->data != NULL) {
        server->filling = urb;
        server->filled = 0;
    } else {
        urbs_submit(&server->urbs, urb);
    }
    return true;
}

/* Data of an OUT URB; returns how many bytes are its own. */
static size_t fill(struct usbip *server, const uint8_t *bytes, size_t size)
{
    struct urb *urb = server->filling;
    const size_t left = urb->size - server->filled;
    const size_t taken = size < left ? size : left;
    memcpy(urb->data + server->filled, bytes, taken);
    server->filled += (uint32_t)taken;
    if (server->filled == urb->size) {
        server->filling = NULL;
        urbs_submit(&server->urbs, urb);
    }
    return taken;
}

/* Takes the commands that are there. False: the client does not keep to the protocol. */
static bool take_commands(struct usbip *server)
{
    size_t at = 0;
    bool good = true;
    bool enough = true;
    while (good && enough) {
        const size_t left = server->used - at;
        if (server->filling != NULL) {
            enough = left != 0u;
            at += enough ? fill(server, server->commands + at, left) : 0u;
        } else {
            enough = left >= USBIP_HEADER;
            good = !enough || take_command(server, server->commands + at);
            at += enough ? USBIP_HEADER : 0u;
        }
    }
    server->used -= at;
    memmove(server->commands, server->commands + at, server->used);
    return good;
}

/* Returns whether the connection goes on. */
static bool read_commands(struct usbip *server)
{
    bool goes_on = true;
    bool more = true;
    for (uint32_t i = 0; i < READS_AT_ONCE && goes_on && more && server->urbs.held < MOST_HELD; i++) {
        const size_t room = COMMANDS - server->used;
        const ssize_t size = recv(server->client, server->commands + server->used, room, 0);
        if (size <= 0) {
            goes_on = size < 0 && is_later();
            more = false;
        } else {
            server->used += (size_t)size;
            more = (size_t)size == room;
            goes_on = take_commands(server);
        }
    }
    return goes_on;
}

static bool write_answers(struct usbip *server)
{
    struct urbs *urbs = &server->urbs;
    while (urbs->out_used != 0u) {
        const ssize_t size = send(server->client, urbs->out + urbs->out_first, urbs->out_used, MSG_NOSIGNAL);
        if (size <= 0) {
            return size < 0 && is_later();
        }
        urbs->out_first += (size_t)size;
        urbs->out_used -= (size_t)size;
    }
    urbs->out_first = 0;
    return true;
}

/* The calls of the main loop ----------------------------------------------------------------------------------- */

int usbip_fds(const struct usbip *server, struct pollfd *fds)
{
    int count = 0;
    if (server->guest < 0) {
        fds[count].fd = server->listener;
        fds[count].events = POLLIN;
        count++;
    } else {
        fds[count].fd = server->guest;
        fds[count].events = POLLIN;
        count++;
    }
    if (server->client >= 0) {
        const bool reads = server->urbs.held < MOST_HELD;
        const bool writes = server->urbs.out_used != 0u;
        fds[count].fd = server->client;
        fds[count].events = (short)((reads ? POLLIN : 0) | (writes ? POLLOUT : 0));
        count++;
    }
    for (int i = 0; i < count; i++) {
        fds[i].revents = 0;
    }
    return count;
}

void usbip_clock(struct usbip *server, const uint64_t *tick)
{
    server->urbs.tick = tick;
}

uint64_t usbip_due(const struct usbip *server)
{
    return server->client < 0 ? PW_NEVER : urbs_due(&server->urbs);
}

void usbip_work(struct usbip *server)
{
    if (server->usb->attached) {
        pw_usb_poll(server->usb);
    }
    if (server->client < 0) {
        return;
    }
    if (!server->usb->attached) {
        end_client(server);
        return;
    }
    urbs_carry_out(&server->urbs);
    if (server->urbs.failed || !write_answers(server)) {
        unplug(server);
        return;
    }
    /* REQ-013: it leaves once RESET has been answered, also on the console's line, so that no request behind that one
       meets the device as it was. If the answer is not read, the device leaves in its own time. */
    const enum pw_leave leave = usbip_leaves(server->usb);
    const bool answered = server->urbs.out_used == 0u && (server->usb->line == NULL || pw_line_idle(server->usb->line));
    if ((leave == PW_LEAVE_RESET || leave == PW_LEAVE_REVERT) && answered) {
        usbip_leave(server);
    }
}

void usbip_serve(struct usbip *server)
{
    accept_guest(server);
    if (server->guest >= 0) {
        serve_guest(server);
    }
    if (server->client >= 0 && !read_commands(server)) {
        unplug(server);
    }
    usbip_work(server);
}

bool usbip_wants_step(const struct usbip *server)
{
    return server->client >= 0 && server->urbs.more;
}

void usbip_leave(struct usbip *server)
{
    server->usb->attached = false;
    if (server->client < 0) {
        return;
    }
    /* What was answered goes out. A socket closed with unread bytes would reset the connection and lose that. */
    (void)write_answers(server);
    (void)shutdown(server->client, SHUT_WR);
    while (recv(server->client, server->commands, COMMANDS, 0) > 0) {
        server->used = 0;
    }
    end_client(server);
}

void usbip_close(struct usbip *server)
{
    if (server == NULL) {
        return;
    }
    end_client(server);
    end_guest(server);
    if (server->listener >= 0) {
        (void)close(server->listener);
    }
    free(server);
}
