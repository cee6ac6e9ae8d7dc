/* The boards behind the controller: ten processors, their links, the sync line and what is wrong with them. A link
   sends a message in no time, unless it is slow. */
#ifndef BOARDS_H
#define BOARDS_H

#include "device.h"
#include "faults.h"
#include "processor.h"

#define BOARDS_WAITING 256u /* messages on their way, in each direction */
#define BOARDS_ROUTE 200u   /* bytes that a route keeps: three messages without END between them */

/* A route that was opened by a header, and stays until END comes. */
struct route {
    bool open;
    uint32_t size;
    uint8_t bytes[BOARDS_ROUTE];
};

/* Messages in the order in which they arrive. */
struct way {
    struct route route;
    uint64_t busy_until; /* tick at which the last one has arrived */
    uint32_t first, count;
    struct arrival {
        uint64_t tick;
        struct route route;
    } arrivals[BOARDS_WAITING];
};

struct boards {
    struct faults *faults;
    uint64_t powered_at;
    bool begun;       /* period 0 has */
    uint64_t origin;  /* tick at which it did */
    uint64_t period;  /* that has begun */
    bool changed;     /* words of this period differ from those of the one before */
    uint32_t words[PW_PROCESSORS][PW_TICKS]; /* what the ports play */
    uint32_t late[PW_PROCESSORS];            /* periods for which words have not been ready */
    bool blocked;     /* a message could not leave, and none behind it can (CHN-021) */
    struct way down, up;
    uint32_t started; /* processors whose program runs */
    struct pw_processor processors[PW_PROCESSORS];
};

/* Power-up of all processors together (CHN-021). */
void boards_begin(struct boards *self, struct faults *faults, uint64_t now, const uint8_t firmware[3],
                  const uint8_t unique_id[8]);
/* The next processor has got its program. False: it does not take it. */
bool boards_start_next(struct boards *self, uint64_t now);
/* A message of the controller, route header first. False: it could not leave within 1 ms. */
bool boards_send(struct boards *self, uint64_t now, const uint8_t *message, size_t size);
/* Deliver what has arrived by now in both directions; not from within a call of the port. Returns whether the
   controller got something. */
bool boards_deliver(struct boards *self, uint64_t now, struct pw_device *device);
/* A pulse on the sync line; period 0 begins with the first. */
void boards_sync(struct boards *self, uint64_t now);
/* The tick at which the next period begins, or at which the next message arrives; PW_NEVER if none does. */
uint64_t boards_period_due(const struct boards *self);
uint64_t boards_message_due(const struct boards *self);
/* The next period begins, on all processors at once. Call it before the controller works on the same tick. */
void boards_period(struct boards *self, uint64_t now);

#endif
