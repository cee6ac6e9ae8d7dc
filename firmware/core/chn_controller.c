/* Chapter CHN, the controller's side: it numbers the processors, asks each how it is, and reads what they play. */
#include "device_parts.h"

#include <string.h>

#define NUMBER_TICKS (2000u * (uint64_t)PW_TICKS_PER_MS) /* CHN-028 */
#define COLLECT_TICKS ((uint64_t)PW_TICKS_PER_MS)        /* between two questions: ten in 10 ms */
#define COLLECTIONS_MISSED 2u
#define PROGRAM_ATTEMPTS 3u /* FWU-021 */
#define DEAF_TICKS (51u * (uint64_t)PW_TICKS_PER_MS) /* CHN-030 */
#define READ_TICKS ((uint64_t)PW_TICKS_PER_MS)       /* a processor answers within half of it: CHN-016 */
#define ATTEMPTS 3u                                  /* REQ-007 */
#define PULSES_BYTES 496u
#define EVENTS (PW_FAULT_CHAIN | PW_FAULT_OVERRUN)
#define KNOWN_FAULTS 0x7Fu /* a host is told no others: VER-007 */

void pw_send(struct pw_device *self, const uint8_t *message, size_t size)
{
    if (!self->broken && !self->port->chain(self->port->self, message, size)) {
        self->broken = true;
    }
}

void pw_note_broken(struct pw_device *self)
{
    if (self->broken && (self->persisting & PW_FAULT_CHAIN) == 0u) {
        self->persisting |= PW_FAULT_CHAIN | PW_FAULT_PROCESSOR;
        pw_raise_faults(self, PW_FAULT_CHAIN | PW_FAULT_PROCESSOR);
    }
}

bool pw_all_there(const struct pw_device *self)
{
    return self->numbered == PW_PROCESSORS;
}

/* Numbering ---------------------------------------------------------------------------------------------------- */

/* Whether the next processor runs (FWU-021). */
static bool runs(const struct pw_device *self)
{
    const struct pw_port *port = self->port;
    bool started = port->program == NULL;
    for (uint32_t i = 0; !started && i < PROGRAM_ATTEMPTS; i++) {
        started = port->program(port->self, self->numbered);
    }
    return started;
}

static void number_next(struct pw_device *self)
{
    uint8_t message[PW_MESSAGE];
    if (runs(self)) {
        self->number_since = self->port->now(self->port->self); /* a program takes its time */
        pw_send(self, message, pw_number_put(message, self->numbered));
    } else {
        self->processors[PW_PROCESSORS - 1u].unanswered = 1; /* numbering ends, not complete */
    }
}

/* Numbering has ended: period 0 begins (CHN-023, CHN-024). */
static void begin_time(struct pw_device *self, uint64_t tick_of_port)
{
    self->origin = tick_of_port;
    self->now = 0;
    self->serving = true;
    self->collect_at = COLLECT_TICKS;
    pw_note_broken(self);
    if (!pw_all_there(self)) {
        self->persisting |= PW_FAULT_PROCESSOR;
        pw_raise_faults(self, PW_FAULT_PROCESSOR);
    }
}

void pw_number_chain(struct pw_device *self)
{
    if (self->collect_next == 0u) {
        self->collect_next = 1; /* until numbering has ended: whether the first number was sent */
        number_next(self);
    }
    const uint64_t tick_of_port = self->port->now(self->port->self);
    const bool complete = pw_all_there(self) || self->processors[PW_PROCESSORS - 1u].unanswered != 0u;
    if (complete || self->broken || tick_of_port - self->number_since >= NUMBER_TICKS) {
        self->collect_next = 0;
        self->processors[PW_PROCESSORS - 1u].unanswered = 0;
        begin_time(self, tick_of_port);
    }
}

static void identity(struct pw_device *self, const struct pw_identity *who)
{
    if (self->serving || who->processor != self->numbered) {
        return;
    }
    struct pw_processor_state *processor = &self->processors[self->numbered];
    processor->there = true;
    memcpy(processor->report.firmware, who->firmware, 3);
    self->numbered++;
    if (who->last != 0u) {
        self->processors[PW_PROCESSORS - 1u].unanswered = 1; /* numbering ends, complete or not */
    } else if (self->numbered < PW_PROCESSORS) {
        number_next(self);
    } else {
        /* Ten have answered. */
    }
}

/* Questions ---------------------------------------------------------------------------------------------------- */

uint64_t pw_chain_due(const struct pw_device *self)
{
    if (!self->serving) {
        return self->collect_next == 0u ? 0u : self->number_since + NUMBER_TICKS;
    }
    return self->reading && self->reading_until < self->collect_at ? self->reading_until : self->collect_at;
}

static void ask(struct pw_device *self, uint8_t node)
{
    struct pw_processor_state *processor = &self->processors[node];
    if (!processor->there || self->broken || self->now < processor->asked_again) {
        return;
    }
    if (processor->unanswered == COLLECTIONS_MISSED) {
        self->persisting |= PW_FAULT_PROCESSOR;
        pw_raise_faults(self, PW_FAULT_PROCESSOR);
    } else {
        processor->unanswered++;
    }
    processor->commits = self->commits;
    uint8_t message[PW_MESSAGE];
    pw_send(self, message, pw_collect_put(message, node, PW_END_REPORT));
}

bool pw_asks_for_playing(const struct pw_device *self)
{
    return self->reading && self->reading_until != PW_NEVER && self->reading_next < PW_PROCESSORS;
}

uint32_t pw_ask_for_playing(struct pw_device *self, uint32_t tokens)
{
    uint8_t message[PW_MESSAGE];
    uint32_t left = tokens;
    for (; pw_asks_for_playing(self) && left >= PW_COLLECT_TOKENS; self->reading_next++) {
        const uint8_t node = self->reading_next;
        if (!self->processors[node].there) {
            memset(&self->read[node], 0, sizeof self->read[node]);
            self->reading_came |= (uint16_t)(1u << node);
        } else if (self->now >= self->processors[node].asked_again) {
            pw_send(self, message, pw_collect_put(message, node, PW_END_PLAYING));
            self->reading_until = self->now + READ_TICKS;
            left -= PW_COLLECT_TOKENS;
        } else {
            /* It has to fall silent by itself, for which it must not be asked anything (CHN-030). */
        }
    }
    pw_note_broken(self);
    return tokens - left;
}

/* The questions leave beside the changes, from the next period on (CHN-019). */
static void begin_to_ask(struct pw_device *self)
{
    self->reading_came = 0;
    self->reading_next = 0;
    self->reading_until = self->now + READ_TICKS;
}

void pw_work_on_chain(struct pw_device *self)
{
    if (self->collect_at <= self->now) {
        self->collect_at += COLLECT_TICKS;
        const uint8_t node = self->collect_next;
        self->collect_next = (uint8_t)((node + 1u) % PW_PROCESSORS);
        ask(self, node);
    }
    if (self->reading && self->reading_until <= self->now) {
        if (self->reading_attempt < ATTEMPTS) {
            self->reading_attempt++;
            begin_to_ask(self);
        } else {
            self->reading_until = PW_NEVER; /* the door fetches what there is */
        }
    }
}

/* Answers ------------------------------------------------------------------------------------------------------ */

/* The faults whose cause lasts, of the device and all processors. */
static void note_lasting(struct pw_device *self)
{
    uint16_t lasting = self->about->faults;
    bool lost = !pw_all_there(self);
    for (uint32_t i = 0; i < PW_PROCESSORS; i++) {
        const struct pw_processor_state *processor = &self->processors[i];
        lasting |= processor->lasting;
        lost = lost || processor->unanswered == COLLECTIONS_MISSED;
    }
    if (lost || self->broken) {
        lasting |= PW_FAULT_PROCESSOR;
    }
    if (self->broken) {
        lasting |= PW_FAULT_CHAIN;
    }
    self->persisting = lasting;
}

/* Whether commits were missed, or never arrived, since the report before. */
static bool has_missed(struct pw_processor_state *processor, const struct pw_report *came)
{
    const uint32_t absent = processor->commits - came->carried_out - came->missed_commits;
    const bool missed = came->missed_commits != processor->report.missed_commits || absent != processor->absent;
    processor->absent = absent;
    return missed;
}

static void report(struct pw_device *self, const struct pw_report *came)
{
    struct pw_processor_state *processor = &self->processors[came->processor];
    const bool missed = has_missed(processor, came);
    const uint16_t faults = came->faults & KNOWN_FAULTS;
    const uint16_t kept = processor->report.faults;
    processor->report = *came;
    processor->report.faults = faults | kept;
    processor->lasting = (uint16_t)(faults & (uint16_t)~EVENTS);
    processor->known = true;
    processor->unanswered = 0;
    note_lasting(self);
    pw_raise_faults(self, faults);
    if (missed && !pw_state_enabled(self->state)) {
        /* That may have been the silence: once more, and if it is missed again the processor falls silent (CHN-030). */
        processor->asked_again = self->now + DEAF_TICKS;
        pw_silence(self, true);
    }
}

static bool same_since(const struct pw_device *self)
{
    for (uint32_t i = 1; i < PW_PROCESSORS; i++) {
        if (self->read[i].period != self->read[0].period) {
            return false;
        }
    }
    return true;
}

static void playing(struct pw_device *self, const struct pw_playing *came)
{
    if (!self->reading || self->reading_until == PW_NEVER) {
        return;
    }
    self->read[came->processor] = *came;
    self->reading_came |= (uint16_t)(1u << came->processor);
    if (self->reading_came != (1u << PW_PROCESSORS) - 1u) {
        return;
    }
    self->reading_period = pw_period_now(self);
    self->reading_until = PW_NEVER;
    if (!same_since(self) && self->reading_attempt < ATTEMPTS) {
        self->reading_attempt++;
        begin_to_ask(self);
    }
}

void pw_device_chain(struct pw_device *self, uint8_t channel_end, const uint8_t *body, size_t size)
{
    struct pw_identity who;
    struct pw_report came;
    struct pw_playing plays;
    if (self->serving) {
        pw_device_poll(self);
    }
    if (channel_end == PW_END_IDENTITY && pw_identity_get(&who, body, size)) {
        identity(self, &who);
    } else if (channel_end == PW_END_REPORT && self->serving && pw_report_get(&came, body, size)) {
        report(self, &came);
    } else if (channel_end == PW_END_PLAYING && pw_playing_get(&plays, body, size)) {
        playing(self, &plays);
    } else if (self->serving) {
        pw_raise_faults(self, PW_FAULT_CHAIN); /* damaged; the question counts as unanswered (CHN-017) */
    } else {
        /* Whose identity was damaged is not there, and the chain is not complete (CHN-023). */
    }
}

/* PULSES (REQ-007) --------------------------------------------------------------------------------------------- */

void pw_begin_reading(struct pw_device *self, uint8_t door, uint16_t length)
{
    self->reading = true;
    self->reading_door = door;
    self->reading_length = length;
    self->reading_attempt = 1;
    memset(self->read, 0, sizeof self->read);
    begin_to_ask(self);
}

enum pw_answer pw_device_answer(struct pw_device *self, uint8_t door, uint8_t *answer, uint16_t *answer_size)
{
    *answer_size = 0;
    if (!self->reading || self->reading_door != door) {
        return PW_STALLED;
    }
    pw_device_poll(self);
    if (self->reading_until != PW_NEVER) {
        return PW_LATER;
    }
    self->reading = false;
    memset(answer, 0, PULSES_BYTES);
    for (uint32_t node = 0; node < PW_PROCESSORS; node++) {
        pw_pulses_unsort(self->read[node].pulses, node, self->about->wiring, answer + 16);
    }
    const bool all_came = self->reading_came == (1u << PW_PROCESSORS) - 1u;
    const bool silent = all_came && !self->plays && pw_all_zero(answer + 16, PW_PAYLOAD);
    const bool agree = all_came && same_since(self);
    if (!silent) { /* who did not answer may play anything */
        pw_put64(answer, agree ? self->read[0].period : UINT64_MAX);
    }
    pw_put64(answer + 8, self->reading_period);
    *answer_size = PULSES_BYTES < self->reading_length ? PULSES_BYTES : self->reading_length;
    return PW_ANSWERED;
}
