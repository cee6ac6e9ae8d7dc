/* What plays in which period: slices and commits, programs, faults of this processor, silence. Nothing here waits for a
   link, so that silence comes whatever happens to the chain (CHN-018).

   Once a period, at a fixed time before its boundary, `decide` lets begin what waits for this period, steps the
   sequence and the modulation, and has the table made. A commit or a program is in time if it is dealt with before the
   decision on its period. */
#include "processor.h"

#include "hardware.h"

enum { WAITING_COMMIT = 1, WAITING_SEQUENCE = 2, WAITING_MODULATION = 4 };
enum { SEQUENCE_OFF, SEQUENCE_ENDED, SEQUENCE_RUNS };
#define REPLACES_SEQUENCE (WAITING_COMMIT | WAITING_SEQUENCE)
#define SILENCING (FAULT_SYNC | FAULT_TEMPERATURE | FAULT_SUPPLY)
#define SYNC_STEP 16384u /* of the sync port's count of 10 ns, from one pulse to the next, modulo 2^16 (CHN-027) */
#define GLANCE_TIME 128u /* enough for a processor that is slow eight times */
#define POOL 4u
/* What is rare or short of nothing but time, so that `decide` saves few registers. */
#define OUT_OF_LINE __attribute__((noinline))
#define FIRST_WORDS 2u /* of a table, that `raster_begin` makes */

struct program {
    uint64_t period;
    uint32_t items;  /* the first, and how many << 16 */
    uint32_t manner; /* hold, and repeats << 16 */
};

static inline uint32_t low_half(uint32_t word)
{
    return word & 0xFFFFu;
}

struct sequence {
    uint32_t state;
    const uint32_t *begin, *end, *at; /* entries */
    uint32_t periods;                 /* left of this entry */
    uint32_t repeats;                 /* left, this one among them; 0 without end */
};

struct modulation {
    const uint8_t *begin, *end, *at; /* samples; begin is null if there is none */
    uint32_t hold, periods;
};

static const uint32_t silence[SLICE_WORDS];

/* Flags are words, which take one instruction to read. */
const uint32_t *next_table;
struct told told;
uint32_t time_runs;
uint32_t unsynced;

/* The mailbox, and the slice that waits. Of four places two are what plays and what played before. */
static uint32_t mail_place;
static uint32_t mail_crc;
static uint32_t has_mail;
static uint32_t waiting; /* what waits for its period */
static uint32_t commit_came_last;
static uint64_t commit_period;
static const uint32_t *commit_slice;
static struct program waiting_sequence, waiting_modulation;

/* The period that was decided last, the time at which it begins, and what began with it. */
static uint64_t decided;
static uint32_t boundary;
static uint32_t began;
static uint32_t stepped;   /* the table of the period before would not do, whatever began */
static uint32_t again;     /* no table was made for it */
/* The table that was handed over last. There are three, because the port may still play the one before it. */
static uint32_t *table;
static uint32_t decide_at; /* the time of the next decision */
static uint32_t waits_to_decide;

static struct plays now_plays, before_change;
static struct sequence sequence, sequence_before;
static struct modulation modulation, modulation_before;
static uint32_t kept; /* changes before which this was so */
static uint32_t sync_came;
static uint32_t sync_stamp;
static int32_t sync_offset;
static uint32_t pool[POOL][SLICE_WORDS];

void play_begin(void)
{
    now_plays.slice = silence;
    told.before.slice = silence;
    told.after.slice = silence;
    told.settled = true;
    told.temperature = port_peek(temperature_port) & 0xFFu;
    next_table = silent_table;
    table = tables[0];
    play_temperature(told.temperature);
    play_supply(port_peek(supply_port));
}

/* What is told ------------------------------------------------------------------------------------------------- */

OUT_OF_LINE static void missed(uint32_t count)
{
    lock_take(state_lock);
    told.missed += count;
    lock_give(state_lock);
}

OUT_OF_LINE static void damaged(void)
{
    lock_take(state_lock);
    told.damaged++;
    lock_give(state_lock);
}

static inline void copy_plays(struct plays *to, const struct plays *from)
{
    to->since = from->since;
    to->slice = from->slice;
    to->carried_out = from->carried_out;
}

/* `now_plays` is told from the time of a boundary on. */
OUT_OF_LINE static void tell(uint32_t at)
{
    lock_take(state_lock);
    if (told.at != at) {
        copy_plays(&told.before, &told.after);
        told.at = at;
    }
    copy_plays(&told.after, &now_plays);
    told.settled = false;
    lock_give(state_lock);
}

/* Faults and silence ------------------------------------------------------------------------------------------- */

static inline bool silenced(void)
{
    return (told.faults & SILENCING) != 0u || unsynced;
}

/* What is dropped in silence is missed and does not raise CHAIN: whatever silences has been told of already. */
static void dropped(uint32_t count)
{
    lock_take(state_lock);
    told.missed += count;
    told.events -= count;
    lock_give(state_lock);
}

/* Falls silent at the next boundary, and drops what waits or runs (SAF-007, CHN-018). */
OUT_OF_LINE static void fall_silent(void)
{
    uint32_t commits = (waiting & WAITING_COMMIT) != 0u ? 1u : 0u;
    waiting = 0;
    if (time_runs == 0u) {
        dropped(commits);
        return;
    }
    uint64_t period = decided;
    uint32_t at = boundary;
    next_table = silent_table;
    if ((int32_t)(timer_now(play_clock) + HAND_OVER_TIME - boundary) >= 0) {
        period++; /* the port has the table of the period that was decided last */
        at += PERIOD_TIME;
    } else if ((began & WAITING_COMMIT) != 0u) {
        commits++; /* it does not begin after all */
        now_plays.carried_out--;
    } else {
        /* Nothing that counts was to begin. */
    }
    if (period == decided) {
        began = 0;
    }
    dropped(commits);
    sequence.state = SEQUENCE_OFF;
    modulation.begin = 0;
    again = false;
    now_plays.slice = silence;
    now_plays.since = period;
    tell(at);
}

OUT_OF_LINE static void set_fault(uint32_t fault, bool there)
{
    const bool is_new = there && (told.faults & fault) == 0u;
    lock_take(state_lock);
    told.faults = there ? (told.faults | fault) : (told.faults & ~fault);
    lock_give(state_lock);
    if (is_new) {
        fall_silent();
    }
}

void play_temperature(uint32_t value)
{
    const int32_t celsius = (int8_t)value;
    port_compare(temperature_port, value & 0xFFu);
    told.temperature = value & 0xFFu;
    set_fault(FAULT_TEMPERATURE, celsius > TOO_HOT_C);
}

void play_supply(uint32_t value)
{
    port_compare(supply_port, value & 1u);
    set_fault(FAULT_SUPPLY, (value & 1u) == 0u);
}

/* No question for 50 ms (CHN-018). */
OUT_OF_LINE static void be_alone(void)
{
    lock_take(state_lock);
    told.events++;
    lock_give(state_lock);
    heard = timer_now(play_clock);
    fall_silent();
}

/* The sync line ------------------------------------------------------------------------------------------------ */

void play_started(void)
{
    heard = first_time;
    sync_stamp = first_stamp;
    boundary = first_time; /* of period 0, in which nothing can play */
    sync_came = true;
    time_runs = true;
    told.at = boundary;
    decide_at = boundary + PERIOD_TIME - DECIDE_TIME;
    port_compare(sync_port, 1);
    if (unsynced) {
        set_fault(FAULT_SYNC, true);
    }
}

/* A later pulse. Its edge is where the sync port's count of 10 ns should be by now, or it is early or late. */
void play_sync(void)
{
    /* The stamp first: once what met the condition is taken, the port goes on, and its stamp with it. */
    const uint32_t stamp = port_stamp(sync_port);
    (void)port_take(sync_port);
    events_off(sync_port); /* until the line is low again: see decide_sync */
    sync_came = true;
    sync_offset += (int16_t)(stamp - sync_stamp - SYNC_STEP);
    sync_stamp = stamp;
    /* The nearest tick. Both are 0 if all is well, which saves the division. */
    const int32_t ticks = sync_offset == 0 ? 0 : (sync_offset + TICK_TIME / 2 + 4096 * TICK_TIME) / TICK_TIME - 4096;
    lock_take(state_lock);
    told.drift = ticks < -128 ? -128 : (ticks > 127 ? 127 : ticks);
    lock_give(state_lock);
    if (ticks < -1 || ticks > 1) {
        set_fault(FAULT_SYNC, true);
    }
}

/* One period after a pulse was due. */
OUT_OF_LINE static void decide_sync(void)
{
    if (!sync_came) {
        set_fault(FAULT_SYNC, true);
    }
    sync_came = false;
    events_on(sync_port);
}

/* Messages ----------------------------------------------------------------------------------------------------- */

/* What still waits, or begins with a boundary that has not come yet (CHN-007, CHN-014). */
static uint32_t still_waiting(void)
{
    if (began != 0u && (int32_t)(timer_now(play_clock) - boundary) >= 0) {
        began = 0;
    }
    return waiting | began;
}

static inline bool in_time(uint64_t period)
{
    return time_runs != 0u && period > decided;
}

static void take_slice(const struct message *message)
{
    slice_copy(pool[mail_place], message->body);
    mail_crc = message->body[MESSAGE_CRC];
    has_mail = true;
}

static void take_commit(const struct message *message)
{
    const uint64_t period = (uint64_t)message->body[1] << 32 | message->body[0];
    const uint32_t crc = crc_word(crc_word(crc_word(mail_crc, message->body[0]), message->body[1]), message->body[2]);
    const bool guards = has_mail && crc == 0xFFFFFFFFu;
    has_mail = false; /* at once, whatever it is (CHN-004) */
    if (!guards || (still_waiting() & WAITING_COMMIT) != 0u || !in_time(period)) {
        missed(1);
        return;
    }
    commit_slice = pool[mail_place];
    commit_period = period;
    commit_came_last = true;
    waiting |= WAITING_COMMIT;
    do {
        mail_place = (mail_place + 1u) % POOL;
    } while (pool[mail_place] == now_plays.slice || pool[mail_place] == told.before.slice);
}

/* CHN-014 */
static inline bool program_valid(uint32_t memory, uint32_t items, uint32_t manner)
{
    const uint32_t end = low_half(items) + (items >> 16);
    if (memory == MEMORY_ENTRIES) {
        return items >> 16 == 0u ? (items | manner) == 0u : end <= ENTRIES && low_half(manner) == 0u;
    }
    if (memory == MEMORY_SAMPLES) {
        return items >> 16 == 0u ? (items | manner) == 0u : end <= SAMPLES && manner - 1u < 0xFFFFu;
    }
    return false;
}

OUT_OF_LINE static void take_program(const uint32_t *body)
{
    const uint32_t items = body[1];
    const uint32_t manner = body[2];
    const uint64_t period = (uint64_t)body[4] << 32 | body[3];
    if (!program_valid(body[0], items, manner)) {
        damaged();
        return;
    }
    const bool is_sequence = body[0] == MEMORY_ENTRIES;
    const uint32_t bit = is_sequence ? WAITING_SEQUENCE : WAITING_MODULATION;
    if ((still_waiting() & bit) != 0u || !in_time(period)) {
        missed(1);
        return;
    }
    if (is_sequence) {
        commit_came_last = false;
    } else if (items != 0u && period == decided + 1u) {
        /* The first modulation needs more time from its first period on. */
        const uint32_t then = boundary + PERIOD_TIME;
        if ((int32_t)(timer_now(play_clock) + BEGIN_MODULATED_TIME - then) >= 0) {
            missed(1);
            return;
        }
        decide_at = then - DECIDE_MODULATED_TIME; /* which may be at once */
    } else {
        /* The decision before that period sees to it. */
    }
    struct program *program = is_sequence ? &waiting_sequence : &waiting_modulation;
    program->period = period;
    program->items = items;
    program->manner = manner;
    waiting |= bit;
}

void play_message(const struct message *message)
{
    if (number == UNNUMBERED_NODE) {
        damaged();
    } else if (message->kind == SLICE) {
        take_slice(message);
    } else if (message->kind == COMMIT) {
        take_commit(message);
    } else {
        take_program(message->body);
    }
}

/* Periods ------------------------------------------------------------------------------------------------------ */

static inline void show(const uint32_t *slice)
{
    now_plays.slice = slice;
    now_plays.since = decided;
}

/* The entry that is next, passing over those for no period; false if there are no others. */
static bool show_entry(const uint32_t *entry)
{
    uint32_t left = (uint32_t)(sequence.end - sequence.begin);
    while ((*entry >> 16) == 0u) {
        entry++;
        left--;
        if (entry == sequence.end) {
            if (left == 0u || sequence.repeats == 1u) {
                return false;
            }
            entry = sequence.begin;
            sequence.repeats -= sequence.repeats != 0u ? 1u : 0u;
        }
        if (left == 0u) {
            return false;
        }
    }
    sequence.at = entry;
    sequence.periods = *entry >> 16;
    show(slots[*entry & (SLOTS - 1u)]);
    return true;
}

static void end_sequence(void)
{
    sequence.state = SEQUENCE_ENDED;
    show(silence);
}

/* One period of the sequence is over; returns whether others pulses play. */
OUT_OF_LINE static bool step_sequence(void)
{
    sequence.periods--;
    if (sequence.periods != 0u) {
        return false;
    }
    const uint32_t *entry = sequence.at + 1;
    if (entry == sequence.end) {
        entry = sequence.begin;
        if (sequence.repeats != 0u) {
            sequence.repeats--;
            if (sequence.repeats == 0u) {
                end_sequence();
                return true;
            }
        }
    }
    if (!show_entry(entry)) {
        end_sequence();
    }
    return true;
}

/* One period of the modulation is over; returns whether another sample lies over what plays. */
static bool step_modulation(void)
{
    modulation.periods--;
    if (modulation.periods != 0u) {
        return false;
    }
    modulation.periods = modulation.hold;
    const uint8_t before = *modulation.at;
    modulation.at++;
    if (modulation.at == modulation.end) {
        modulation.at = modulation.begin;
    }
    return *modulation.at != before;
}

static void begin_sequence(void)
{
    const uint32_t count = waiting_sequence.items >> 16;
    if (count == 0u) {
        if (sequence.state != SEQUENCE_OFF) {
            sequence.state = SEQUENCE_OFF;
            show(silence);
        }
        return;
    }
    sequence.begin = &entries[low_half(waiting_sequence.items)];
    sequence.end = sequence.begin + count;
    sequence.repeats = waiting_sequence.manner >> 16;
    sequence.state = SEQUENCE_RUNS;
    if (!show_entry(sequence.begin)) { /* entries that were never stored; a controller does not let it come to this */
        sequence.state = SEQUENCE_OFF;
        show(silence);
    }
}

static void begin_modulation(void)
{
    const uint32_t count = waiting_modulation.items >> 16;
    if (count == 0u) {
        modulation.begin = 0;
        return;
    }
    modulation.begin = &samples[low_half(waiting_modulation.items)];
    modulation.end = modulation.begin + count;
    modulation.at = modulation.begin;
    modulation.hold = low_half(waiting_modulation.manner);
    modulation.periods = modulation.hold;
}

static inline void begin_commit(void)
{
    sequence.state = SEQUENCE_OFF;
    now_plays.carried_out++;
    show(silenced() ? silence : commit_slice);
}

static inline void copy_sequence(struct sequence *to, const struct sequence *from)
{
    to->begin = from->begin;
    to->end = from->end;
    to->at = from->at;
    to->periods = from->periods;
    to->repeats = from->repeats;
}

static inline void copy_modulation(struct modulation *to, const struct modulation *from)
{
    to->begin = from->begin;
    to->end = from->end;
    to->at = from->at;
    to->hold = from->hold;
    to->periods = from->periods;
}

/* Keeps what a change changes, for `go_back`. */
static inline void keep_before(uint32_t begins)
{
    kept = begins;
    copy_plays(&before_change, &now_plays);
    sequence_before.state = sequence.state;
    if ((begins & WAITING_SEQUENCE) != 0u) {
        copy_sequence(&sequence_before, &sequence);
    }
    if ((begins & WAITING_MODULATION) != 0u) {
        copy_modulation(&modulation_before, &modulation);
    }
}

static inline void go_back(void)
{
    copy_plays(&now_plays, &before_change);
    sequence.state = sequence_before.state;
    if ((kept & WAITING_SEQUENCE) != 0u) {
        copy_sequence(&sequence, &sequence_before);
    }
    if ((kept & WAITING_MODULATION) != 0u) {
        copy_modulation(&modulation, &modulation_before);
    }
}

/* Lets begin what waits for the period that is being decided, unless it is a commit alone. For the same period messages
   take effect in the order in which they came (CHN-014): of a commit and a sequence the later one plays, and a sequence
   that is stopped after a commit has ended already. */
OUT_OF_LINE static void begin_several(uint32_t begins)
{
    if (silenced()) { /* programs have no effect then */
        begins &= WAITING_COMMIT;
    } else if ((begins & WAITING_COMMIT) != 0u && (begins & WAITING_SEQUENCE) != 0u) {
        begins &= commit_came_last || waiting_sequence.items == 0u ? ~(uint32_t)WAITING_SEQUENCE : ~0u;
    } else {
        /* They do not touch each other. */
    }
    keep_before(begins);
    if ((begins & WAITING_SEQUENCE) != 0u) {
        now_plays.carried_out += begins & WAITING_COMMIT;
        begin_sequence();
    } else if ((begins & WAITING_COMMIT) != 0u) {
        begin_commit();
    } else {
        /* What plays goes on. */
    }
    if ((begins & WAITING_MODULATION) != 0u) {
        begin_modulation();
    }
}

/* What waits for the period that is being decided. */
static inline uint32_t what_begins(void)
{
    uint32_t begins = 0;
    if ((waiting & WAITING_COMMIT) != 0u && commit_period == decided) {
        begins |= WAITING_COMMIT;
    }
    if ((waiting & WAITING_SEQUENCE) != 0u && waiting_sequence.period == decided) {
        begins |= WAITING_SEQUENCE;
    }
    if ((waiting & WAITING_MODULATION) != 0u && waiting_modulation.period == decided) {
        begins |= WAITING_MODULATION;
    }
    return begins;
}

static uint32_t ones(uint32_t bits)
{
    return (bits & 1u) + (bits >> 1 & 1u) + (bits >> 2);
}

/* The table could not be ready in time. What began with it is missed, and what played goes on (CHN-004, CHN-014); a
   step comes late (CHN-015). Returns whether the table that was made, if one was, is that of what plays. */
OUT_OF_LINE static bool overrun(bool made)
{
    const uint32_t count = ones(began);
    lock_take(state_lock);
    told.overruns++;
    told.missed += count;
    lock_give(state_lock);
    if (began == 0u) {
        again = !made;
        return made;
    }
    go_back();
    if ((began & REPLACES_SEQUENCE) != 0u && sequence.state == SEQUENCE_RUNS && step_sequence()) {
        stepped = true;
    }
    if ((began & WAITING_MODULATION) != 0u && modulation.begin != 0 && step_modulation()) {
        stepped = true;
    }
    began = 0;
    again = stepped;
    return false;
}

static inline bool too_late(void)
{
    return (int32_t)(timer_now(play_clock) + HAND_OVER_TIME - boundary) >= 0;
}

/* Makes the table of what plays from the boundary on, and hands it over. Its last words come after that, for the port
   takes longer to play the first. */
static void render(void)
{
    if (now_plays.slice == silence) {
        next_table = silent_table;
        return;
    }
    if ((int32_t)(timer_now(play_clock) - boundary) >= 0) { /* by whole periods: those that come after may be in time */
        (void)overrun(false);
        return;
    }
    uint32_t *const handed_over = table;
    table = table == tables[2] ? tables[0] : table + TICKS;
    const uint8_t *row = modulation.begin != 0 ? &widths[*modulation.at * WIDTHS] : 0;
    const uint32_t levels = raster_begin(now_plays.slice, row, no_edges, table);
    const uint32_t celsius = port_peek(temperature_port) & 0xFFu;
    if (celsius != told.temperature) {
        play_temperature(celsius);
    }
    const uint32_t supply = port_peek(supply_port);
    if ((supply & 1u) == ((told.faults & FAULT_SUPPLY) != 0u ? 1u : 0u)) {
        play_supply(supply);
    }
    bool plays = now_plays.slice != silence; /* or a fault has just silenced it */
    if (plays && too_late()) {
        plays = overrun(true);
    }
    if (plays) {
        next_table = table;
    }
    MEMORY_FENCE();
    raster_end(no_edges + FIRST_WORDS, table + FIRST_WORDS, levels);
    if (!plays) {
        table = handed_over; /* what was made is for nothing, and its place is free as before */
    }
}

/* The time of the next decision. Before a boundary from which a modulation plays it is earlier. */
static inline void set_decide_at(void)
{
    const bool modulates = modulation.begin != 0 ||
        ((waiting & WAITING_MODULATION) != 0u && waiting_modulation.period == decided + 1u &&
         waiting_modulation.items != 0u);
    decide_at = boundary + PERIOD_TIME - (modulates ? DECIDE_MODULATED_TIME : DECIDE_TIME);
}

/* Decides what plays from the next boundary on. */
static void decide(void)
{
    decided++;
    boundary += PERIOD_TIME;
    began = 0;
    stepped = again;
    again = false;
    if (((uint32_t)decided & (SYNC_PERIODS - 1u)) == 1u) {
        decide_sync();
    }
    bool changes = false;
    if (waiting != 0u && (began = what_begins()) != 0u) {
        waiting &= ~began;
        changes = true;
        if (began == WAITING_COMMIT) {
            keep_before(WAITING_COMMIT);
            begin_commit();
        } else {
            begin_several(began);
        }
    }
    /* What has just begun, and what it has ended, has no step. */
    if (sequence.state == SEQUENCE_RUNS && (began & REPLACES_SEQUENCE) == 0u && step_sequence()) {
        changes = true;
        stepped = true;
    }
    if (modulation.begin != 0 && (began & WAITING_MODULATION) == 0u && step_modulation()) {
        stepped = true;
    }
    if (stepped || began != 0u) {
        render();
    }
    /* The table goes first. */
    if (changes) {
        tell(boundary);
    } else if (!told.settled && told.at != boundary) {
        lock_take(state_lock);
        copy_plays(&told.before, &told.after);
        told.settled = true;
        lock_give(state_lock);
    } else {
        /* What is told has begun long ago, or is that of a fault in this period. */
    }
    set_decide_at();
}

/* Until when the playing thread may wait: for the next decision, or until this processor has been alone for too
   long. */
static inline uint32_t wake(void)
{
    const uint32_t alone_at = heard + DEAF_TIME;
    waits_to_decide = time_runs != 0u && (int32_t)(alone_at - decide_at) > 0;
    return waits_to_decide ? decide_at : alone_at;
}

/* What tests on another machine call instead of `play`. */
uint32_t play_wake(void)
{
    return wake();
}

/* The time until which the playing thread waited has come. */
void play_time(void)
{
    if (waits_to_decide) {
        decide();
    } else if ((int32_t)(timer_now(play_clock) - heard - DEAF_TIME) < 0) {
        /* A question came meanwhile. */
    } else if (time_runs != 0u) {
        be_alone();
    } else {
        heard += DEAF_TIME; /* who has not begun is not alone yet */
    }
}

/* Something other than time has come. */
static void take_event(uint32_t event)
{
    static const struct message *message = play_ring;
    switch (event) {
    case EVENT_MESSAGE:
        signal_take(play_inbox);
        play_message(message);
        message = message->next;
        signal_send(play_ready);
        break;
    case EVENT_STARTED:
        signal_take(started_to);
        play_started();
        break;
    case EVENT_SYNC:
        play_sync();
        break;
    case EVENT_TEMPERATURE:
        play_temperature(port_take(temperature_port));
        break;
    default:
        play_supply(port_take(supply_port));
        break;
    }
}

/* The playing thread. Time goes first; but a processor that is too slow for its decisions still takes a message, and
   whatever else there is, after each. */
void play(void)
{
    play_events();
    for (;;) {
        uint32_t event = play_wait(wake());
        if (event == EVENT_TIME) {
            play_time();
            if ((int32_t)(timer_now(play_clock) - decide_at) < 0) {
                continue;
            }
            event = play_wait(timer_now(play_clock) + GLANCE_TIME);
            if (event == EVENT_TIME) {
                continue;
            }
        }
        take_event(event);
    }
}
