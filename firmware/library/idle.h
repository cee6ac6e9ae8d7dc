/* Time that passes without anything but questions, answers and the sync line: all of that comes again after a while, so
   that a machine can leave it out, and hours cost nothing. */
#ifndef IDLE_H
#define IDLE_H

#include "boards.h"

/* A multiple of the time in which all are asked, and of that between two pulses of the sync line. */
#define IDLE_TICKS (102400u * (uint64_t)PW_TICKS)

/* Whether nothing else would happen for good. */
bool idle_is(const struct pw_device *device, const struct boards *boards);
/* Make it later by as many times IDLE_TICKS as fit. Returns the ticks that were left out. */
uint64_t idle_skip(struct pw_device *device, struct boards *boards, uint64_t most);

#endif
