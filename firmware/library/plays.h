/* What the ports have played since the device started, for whoever looks at it. */
#ifndef PLAYS_H
#define PLAYS_H

#include "boards.h"

/* What all ports play from a period on, until the next one that is kept. */
struct play {
    uint64_t period;
    uint32_t words[PW_PROCESSORS][PW_TICKS];
};

struct plays {
    struct play *list;
    size_t count, room;
};

void plays_keep(struct plays *self, uint64_t period, uint32_t words[PW_PROCESSORS][PW_TICKS]);
/* 50 ticks x 10 words of each period from `first` on. False if nothing was kept. */
bool plays_read(const struct plays *self, uint64_t first, size_t periods, uint32_t *words);

#endif
