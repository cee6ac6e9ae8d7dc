/* A serial line of the device as a connection: TCP on the loopback address, one at a time, or a pseudo-terminal. */
#ifndef SERIAL_H
#define SERIAL_H

#include <poll.h>

#include "ser.h"

#define SERIAL_BUFFER 4096u

struct serial {
    const char *path; /* of a pseudo-terminal: a link to it; NULL for TCP */
    int port;         /* of TCP */
    int listener;
    int connection;   /* or the master side of the pseudo-terminal; -1: none */
    bool connected;   /* somebody is there */
    struct pw_line line;
    /* Bytes that have arrived and that the line has not taken; bytes that the connection has not taken. */
    size_t in_first, in_size, out_first, out_size;
    uint8_t in[SERIAL_BUFFER];
    uint8_t out[SERIAL_BUFFER];
};

/* Whether a text is tcp:PORT or pty:PATH. */
bool serial_known(const char *text);
/* False: a line on stderr says why. */
bool serial_open(struct serial *self, const char *text);
void serial_close(struct serial *self);
/* What a host has to open, as text of at most `size` bytes. */
void serial_name(const struct serial *self, char *name, size_t size);
/* Power-up and RESET: the connection stays, as a UART's wires do; what it has brought is forgotten. */
void serial_begin(struct serial *self);
/* Take what has arrived, but no more than once in a tick: who has read an answer must find the next one later.
   `device` is NULL while it does not run: what arrives then is lost. */
void serial_receive(struct serial *self, struct pw_device *device);
/* Send what is there. */
void serial_send(struct serial *self, struct pw_device *device);
/* Whether all that the line has to say has left, or has nobody to go to. */
bool serial_idle(const struct serial *self);
/* What to wait for; returns whether there is something. */
bool serial_poll(const struct serial *self, struct pollfd *fd);

#endif
