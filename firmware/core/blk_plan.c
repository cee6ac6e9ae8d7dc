/* Chapter BLK: the queue of changes, and when each goes onto the chain and takes effect.

   The controller works once a period, at its beginning. A change for period P takes effect everywhere if its slices
   leave in the period P - 2 and its commits, or its programs, in P - 1: no earlier than the table before it has begun
   to play (CHN-007), and early enough to be rasterised (BUD-003). No two changes have the same period (BLK-007).

   With two wires ten slices take longer than a period, and ten programs so long that a period is not enough for them and
   for rasterising under a modulation. So programs leave in P - 2, and a change follows the one before by two periods; an
   update may follow programs by one (BLK-007). Silence may need slices, commits and programs: its slices leave in P - 3,
   the rest in P - 2, and it follows the change before by three periods. */
#include "device_parts.h"

#include <string.h>

#define SYNC_PERIODS 4096u
#define SLICE_TOKENS 52u
#define COMMIT_TOKENS 16u
#define PROGRAM_TOKENS 25u

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

bool pw_has_slices(uint8_t kind, uint8_t action)
{
    return kind == PW_UPDATE || (kind == PW_OUTPUT && action != PW_END_MODULATION);
}

/* Periods from the first message of a change to its effect. */
static uint32_t lead(uint8_t kind, uint8_t action)
{
    return PW_TWO_WIRES && kind == PW_OUTPUT && pw_has_slices(kind, action) ? 3u : 2u;
}

/* Periods from the commits or programs of a change to its effect. */
static uint32_t commit_lead(uint8_t kind)
{
    return PW_TWO_WIRES && kind != PW_UPDATE ? 2u : 1u;
}

/* Tokens of a change that leave in a period, at most: whether silence has programs shows when it leaves. */
static uint32_t tokens_in(const struct pw_change *change, uint64_t period)
{
    const uint64_t left = change->period - period;
    const bool slices = pw_has_slices(change->kind, change->action);
    uint32_t tokens = slices && left == lead(change->kind, change->action) ? PW_PROCESSORS * SLICE_TOKENS : 0u;
    if (left == commit_lead(change->kind)) {
        tokens += slices ? PW_PROCESSORS * COMMIT_TOKENS : 0u;
        tokens += change->kind != PW_UPDATE ? PW_PROCESSORS * PROGRAM_TOKENS : 0u;
    }
    return tokens;
}

/* The period by which some loads have left, if they begin in the next: as pw_work_on_period sends them, beside what is
   queued and a question in every period. */
static uint64_t last_load_period(const struct pw_device *self, uint32_t loads)
{
    uint64_t period = pw_period_now(self);
    uint32_t tokens = self->tokens_over;
    for (uint32_t left = loads; left != 0u;) {
        period++;
        for (uint32_t i = 0; i < self->change_count; i++) {
            tokens += tokens_in(change_at(self, i), period);
        }
        tokens += PW_COLLECT_TOKENS;
        while (left != 0u && tokens + PW_LOAD_TOKENS <= PW_TOKENS_PER_PERIOD) {
            tokens += PW_LOAD_TOKENS;
            left--;
        }
        tokens = tokens < PW_TOKENS_PER_PERIOD ? 0u : tokens - PW_TOKENS_PER_PERIOD;
    }
    return period;
}

uint64_t pw_first_period(const struct pw_device *self, uint8_t kind, uint8_t action)
{
    const uint64_t sorted = (self->now + PW_SORT_TICKS + PW_TICKS - 1u) / PW_TICKS;
    uint64_t first = sorted + lead(kind, action);
    const bool after_stores = kind == PW_SEQUENCE || kind == PW_MODULATION;
    const uint32_t loads = after_stores ? pw_loads_left(self) : 0u;
    if (loads != 0u) {
        /* The programs follow the last load (CHN-019). */
        const uint64_t period = last_load_period(self, loads) + 1u + commit_lead(kind);
        first = first < period ? period : first;
    }
    uint64_t next = self->last_period + 1u;
    if (PW_TWO_WIRES && !(self->last_program && kind == PW_UPDATE)) {
        next = self->last_period + lead(kind, action);
    }
    return first < next ? next : first;
}

uint64_t pw_period_due(const struct pw_device *self)
{
    const uint64_t next = self->worked + 1u;
    uint64_t period = (self->worked / SYNC_PERIODS + 1u) * SYNC_PERIODS;
    if (self->sequence_ends < period) {
        period = self->sequence_ends;
    }
    if (self->change_count != 0u) {
        const struct pw_change *change = change_at(self, 0);
        const uint64_t begins = change->period - lead(change->kind, change->action);
        period = begins < period ? begins : period;
    }
    if (self->store_count != 0u || pw_asks_for_playing(self)) {
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

/* Send the commits or programs of a change. */
static uint32_t commit(struct pw_device *self, struct pw_change *change)
{
    uint32_t tokens = pw_has_slices(change->kind, change->action) ? send_commits(self, change) : 0u;
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
    uint32_t tokens = self->tokens_over;
    for (uint32_t i = 0; i < self->change_count && i < 2u; i++) {
        struct pw_change *change = pw_change_at(self, i);
        const uint64_t left = change->period - period;
        if (left == commit_lead(change->kind)) {
            tokens += commit(self, change);
        } else if (left == lead(change->kind, change->action) && pw_has_slices(change->kind, change->action)) {
            tokens += send_slices(self, change);
        } else {
            /* It is not time yet. */
        }
    }
    if (tokens + PW_COLLECT_TOKENS <= PW_TOKENS_PER_PERIOD) {
        /* A question is not held up by stores without end. */
        tokens += pw_ask_for_playing(self, PW_COLLECT_TOKENS);
        tokens += pw_send_loads(self, PW_TOKENS_PER_PERIOD - tokens);
        tokens += pw_ask_for_playing(self, PW_TOKENS_PER_PERIOD - tokens);
    }
    self->tokens_over = tokens < PW_TOKENS_PER_PERIOD ? 0u : tokens - PW_TOKENS_PER_PERIOD;
}
