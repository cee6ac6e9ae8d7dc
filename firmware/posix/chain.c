/* The chain: messages go to processors by their node; answers wait until the controller's call has returned. Links are
   never full here, so that every message arrives in the tick in which it left. */
#include "chain.h"

#include <string.h>

#define ROUTE 3u /* bytes of the header: CHN-002 */

void chain_begin(struct chain *self, const uint8_t firmware[3], const uint8_t unique_id[8])
{
    self->begun = false;
    self->started = 0;
    self->first_answer = 0;
    self->answer_count = 0;
    for (uint8_t i = 0; i < PW_PROCESSORS; i++) {
        uint8_t own_id[8];
        memcpy(own_id, unique_id, sizeof own_id);
        own_id[0] ^= (uint8_t)(i + 1u);
        pw_processor_begin(&self->processors[i], firmware, own_id);
    }
}

void chain_start_next(struct chain *self)
{
    self->started += self->started < PW_PROCESSORS ? 1u : 0u;
}

/* The first processor that has no number takes what is for node FFFF (CHN-022). PW_PROCESSORS: nobody is there. */
static uint32_t place_of(const struct chain *self, uint16_t node)
{
    uint32_t place = 0;
    while (place < self->started) {
        const uint8_t number = self->processors[place].number;
        if (node == PW_UNNUMBERED_NODE ? number == PW_NO_NUMBER : number == node) {
            return place;
        }
        place++;
    }
    return PW_PROCESSORS;
}

bool chain_send(struct chain *self, const uint8_t *message, size_t size)
{
    const uint16_t node = (uint16_t)(((uint32_t)message[0] << 8) | message[1]);
    const uint32_t place = place_of(self, node);
    if (place == PW_PROCESSORS || self->answer_count == CHAIN_ANSWERS) {
        return false;
    }
    struct chain_answer *answer = &self->answers[(self->first_answer + self->answer_count) % CHAIN_ANSWERS];
    const bool last = place == PW_PROCESSORS - 1u;
    answer->size = (uint8_t)pw_processor_message(&self->processors[place], message[2], message + ROUTE, size - ROUTE,
                                                 last, answer->message);
    if (answer->size != 0u) {
        self->answer_count++;
    }
    return true;
}

void chain_deliver(struct chain *self, struct pw_device *device)
{
    while (self->answer_count != 0u) {
        /* A copy, because the controller may ask again and so use the place. */
        const struct chain_answer taken = self->answers[self->first_answer];
        self->first_answer = (self->first_answer + 1u) % CHAIN_ANSWERS;
        self->answer_count--;
        pw_device_chain(device, taken.message[2], taken.message + ROUTE, taken.size - ROUTE);
    }
}

static void begin_period(struct chain *self, uint64_t period)
{
    self->period = period;
    self->changed = false;
    for (uint32_t i = 0; i < PW_PROCESSORS; i++) {
        if (pw_processor_period(&self->processors[i], period)) {
            self->changed = true;
        }
    }
}

void chain_sync(struct chain *self, uint64_t now)
{
    const bool first = !self->begun;
    if (first) {
        self->begun = true;
        self->origin = now;
    }
    for (uint32_t i = 0; i < PW_PROCESSORS; i++) {
        pw_processor_sync(&self->processors[i], now - self->origin);
    }
    if (first) {
        begin_period(self, 0);
    }
}

uint64_t chain_due(const struct chain *self)
{
    return self->begun ? self->origin + (self->period + 1u) * PW_TICKS : PW_NEVER;
}

void chain_period(struct chain *self)
{
    begin_period(self, self->period + 1u);
}
