/* The chain behind the controller: ten processors in this process, their links and the sync line. */
#ifndef CHAIN_H
#define CHAIN_H

#include "device.h"
#include "processor.h"

#define CHAIN_ANSWERS 64u /* that wait; the device asks for ten at most before it takes them */

struct chain_answer {
    uint8_t size;
    uint8_t message[PW_MESSAGE];
};

struct chain {
    bool begun;       /* period 0 has */
    uint64_t origin;  /* tick of the port at which it did */
    uint64_t period;  /* that has begun */
    bool changed;     /* words of this period differ from those of the one before */
    uint32_t first_answer, answer_count;
    struct chain_answer answers[CHAIN_ANSWERS];
    uint32_t started; /* processors whose program runs */
    struct pw_processor processors[PW_PROCESSORS];
};

/* Power-up of all processors together (CHN-021). */
void chain_begin(struct chain *self, const uint8_t firmware[3], const uint8_t unique_id[8]);
/* The next processor has got its program. */
void chain_start_next(struct chain *self);
/* A message of the controller, route header first. False: nobody takes it, so that it blocks the chain. */
bool chain_send(struct chain *self, const uint8_t *message, size_t size);
/* A pulse on the sync line; period 0 begins with the first. */
void chain_sync(struct chain *self, uint64_t now);
/* The tick of the port at which the next period begins; PW_NEVER before period 0. */
uint64_t chain_due(const struct chain *self);
/* That period begins, on all processors at once. Call it before the controller works on the same tick. */
void chain_period(struct chain *self);
/* Give answers to the controller until none waits, not from within a call of the port. */
void chain_deliver(struct chain *self, struct pw_device *device);

#endif
