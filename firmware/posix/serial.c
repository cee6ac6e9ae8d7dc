/* Serial lines. The end of a connection is a hang-up (SER-010): its last bytes are carried out first. */
#define _XOPEN_SOURCE 700
#include "serial.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <termios.h>
#include <unistd.h>

static bool complain(const char *text, const char *why)
{
    fprintf(stderr, "phasewire-reference: serial %s: %s\n", text, why);
    return false;
}

static bool starts_with(const char *text, const char *start)
{
    return strncmp(text, start, strlen(start)) == 0;
}

/* -1: no number of a port. */
static long port_of(const char *text)
{
    char *end;
    const long port = strtol(text, &end, 10);
    const bool digit = text[0] >= '0' && text[0] <= '9';
    return digit && *end == '\0' && port <= 65535 ? port : -1;
}

bool serial_known(const char *text)
{
    return (starts_with(text, "tcp:") && port_of(text + 4) >= 0) || (starts_with(text, "pty:") && text[4] != '\0');
}

static bool set_nonblocking(int file)
{
    const int flags = fcntl(file, F_GETFL);
    return flags >= 0 && fcntl(file, F_SETFL, flags | O_NONBLOCK) == 0 && fcntl(file, F_SETFD, FD_CLOEXEC) == 0;
}

/* TCP ------------------------------------------------------------------------------------------------------------- */

static bool listen_on(struct serial *self, uint16_t port)
{
    struct sockaddr_in address;
    socklen_t size = sizeof address;
    const int on = 1;
    memset(&address, 0, sizeof address);
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    self->listener = socket(AF_INET, SOCK_STREAM, 0);
    if (self->listener < 0 || setsockopt(self->listener, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on) != 0
        || bind(self->listener, (struct sockaddr *)&address, sizeof address) != 0 || listen(self->listener, 128) != 0
        || !set_nonblocking(self->listener) || getsockname(self->listener, (struct sockaddr *)&address, &size) != 0) {
        return false;
    }
    self->port = ntohs(address.sin_port);
    return true;
}

static void accept_next(struct serial *self)
{
    const int on = 1;
    const int connection = accept(self->listener, NULL, NULL);
    if (connection < 0) {
        return;
    }
    if (!set_nonblocking(connection)) {
        (void)close(connection);
        return;
    }
    (void)setsockopt(connection, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    self->connection = connection;
    self->connected = true;
}

/* Pseudo-terminals ------------------------------------------------------------------------------------------------ */

/* Bytes as they are: the device echoes by itself. */
static bool make_raw(int terminal)
{
    struct termios mode;
    if (tcgetattr(terminal, &mode) != 0) {
        return false;
    }
    mode.c_iflag &= (tcflag_t)~(tcflag_t)(IGNBRK | BRKINT | PARMRK | ISTRIP | INLCR | IGNCR | ICRNL | IXON | IXOFF);
    mode.c_oflag &= (tcflag_t)~(tcflag_t)OPOST;
    mode.c_lflag &= (tcflag_t)~(tcflag_t)(ECHO | ECHONL | ICANON | ISIG | IEXTEN);
    mode.c_cflag &= (tcflag_t)~(tcflag_t)(CSIZE | PARENB);
    mode.c_cflag |= CS8;
    return tcsetattr(terminal, TCSANOW, &mode) == 0;
}

/* The link keeps its name; what it leads to has another one each time. Only a link is replaced, never a file. */
static bool make_link(const struct serial *self, const char *terminal)
{
    struct stat about;
    if (lstat(self->path, &about) == 0 && S_ISLNK(about.st_mode)) {
        (void)unlink(self->path);
    }
    return symlink(terminal, self->path) == 0;
}

static bool open_terminal(struct serial *self)
{
    self->connection = posix_openpt(O_RDWR | O_NOCTTY);
    if (self->connection < 0 || grantpt(self->connection) != 0 || unlockpt(self->connection) != 0
        || !make_raw(self->connection) || !set_nonblocking(self->connection)) {
        return false;
    }
    const char *terminal = ptsname(self->connection);
    return terminal != NULL && make_link(self, terminal);
}

/* What the last host has not read must not reach the next one. It stands behind the other end of the terminal. */
static void forget_unread(struct serial *self)
{
    (void)tcflush(self->connection, TCIOFLUSH);
    const int terminal = open(self->path, O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
    if (terminal >= 0) {
        (void)tcflush(terminal, TCIFLUSH);
        (void)close(terminal);
    }
}

/* Both ------------------------------------------------------------------------------------------------------------ */

bool serial_open(struct serial *self, const char *text)
{
    memset(self, 0, sizeof *self);
    self->listener = -1;
    self->connection = -1;
    if (starts_with(text, "pty:")) {
        self->path = text + 4;
        return open_terminal(self) || complain(text, strerror(errno));
    }
    return listen_on(self, (uint16_t)port_of(text + 4)) || complain(text, strerror(errno));
}

void serial_close(struct serial *self)
{
    if (self->connection >= 0) {
        (void)close(self->connection);
    }
    if (self->listener >= 0) {
        (void)close(self->listener);
    }
    if (self->path != NULL) {
        (void)unlink(self->path);
    }
    self->connection = -1;
    self->listener = -1;
}

void serial_name(const struct serial *self, char *name, size_t size)
{
    if (self->path != NULL) {
        (void)snprintf(name, size, "%s", self->path);
    } else {
        (void)snprintf(name, size, "socket://127.0.0.1:%d", self->port);
    }
}

void serial_begin(struct serial *self)
{
    self->in_size = 0;
    self->out_size = 0;
}

/* The connection has ended. */
static void hang_up(struct serial *self, struct pw_device *device)
{
    if (device != NULL) {
        pw_line_finish(&self->line, device, self->in + self->in_first, self->in_size);
    }
    self->in_size = 0;
    self->out_size = 0;
    self->connected = false;
    if (self->path == NULL) {
        (void)close(self->connection);
        self->connection = -1;
    } else {
        forget_unread(self);
        (void)make_raw(self->connection);
    }
}

/* Returns whether bytes came. */
static bool read_some(struct serial *self, struct pw_device *device)
{
    const ssize_t count = read(self->connection, self->in, SERIAL_BUFFER);
    if (count > 0) {
        self->connected = true;
        self->in_first = 0;
        self->in_size = (size_t)count;
        return true;
    }
    if (count < 0 && (errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR)) {
        self->connected = true;
        return false;
    }
    /* A pseudo-terminal says so all the time while nobody has it open. */
    if (self->connected) {
        hang_up(self, device);
    }
    return false;
}

/* Nobody takes answers any more. What has arrived is still carried out, up to the end that reading finds. */
static void note_end(struct serial *self)
{
    struct pollfd fd = {self->connection, 0, 0};
    if (poll(&fd, 1, 0) == 1 && (fd.revents & (POLLHUP | POLLERR)) != 0) {
        self->line.muted = true;
    }
}

void serial_receive(struct serial *self, struct pw_device *device)
{
    if (self->connection < 0) {
        accept_next(self);
    }
    if (self->connection >= 0 && (self->in_size != 0u || read_some(self, device))) {
        const size_t taken = device == NULL ? self->in_size
                                            : pw_line_receive(&self->line, device, self->in + self->in_first,
                                                              self->in_size);
        self->in_first += taken;
        self->in_size -= taken;
        if (self->in_size != 0u) {
            note_end(self);
        }
    }
}

void serial_send(struct serial *self, struct pw_device *device)
{
    bool sent = true;
    while (sent && self->connected) {
        if (self->out_size == 0u && device != NULL) {
            self->out_first = 0;
            self->out_size = pw_line_send(&self->line, device, self->out, SERIAL_BUFFER);
        }
        sent = false;
        if (self->out_size != 0u) {
            const ssize_t count = write(self->connection, self->out + self->out_first, self->out_size);
            sent = count > 0;
            self->out_first += sent ? (size_t)count : 0u;
            self->out_size -= sent ? (size_t)count : 0u;
        }
    }
}

bool serial_idle(const struct serial *self)
{
    return !self->connected || (self->out_size == 0u && pw_line_idle(&self->line));
}

bool serial_poll(const struct serial *self, struct pollfd *fd)
{
    const int in = self->in_size == 0u ? POLLIN : 0;
    const int out = self->out_size != 0u ? POLLOUT : 0;
    if (self->connection < 0) {
        fd->fd = self->listener;
        fd->events = POLLIN;
        return true;
    }
    fd->fd = self->connection;
    fd->events = (short)(in | out);
    return self->connected && fd->events != 0;
}
