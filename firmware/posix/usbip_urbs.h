/* The URBs of an attached client: they wait in a queue for each endpoint, are cut into packets, and are answered. */
#ifndef USBIP_URBS_H
#define USBIP_URBS_H

#include "usb.h"

#define USBIP_HEADER 48u
#define USBIP_QUEUES 8u

/* Numbers of Linux that travel. */
enum {
    USBIP_SHORT_NOT_OK = 0x01, USBIP_ZERO_PACKET = 0x40,
    USBIP_EPIPE = -32, USBIP_EPROTO = -71, USBIP_EOVERFLOW = -75, USBIP_ECONNRESET = -104, USBIP_EREMOTEIO = -121
};

/* Numbers of the wire are big-endian. */
static inline uint32_t usbip_get32(const uint8_t *at)
{
    return ((uint32_t)at[0] << 24) | ((uint32_t)at[1] << 16) | ((uint32_t)at[2] << 8) | at[3];
}

static inline void usbip_put16(uint8_t *at, uint32_t value)
{
    at[0] = (uint8_t)((value >> 8) & 0xFFu);
    at[1] = (uint8_t)(value & 0xFFu);
}

static inline void usbip_put32(uint8_t *at, uint32_t value)
{
    usbip_put16(at, value >> 16);
    usbip_put16(at + 2, value & 0xFFFFu);
}

struct urb {
    struct urb *next;
    uint32_t number;
    uint8_t endpoint; /* address, with bit 7 if it is in */
    bool begun;       /* of the control endpoint: it was answered with NAK */
    uint32_t flags;
    uint32_t iso;     /* sent back as it came */
    uint8_t setup[8];
    uint32_t size, done;
    uint32_t packets; /* of an OUT URB: how many are left */
    uint32_t room;    /* of `data` */
    uint8_t *data;
};

/* An UNLINK that came before the SUBMIT that it names. */
struct early {
    struct early *next;
    uint32_t number, unlinked;
};

struct urbs {
    struct pw_usb *usb;
    struct urb *first[USBIP_QUEUES]; /* by endpoint */
    struct urb *last[USBIP_QUEUES];
    uint32_t waiting;    /* URBs in all queues */
    uint64_t held;       /* bytes of their data */
    bool any;            /* a SUBMIT came on this connection */
    uint32_t newest;     /* and its number */
    struct early *early;
    bool asked_64;       /* half of what a port reset looks like */
    bool more;           /* something could be done at once */
    bool failed;         /* out of memory: the connection is to be ended */
    /* The time that packets of blocks take on the bus. */
    const uint64_t *tick; /* that it is; NULL: they take none */
    uint64_t bus_free;    /* when the bus is free for the next one, in BUS_PARTS of a tick */
    /* Answers that are to be sent. */
    uint8_t *out;
    size_t out_first, out_used, out_room;
};

void urbs_begin(struct urbs *urbs, struct pw_usb *usb);
/* The header of a SUBMIT has come: its URB, without its data; NULL if it is none or memory has run out. */
struct urb *urbs_new(struct urbs *urbs, const uint8_t header[USBIP_HEADER]);
/* It is complete. */
void urbs_submit(struct urbs *urbs, struct urb *urb);
void urbs_unlink(struct urbs *urbs, const uint8_t header[USBIP_HEADER]);
void urbs_carry_out(struct urbs *urbs);
/* The tick at which the bus can carry the next packet of a block; PW_NEVER if none waits for the bus. */
uint64_t urbs_due(const struct urbs *urbs);
void urbs_free(struct urb *urb);
void urbs_clear(struct urbs *urbs);

#endif
