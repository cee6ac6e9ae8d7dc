#include "plays.h"

#include <stdlib.h>
#include <string.h>

void plays_keep(struct plays *self, uint64_t period, uint32_t words[PW_PROCESSORS][PW_TICKS])
{
    if (self->count == self->room) {
        const size_t room = self->room == 0u ? 256u : 2u * self->room;
        struct play *list = realloc(self->list, room * sizeof *list);
        if (list == NULL) {
            abort(); /* a test that has no memory has no result */
        }
        self->list = list;
        self->room = room;
    }
    struct play *play = &self->list[self->count];
    self->count++;
    play->period = period;
    memcpy(play->words, words, sizeof play->words);
}

/* The last play that began by a period. */
static size_t found(const struct plays *self, uint64_t period)
{
    size_t at = 0;
    size_t beyond = self->count;
    while (beyond - at > 1u) {
        const size_t middle = (at + beyond) / 2u;
        if (self->list[middle].period <= period) {
            at = middle;
        } else {
            beyond = middle;
        }
    }
    return at;
}

bool plays_read(const struct plays *self, uint64_t first, size_t periods, uint32_t *words)
{
    if (self->count == 0u) {
        return false;
    }
    size_t at = found(self, first);
    for (uint64_t period = first; period < first + periods; period++) {
        while (at + 1u < self->count && self->list[at + 1u].period <= period) {
            at++;
        }
        for (uint32_t tick = 0; tick < PW_TICKS; tick++) {
            for (uint32_t i = 0; i < PW_PROCESSORS; i++) {
                *words = self->list[at].words[i][tick];
                words++;
            }
        }
    }
    return true;
}
