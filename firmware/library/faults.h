/* What is wrong with a device's surroundings and parts: a list, which the boards and the flash look up as they go. A
   fault is there from one tick to another, whatever the device does, so that it outlives RESET and power as in life. */
#ifndef FAULTS_H
#define FAULTS_H

#include "chn.h"
#include "library.h"

#define FAULTS_MOST 256u

struct faults {
    uint32_t count;
    struct machine_fault list[FAULTS_MOST];
};

/* Adds one, and forgets those that are over. False if there are too many. */
bool faults_add(struct faults *self, const struct machine_fault *fault, uint64_t now);
/* The next one of a kind that is there now, after another one, or the first after NULL; NULL if there is none. */
struct machine_fault *faults_next(struct faults *self, uint64_t now, enum machine_trouble kind,
                                  const struct machine_fault *after);
/* Of those of a kind that are there at a processor the one that began last: it is what counts. */
const struct machine_fault *faults_newest(struct faults *self, uint64_t now, enum machine_trouble kind, uint32_t place);
/* Ticks by which a processor's clock is ahead, if all of them were right at a tick. */
int64_t faults_clock(const struct faults *self, uint64_t since, uint64_t now, uint32_t place);

/* A message, route header first, without END. */
struct message {
    bool ends; /* END follows */
    uint32_t size;
    uint8_t bytes[PW_MESSAGE + 1u];
};
/* Damages a message to or from a processor. */
void faults_damage(struct faults *self, uint64_t now, uint32_t place, struct message *message);

#endif
