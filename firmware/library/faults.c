/* The list of faults, and the damage of messages. */
#include "faults.h"

#include <string.h>

#define CHANNEL_END 2u /* place in the route header: CHN-002 */
#define BILLION 1000000000

bool faults_add(struct faults *self, const struct machine_fault *fault, uint64_t now)
{
    uint32_t kept = 0;
    for (uint32_t i = 0; i < self->count; i++) {
        const struct machine_fault *old = &self->list[i];
        /* What a clock has lost or gained stays. */
        if (old->times != 0u && (old->end > now || old->kind == MACHINE_CLOCK)) {
            self->list[kept] = *old;
            kept++;
        }
    }
    self->count = kept;
    if (kept == FAULTS_MOST) {
        return false;
    }
    self->list[kept] = *fault;
    self->count++;
    return true;
}

struct machine_fault *faults_next(struct faults *self, uint64_t now, enum machine_trouble kind,
                                  const struct machine_fault *after)
{
    for (uint32_t i = after == NULL ? 0u : (uint32_t)(after - self->list) + 1u; i < self->count; i++) {
        struct machine_fault *fault = &self->list[i];
        if (fault->kind == (uint32_t)kind && fault->begin <= now && now < fault->end && fault->times != 0u) {
            return fault;
        }
    }
    return NULL;
}

static bool is_at(const struct machine_fault *fault, uint32_t place)
{
    return (fault->places & ((uint32_t)1u << place)) != 0u;
}

const struct machine_fault *faults_newest(struct faults *self, uint64_t now, enum machine_trouble kind, uint32_t place)
{
    const struct machine_fault *newest = NULL;
    const struct machine_fault *fault = faults_next(self, now, kind, NULL);
    while (fault != NULL) {
        if (is_at(fault, place) && (newest == NULL || fault->begin >= newest->begin)) {
            newest = fault;
        }
        fault = faults_next(self, now, kind, fault);
    }
    return newest;
}

int64_t faults_clock(const struct faults *self, uint64_t since, uint64_t now, uint32_t place)
{
    int64_t billionths = 0;
    for (uint32_t i = 0; i < self->count; i++) {
        const struct machine_fault *fault = &self->list[i];
        const uint64_t begin = fault->begin < since ? since : fault->begin;
        const uint64_t end = fault->end < now ? fault->end : now;
        if (fault->kind == (uint32_t)MACHINE_CLOCK && is_at(fault, place) && begin < end) {
            billionths += (int64_t)(end - begin) * fault->value;
        }
    }
    const int64_t ticks = billionths / BILLION;
    return billionths < ticks * BILLION ? ticks - 1 : ticks; /* a counter shows whole ticks */
}

/* Messages ----------------------------------------------------------------------------------------------------- */

static void lose(struct message *message, uint32_t token)
{
    if (token >= message->size) {
        message->ends = false;
        return;
    }
    message->size--;
    memmove(&message->bytes[token], &message->bytes[token + 1u], message->size - token);
}

static void repeat(struct message *message, uint32_t token)
{
    if (token < message->size) {
        memmove(&message->bytes[token + 1u], &message->bytes[token], message->size - token);
        message->size++;
    }
}

static void flip(struct message *message, uint32_t token, int32_t bit)
{
    if (token < message->size) {
        message->bytes[token] ^= (uint8_t)(1u << (uint32_t)bit);
    }
}

void faults_damage(struct faults *self, uint64_t now, uint32_t place, struct message *message)
{
    static const enum machine_trouble KINDS[] = {MACHINE_LOST_TOKEN, MACHINE_DOUBLED_TOKEN, MACHINE_FLIPPED_BIT};
    const uint8_t channel_end = message->bytes[CHANNEL_END];
    const uint32_t size = message->size;
    for (uint32_t i = 0; i < 3u; i++) {
        struct machine_fault *fault = faults_next(self, now, KINDS[i], NULL);
        while (fault != NULL) {
            /* A message that is not whole any more is none of these. */
            if (is_at(fault, place) && fault->what == (int32_t)channel_end && message->size == size && message->ends) {
                fault->times--;
                const uint32_t token = (uint32_t)fault->where;
                if (KINDS[i] == MACHINE_LOST_TOKEN) {
                    lose(message, token);
                } else if (KINDS[i] == MACHINE_DOUBLED_TOKEN) {
                    repeat(message, token);
                } else {
                    flip(message, token, fault->value);
                }
            }
            fault = faults_next(self, now, KINDS[i], fault);
        }
    }
}
