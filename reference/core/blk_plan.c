/* Chapter BLK: the queue of changes, and when each goes onto the chain and takes effect.

   The controller works once a period, at its beginning. A change for period P takes effect everywhere if its slices
   leave in the period P - 2 and its commits, or its programs, in P - 1: no earlier than the table before it has begun
   to play (CHN-007), and early enough to be rasterised (BUD-003). No two changes have the same period (BLK-007). */
#include "device_parts.h"

#include <string.h>

#define SYNC_PERIODS 4096u
#define SLICE_TOKENS 52u
#define COMMIT_TOKENS 16u
#define PROGRAM_TOKENS 25u
/* Loads that leave in any period, however full it is: after slices, commits and programs of ten each. */
#define LEAST_LOADS 5u

struct pw_change *pw_change_at(struct pw_device *self, uint32_t index)
{
    return &self->changes[(self->first_change + index) % PW_CHANGES];
}

static const struct pw_change *change_at(const struct pw_device *self, uint32_t index)
{
    return &self->changes[(self->first_change + index) % PW_CHANGES];
}

struct pw_change *pw_change_add(struct pw_device *self)
{
    struct pw_change *change = pw_change_at(self, self->change_count);
    memset(change, 0, sizeof *change);
    change->ends = PW_NEVER;
    self->change_count++;
    return change;
}

uint8_t pw_free_places(const struct pw_device *self)
{
    if (self->store_count == PW_QUEUE_STORES || self->use_count == PW_USES) {
        return 0;
    }
    uint32_t queued = 0;
    for (uint32_t i = 0; i < self->change_count; i++) {
        const struct pw_change *change = change_at(self, i);
        if (!change->on_chain && !change->silent) {
            queued++;
        }
    }
    return (uint8_t)(PW_QUEUE_CHANGES - queued);
}

bool pw_device_has_room(const struct pw_device *self)
{
    return pw_free_places(self) != 0u;
}

uint64_t pw_first_period(const struct pw_device *self, bool after_stores)
{
    const uint64_t sorted = (self->now + PW_SORT_TICKS + PW_TICKS - 1u) / PW_TICKS;
    uint64_t first = sorted + 2u;
    const uint32_t loads = after_stores ? pw_loads_left(self) : 0u;
    if (loads != 0u) {
        /* The programs follow the last load (CHN-019), which has left in this period at the latest. */
        const uint64_t last_load = pw_period_now(self) + (loads + LEAST_LOADS - 1u) / LEAST_LOADS;
        if (first < last_load + 2u) {
            first = last_load + 2u;
        }
    }
    if (first <= self->last_period) {
        first = self->last_period + 1u;
    }
    return first;
}

uint64_t pw_period_due(const struct pw_device *self)
{
    const uint64_t next = self->worked + 1u;
    uint64_t period = (self->worked / SYNC_PERIODS + 1u) * SYNC_PERIODS;
    if (self->sequence_ends < period) {
        period = self->sequence_ends;
    }
    if (self->change_count != 0u && change_at(self, 0)->period - 2u < period) {
        period = change_at(self, 0)->period - 2u;
    }
    if (self->store_count != 0u) {
        period = next;
    }
    return period < next ? next : period;
}

/* Taking effect ------------------------------------------------------------------------------------------------ */

static void play(struct pw_device *self, const struct pw_change *change)
{
    self->plays = true;
    self->plays_sequence = change->kind == PW_SEQUENCE;
    self->since_period = change->period;
    self->sequence_ends = change->ends;
    pw_event(self, (change->flags & PW_UNATTENDED) != 0u ? PW_EVENT_PLAY_UNATTENDED : PW_EVENT_PLAY, change->door);
}

static void stop_playing(struct pw_device *self)
{
    self->plays = false;
    self->plays_sequence = false;
    self->since_period = 0;
    self->sequence_ends = PW_NEVER;
}

static void take_effect(struct pw_device *self, const struct pw_change *change)
{
    if (change->silent) {
        return; /* the state was left when it was ordered */
    }
    switch (change->kind) {
    case PW_UPDATE:
    case PW_SEQUENCE:
        play(self, change);
        break;
    case PW_MODULATION:
        self->modulates = true;
        break;
    default: /* OUTPUT */
        self->modulates = false;
        if (change->action == PW_SILENCE) {
            stop_playing(self);
            pw_event(self, PW_EVENT_END, change->door);
        } else if (change->action == PW_DISABLE) {
            stop_playing(self); /* the outputs are silent from here on: what was accepted later is only dropped */
            pw_event(self, PW_EVENT_DISABLE, change->door);
        } else {
            /* END_MODULATION leaves what plays as it is. */
        }
        break;
    }
}

/* Whether a change ends what plays, so that a sequence that is over at the same time has no end of its own (STA-002). */
static bool replaces(const struct pw_change *change)
{
    const bool modulation = change->kind == PW_MODULATION
        || (change->kind == PW_OUTPUT && change->action == PW_END_MODULATION);
    return !change->silent && !modulation;
}

static void effects(struct pw_device *self, uint64_t period)
{
    const bool changes = self->change_count != 0u && change_at(self, 0)->period == period;
    const bool ends = self->sequence_ends == period && !(changes && replaces(change_at(self, 0)));
    if (ends) {
        stop_playing(self);
        pw_event(self, PW_EVENT_END, PW_NO_DOOR);
    }
    if (changes) {
        const struct pw_change change = *change_at(self, 0); /* its event may empty the queue */
        self->first_change = (self->first_change + 1u) % PW_CHANGES;
        self->change_count--;
        take_effect(self, &change);
    }
    if (ends) {
        pw_tell(self, PW_NO_DOOR); /* with a modulation that begins or ends in the same period */
    }
}

/* Going onto the chain ----------------------------------------------------------------------------------------- */

/* Whether a change travels as slices and commits; the others are programs (CHN-029). */
static bool has_slices(const struct pw_change *change)
{
    return change->kind == PW_UPDATE || (change->kind == PW_OUTPUT && change->action != PW_END_MODULATION);
}

static uint32_t send_slices(struct pw_device *self, struct pw_change *change)
{
    uint8_t message[PW_MESSAGE];
    for (uint16_t node = 0; node < PW_PROCESSORS; node++) {
        pw_send(self, message, pw_slice_put(message, node, change->slices[node]));
    }
    change->on_chain = true;
    return PW_PROCESSORS * SLICE_TOKENS;
}

static uint32_t send_commits(struct pw_device *self, const struct pw_change *change)
{
    uint8_t message[PW_MESSAGE];
    for (uint16_t node = 0; node < PW_PROCESSORS; node++) {
        const uint32_t checksum = pw_commit_checksum(change->slices[node], change->period);
        pw_send(self, message, pw_commit_put(message, node, change->period, checksum));
    }
    self->commits++;
    return PW_PROCESSORS * COMMIT_TOKENS;
}

static uint32_t send_programs(struct pw_device *self, const struct pw_program *program)
{
    uint8_t message[PW_MESSAGE];
    for (uint16_t node = 0; node < PW_PROCESSORS; node++) {
        pw_send(self, message, pw_program_put(message, node, program));
    }
    return PW_PROCESSORS * PROGRAM_TOKENS;
}

static struct pw_program program_of(const struct pw_change *change)
{
    struct pw_program program = {0};
    program.memory = change->kind == PW_SEQUENCE ? PW_MEMORY_ENTRIES : PW_MEMORY_SAMPLES;
    program.first = change->first;
    program.count = change->count;
    program.hold = change->hold;
    program.repeats = change->repeats;
    program.period = change->period;
    return program;
}

/* Send the commits or programs of a change that takes effect in the next period. */
static uint32_t commit(struct pw_device *self, struct pw_change *change)
{
    uint32_t tokens = has_slices(change) ? send_commits(self, change) : 0u;
    if (change->kind == PW_OUTPUT) {
        /* A modulation ends with what it modulates; it plays or waits if its program was sent. */
        self->stops_sent = self->modulation_sent;
        if (self->modulation_sent) {
            const struct pw_program stop = {.memory = PW_MEMORY_SAMPLES, .period = change->period};
            tokens += send_programs(self, &stop);
            self->modulation_sent = false;
        }
    } else if (change->kind != PW_UPDATE) {
        const struct pw_program program = program_of(change);
        tokens += send_programs(self, &program);
        self->modulation_sent = self->modulation_sent || change->kind == PW_MODULATION;
    } else {
        /* An update has no programs. */
    }
    change->on_chain = true;
    change->committed = true;
    return tokens;
}

void pw_work_on_period(struct pw_device *self, uint64_t period)
{
    self->worked = period;
    if (period % SYNC_PERIODS == 0u) {
        self->port->sync(self->port->self);
        self->sync_period = period;
        self->sync_pulses++;
    }
    effects(self, period);
    uint32_t tokens = 0;
    for (uint32_t i = 0; i < self->change_count && i < 2u; i++) {
        struct pw_change *change = pw_change_at(self, i);
        if (change->period == period + 1u) {
            tokens += commit(self, change);
        } else if (change->period == period + 2u && has_slices(change)) {
            tokens += send_slices(self, change);
        } else {
            /* It is not time yet. */
        }
    }
    pw_send_loads(self, PW_TOKENS_PER_PERIOD - tokens);
}
