/* Chapter CHN, a processor's side: mailbox, tables, stores, sequence and modulation; what its 32 outputs play. */
#include "processor.h"

#include <string.h>

#define DEAF_PERIODS (50u * (uint64_t)PW_PERIODS_PER_MS) /* CHN-018 */
#define SYNC_TICKS (4096u * (uint64_t)PW_TICKS)          /* between two pulses: CHN-026 */
#define SYNC_TOLERANCE 1u                                /* CHN-027 */
#define TOO_HOT_C 85                                     /* above: SAF-008 */
#define COOL_C 80                                        /* below: REQ-011 */
#define LEAST_SUPPLY_MV 12000u                           /* SAF-008 */
#define MOST_SUPPLY_MV 18000u
#define SEQUENCE 0u
#define MODULATION 1u
#define UNMODULATED 255u

void pw_processor_begin(struct pw_processor *self, const uint8_t firmware[3], const uint8_t unique_id[8])
{
    memset(self, 0, sizeof *self);
    memcpy(self->firmware, firmware, 3);
    memcpy(self->unique_id, unique_id, 8);
    self->number = PW_NO_NUMBER;
    self->plays.sample = UNMODULATED;
    self->temperature_c = 30;
}

/* Messages ----------------------------------------------------------------------------------------------------- */

static void damaged(struct pw_processor *self)
{
    self->damaged_messages++;
    self->event_faults |= PW_FAULT_CHAIN;
}

static void missed(struct pw_processor *self)
{
    self->missed_commits++;
    self->event_faults |= PW_FAULT_CHAIN; /* SAF-008: a commit missed */
}

static void take_slice(struct pw_processor *self, const uint8_t *body, size_t size)
{
    if (size != PW_SLICE) {
        damaged(self);
        return;
    }
    memcpy(self->mail, body, PW_SLICE);
    self->has_mail = true;
}

static void take_commit(struct pw_processor *self, const uint8_t *body, size_t size)
{
    uint64_t period;
    uint32_t checksum;
    if (!pw_commit_get(&period, &checksum, body, size)) {
        damaged(self);
        return;
    }
    const bool had_mail = self->has_mail;
    self->has_mail = false; /* at once, whatever it is: CHN-004 */
    if (!had_mail || self->waits || period <= self->period || checksum != pw_commit_checksum(self->mail, period)) {
        missed(self);
        return;
    }
    self->waits = true;
    self->waits_period = period;
    memcpy(self->waits_slice, self->mail, PW_SLICE);
    self->commit_came_last = true;
    self->carried_out++;
}

static void take_load(struct pw_processor *self, const uint8_t *body, size_t size)
{
    struct pw_load load;
    if (!pw_load_get(&load, self->number, body, size)) {
        damaged(self);
        return;
    }
    switch (load.memory) {
    case PW_MEMORY_SLOTS:
        memcpy(self->slots[load.first], load.data, PW_SLICE);
        break;
    case PW_MEMORY_ENTRIES:
        memcpy(self->entries[load.first], load.data, 4u * (size_t)load.count);
        break;
    default:
        memcpy(self->samples + load.first, load.data, load.count);
        break;
    }
}

static void take_program(struct pw_processor *self, const uint8_t *body, size_t size)
{
    struct pw_program program;
    if (!pw_program_get(&program, self->number, body, size)) {
        damaged(self);
        return;
    }
    const uint32_t which = program.memory == PW_MEMORY_ENTRIES ? SEQUENCE : MODULATION;
    if (program.period <= self->period || self->program_waits[which]) {
        missed(self);
        return;
    }
    self->program_waits[which] = true;
    self->program[which] = program;
    if (which == SEQUENCE) {
        self->commit_came_last = false;
    }
}

static size_t answer_report(struct pw_processor *self, uint8_t *answer)
{
    struct pw_report report = {0};
    report.processor = self->number;
    report.temperature_c = self->temperature_c;
    report.faults = (uint16_t)(self->lasting_faults | self->event_faults);
    memcpy(report.firmware, self->firmware, 3);
    report.drift = self->drift;
    report.carried_out = self->carried_out;
    report.missed_commits = self->missed_commits;
    report.damaged_messages = self->damaged_messages;
    self->event_faults = 0; /* said once: CHN-016 */
    return pw_report_put(answer, &report);
}

static size_t answer_playing(const struct pw_processor *self, uint8_t *answer)
{
    struct pw_playing playing;
    playing.processor = self->number;
    playing.period = self->plays.since;
    memcpy(playing.pulses, self->plays.slice, PW_SLICE);
    return pw_playing_put(answer, &playing);
}

static size_t take_collect(struct pw_processor *self, const uint8_t *body, size_t size, uint8_t *answer)
{
    uint8_t which;
    if (!pw_collect_get(&which, self->number, body, size)) {
        damaged(self);
        return 0;
    }
    self->last_collect = self->period;
    if (!self->synced) {
        self->lasting_faults |= PW_FAULT_SYNC; /* who asks has begun its time with a pulse that was not seen here */
    }
    return which == PW_END_REPORT ? answer_report(self, answer) : answer_playing(self, answer);
}

static size_t take_number(struct pw_processor *self, const uint8_t *body, size_t size, bool last, uint8_t *answer)
{
    uint8_t number;
    if (!pw_number_get(&number, body, size)) {
        damaged(self);
        return 0;
    }
    struct pw_identity identity = {0};
    self->number = number;
    identity.processor = number;
    identity.last = last ? 1u : 0u;
    memcpy(identity.firmware, self->firmware, 3);
    memcpy(identity.unique_id, self->unique_id, 8);
    return pw_identity_put(answer, &identity);
}

size_t pw_processor_message(struct pw_processor *self, uint8_t channel_end, const uint8_t *body, size_t size, bool last,
                            uint8_t answer[PW_MESSAGE])
{
    switch (channel_end) {
    case PW_END_SLICE:
        take_slice(self, body, size);
        return 0;
    case PW_END_COMMIT:
        take_commit(self, body, size);
        return 0;
    case PW_END_LOAD:
        take_load(self, body, size);
        return 0;
    case PW_END_PROGRAM:
        take_program(self, body, size);
        return 0;
    case PW_END_COLLECT:
        return take_collect(self, body, size, answer);
    case PW_END_NUMBER:
        return take_number(self, body, size, last, answer);
    default:
        damaged(self);
        return 0;
    }
}

/* Sensors and the sync line ------------------------------------------------------------------------------------ */

/* A fault that goes before anybody has asked is told too, and silences until then (SAF-008). */
static void set_lasting(struct pw_processor *self, uint16_t fault, bool lasts)
{
    if (!lasts) {
        self->lasting_faults &= (uint16_t)~fault;
    } else if ((self->lasting_faults & fault) == 0u) {
        self->lasting_faults |= fault;
        self->event_faults |= fault;
    } else {
        /* It is there already. */
    }
}

void pw_processor_sensors(struct pw_processor *self, int8_t temperature_c, uint16_t supply_mv)
{
    self->temperature_c = temperature_c;
    if (temperature_c > TOO_HOT_C || temperature_c < COOL_C) {
        set_lasting(self, PW_FAULT_TEMPERATURE, temperature_c > TOO_HOT_C);
    }
    set_lasting(self, PW_FAULT_SUPPLY, supply_mv < LEAST_SUPPLY_MV || supply_mv > MOST_SUPPLY_MV);
}

/* No pulse when one was due is seen at the next boundary (CHN-027). That of this period may still come. */
static void check_sync(struct pw_processor *self)
{
    const uint64_t begun = self->period * PW_TICKS;
    if (self->synced && begun > self->last_sync + SYNC_TICKS + SYNC_TOLERANCE) {
        self->lasting_faults |= PW_FAULT_SYNC;
    }
}

void pw_processor_sync(struct pw_processor *self, uint64_t tick)
{
    if (!self->synced) {
        self->synced = true;
        self->last_sync = tick;
        return;
    }
    /* The time at which one was due, counted from the first: what is off adds up since then. */
    const uint64_t count = (tick - self->last_sync + SYNC_TICKS / 2u) / SYNC_TICKS;
    self->last_sync += count * SYNC_TICKS;
    const int64_t late = (int64_t)(tick - self->last_sync);
    if (late < -(int64_t)SYNC_TOLERANCE || late > (int64_t)SYNC_TOLERANCE) {
        self->lasting_faults |= PW_FAULT_SYNC;
    }
    self->drift = (int8_t)(late < INT8_MIN ? INT8_MIN : (late > INT8_MAX ? INT8_MAX : late));
}

/* Periods ------------------------------------------------------------------------------------------------------ */

static void show(struct pw_processor *self, const uint8_t *slice)
{
    memcpy(self->plays.slice, slice, PW_SLICE);
    self->plays.since = self->period;
    self->stale = true;
}

static void show_silence(struct pw_processor *self)
{
    static const uint8_t silence[PW_SLICE] = {0};
    self->plays.sequence = false;
    show(self, silence);
}

static void show_entry(struct pw_processor *self)
{
    const uint8_t *entry = self->entries[self->plays.sequence_program.first + self->plays.sequence_item];
    self->plays.sequence_left = pw_get16(entry + 2);
    show(self, self->slots[pw_get16(entry)]);
}

static void begin_sequence(struct pw_processor *self, const struct pw_program *program)
{
    struct pw_play *plays = &self->plays;
    if (program->count == 0u) {
        if (plays->sequence) {
            show_silence(self);
        }
        return;
    }
    plays->sequence = true;
    plays->sequence_program = *program;
    plays->sequence_item = 0;
    plays->sequence_repeat = 0;
    show_entry(self);
}

/* One period of the sequence is over. */
static void step_sequence(struct pw_processor *self)
{
    struct pw_play *plays = &self->plays;
    plays->sequence_left--;
    if (plays->sequence_left != 0u) {
        return;
    }
    plays->sequence_item++;
    if (plays->sequence_item == plays->sequence_program.count) {
        plays->sequence_item = 0;
        plays->sequence_repeat++;
        if (plays->sequence_program.repeats != 0u && plays->sequence_repeat == plays->sequence_program.repeats) {
            show_silence(self);
            return;
        }
    }
    show_entry(self);
}

static void use_sample(struct pw_processor *self, uint8_t sample)
{
    if (sample != self->plays.sample) {
        self->plays.sample = sample;
        self->stale = true;
    }
}

static void begin_modulation(struct pw_processor *self, const struct pw_program *program)
{
    struct pw_play *plays = &self->plays;
    plays->modulation = program->count != 0u;
    plays->modulation_program = *program;
    plays->modulation_item = 0;
    plays->modulation_left = program->hold;
    use_sample(self, plays->modulation ? self->samples[program->first] : UNMODULATED);
}

/* One period of the modulation is over. */
static void step_modulation(struct pw_processor *self)
{
    struct pw_play *plays = &self->plays;
    plays->modulation_left--;
    if (plays->modulation_left == 0u) {
        plays->modulation_left = plays->modulation_program.hold;
        plays->modulation_item = (plays->modulation_item + 1u) % plays->modulation_program.count;
        use_sample(self, self->samples[plays->modulation_program.first + plays->modulation_item]);
    }
}

/* What plays goes on by one period. */
static void step(struct pw_processor *self)
{
    if (self->plays.sequence) {
        step_sequence(self);
    }
    if (self->plays.modulation) {
        step_modulation(self);
    }
}

static bool program_begins(struct pw_processor *self, uint32_t which)
{
    const bool begins = self->program_waits[which] && self->program[which].period == self->period;
    self->program_waits[which] = self->program_waits[which] && !begins;
    return begins;
}

static void begin_what_waits(struct pw_processor *self)
{
    const bool commits = self->waits && self->waits_period == self->period;
    const bool sequence = program_begins(self, SEQUENCE);
    const bool modulation = program_begins(self, MODULATION);
    self->commit_began = commits;
    self->began = (uint8_t)((commits ? 1u : 0u) + (sequence ? 1u : 0u) + (modulation ? 1u : 0u));
    if (self->began != 0u) {
        self->before = self->plays;
    }
    /* For the same period they take effect in the order in which they came (CHN-014). */
    if (sequence && self->commit_came_last) {
        begin_sequence(self, &self->program[SEQUENCE]);
    }
    if (commits) {
        self->waits = false;
        self->plays.sequence = false;
        show(self, self->waits_slice);
    }
    if (sequence && !self->commit_came_last) {
        begin_sequence(self, &self->program[SEQUENCE]);
    }
    if (modulation) {
        begin_modulation(self, &self->program[MODULATION]);
    }
}

/* Silence by itself: what waits or runs is dropped (CHN-018, SAF-007). A slice in the mailbox does not wait yet: its
   commit is to find it, for whoever is silent misses nothing. */
static void fall_silent(struct pw_processor *self)
{
    self->waits = false;
    self->program_waits[SEQUENCE] = false;
    self->program_waits[MODULATION] = false;
    self->began = 0; /* what began has gone, too */
    self->plays.modulation = false;
    use_sample(self, UNMODULATED);
    if (self->plays.sequence || !pw_all_zero(self->plays.slice, PW_SLICE)) {
        show_silence(self);
    }
}

bool pw_processor_period(struct pw_processor *self, uint64_t period)
{
    self->period = period;
    self->stale = period == 0u || self->again;
    self->again = false;
    check_sync(self);
    step(self);
    begin_what_waits(self);
    const bool alone = period - self->last_collect == DEAF_PERIODS + 1u; /* the boundary after 50 ms */
    if (alone || ((self->lasting_faults | self->event_faults) & PW_SILENCING) != 0u) {
        fall_silent(self);
    }
    if (alone) {
        self->event_faults |= PW_FAULT_CHAIN;
    }
    if (self->stale) {
        pw_rasterise(self->plays.slice, self->plays.sample, self->words);
    }
    return self->stale;
}

void pw_processor_overrun(struct pw_processor *self)
{
    self->event_faults |= PW_FAULT_OVERRUN;
    self->again = true;
    if (self->began == 0u) {
        return; /* a step, which comes late (CHN-015) */
    }
    /* Changes that are not ready in time are missed, and what played goes on (CHN-004, CHN-014). */
    self->plays = self->before;
    self->carried_out -= self->commit_began ? 1u : 0u;
    while (self->began != 0u) {
        self->began--;
        missed(self);
    }
}
