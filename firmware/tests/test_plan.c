/* The plan of the queue against the time that the first link takes: a model of the link gives every message its time of
   arrival, and no commit and no program may come too early or too late. `make two-wire` runs it with two-wire links. */
#include "check.h"
#include "device.h"
#include "processor.h"
#include "sums.h"

#define ROUNDS 4000u
#define PERIODS 4096u
#define PERIODS_APART (PW_TWO_WIRES ? 2u : 1u) /* of updates, on the links: BUD-004 */
#define FEW (PW_QUEUE_CHANGES / 2u)

/* BUD-003 and BUD-006, in tokens of the first link: 400, 4400 and 5424 of the 10 000 cycles of a period. */
#define TOKENS_OF(cycles) (((cycles) * PW_TOKENS_PER_PERIOD + 9999u) / 10000u)
#define HOPS TOKENS_OF(400u)
#define RASTERISE TOKENS_OF(4400u)
#define MODULATE TOKENS_OF(5424u)

struct seen {
    bool mail;              /* a slice waits for its commit */
    uint32_t commits;
    uint64_t committed;     /* the period of the last commit */
    uint64_t programmed[2]; /* of the last program of the sequence, and of the modulation */
};

static struct pw_processor all[PW_PROCESSORS];
static struct pw_device device;
static struct seen seen[PW_PROCESSORS];
static uint16_t wiring[PW_CHANNELS];
static uint64_t clock_now;
static uint64_t busy_until; /* the first link, in tokens since the device's period 0 */
static uint32_t loads, questions;   /* that have left */
static uint32_t ordered;            /* loads of all accepted stores */
static uint32_t needed[PERIODS];    /* `ordered` when the program of a period was accepted */
static uint8_t answers[64][PW_MESSAGE];
static size_t sizes[64], waiting;
static uint32_t number;

static uint64_t now(void *self)
{
    (void)self;
    return clock_now;
}

/* A change is ready before its period, also under a modulation if there may be one. */
static void check_ready(uint64_t arrives, uint64_t period)
{
    CHECK(arrives + (device.modulates || device.modulation_sent ? MODULATE : RASTERISE)
          <= period * PW_TOKENS_PER_PERIOD);
}

static void check_message(const uint8_t *message, size_t size, uint64_t arrives)
{
    struct seen *to = &seen[message[1]];
    struct pw_program program;
    uint64_t period;
    uint32_t checksum;
    switch (message[2]) {
    case PW_END_SLICE:
        CHECK(!to->mail);
        to->mail = true;
        break;
    case PW_END_COMMIT:
        CHECK(pw_commit_get(&period, &checksum, &message[3], size - 3u));
        check_ready(arrives, period);
        CHECK(arrives >= to->committed * PW_TOKENS_PER_PERIOD); /* CHN-007: no table waits */
        to->mail = false;
        to->committed = period;
        to->commits++;
        break;
    case PW_END_PROGRAM:
        CHECK(pw_program_get(&program, message[1], &message[3], size - 3u));
        check_ready(arrives, program.period);
        CHECK(arrives >= to->programmed[program.memory - PW_MEMORY_ENTRIES] * PW_TOKENS_PER_PERIOD); /* CHN-014 */
        to->programmed[program.memory - PW_MEMORY_ENTRIES] = program.period;
        CHECK(program.count == 0u || loads >= needed[program.period % PERIODS]); /* CHN-019 */
        break;
    default:
        break;
    }
}

static bool send(void *self, const uint8_t *message, size_t size)
{
    (void)self;
    uint32_t to = message[0] == 0u ? message[1] : 0u;
    while (message[0] != 0u && all[to].number != PW_NO_NUMBER) {
        to++;
    }
    if (device.serving) {
        const uint64_t begins = (clock_now - device.origin) * PW_TOKENS_PER_PERIOD / PW_TICKS;
        busy_until = (busy_until > begins ? busy_until : begins) + size + 1u; /* with END */
        loads += message[2] == PW_END_LOAD ? 1u : 0u;
        questions += message[2] == PW_END_COLLECT ? 1u : 0u;
        check_message(message, size, busy_until + HOPS);
    }
    sizes[waiting] = pw_processor_message(&all[to], message[2], &message[3], size - 3u, to == 9u, answers[waiting]);
    waiting += sizes[waiting] != 0u ? 1u : 0u;
    return true;
}

static void sync_line(void *self)
{
    (void)self;
    for (uint32_t i = 0; i < PW_PROCESSORS; i++) {
        pw_processor_sync(&all[i], clock_now - device.origin);
    }
}

static const struct pw_port port = {.now = now, .chain = send, .sync = sync_line};
static const struct pw_about about = {
    {1, 2, 3, 4, 5, 6, 7, 8}, {1, 2, 3}, PW_BANK_A, 0, 1, "plan", "PW-0001", wiring, 20, 16, 10300,
};

/* Without enabled outputs the slices of queued changes are dropped, and the next may take their places. */
static void note_state(void)
{
    for (uint32_t i = 0; i < PW_PROCESSORS && !pw_state_enabled(device.state); i++) {
        seen[i].mail = false;
    }
}

static void work(void)
{
    pw_device_poll(&device);
    note_state();
    for (size_t i = 0; i < waiting; i++) {
        pw_device_chain(&device, answers[i][2], &answers[i][3], sizes[i] - 3u);
    }
    waiting = 0;
}

/* Some ticks pass. */
static void pass_ticks(uint64_t ticks)
{
    for (uint64_t i = 0; i < ticks; i++) {
        clock_now++;
        const uint64_t tick = clock_now - device.origin;
        for (uint32_t k = 0; k < PW_PROCESSORS && tick % PW_TICKS == 0u; k++) {
            (void)pw_processor_period(&all[k], tick / PW_TICKS);
        }
        work();
    }
}

static void pass(uint64_t periods)
{
    pass_ticks(periods * PW_TICKS);
}

static void order(uint8_t request)
{
    const struct pw_setup setup = {PW_REQUEST_OUT, request, 0, 0, 0};
    uint8_t answer[PW_ANSWER];
    uint16_t size = 0;
    CHECK_EQ(pw_device_request(&device, PW_DOOR_USB, &setup, answer, &size), PW_ANSWERED);
    note_state();
}

static void begin(const char *name)
{
    static const uint8_t nothing[8] = {0};
    check_case = name;
    clock_now = 0;
    busy_until = 0;
    waiting = 0;
    number = 0;
    memset(seen, 0, sizeof seen);
    for (uint16_t i = 0; i < PW_CHANNELS; i++) {
        wiring[i] = i;
    }
    for (uint32_t i = 0; i < PW_PROCESSORS; i++) {
        pw_processor_begin(&all[i], nothing, nothing);
    }
    pw_device_begin(&device, &port, &about);
    for (uint32_t i = 0; i < 100u && !pw_device_serving(&device); i++) {
        work();
    }
    device.watchdog_ms = 60000;
    CHECK(pw_device_serving(&device));
    order(PW_REQ_ENABLE);
    pass(2);
    loads = 0;
    ordered = 0;
    questions = 0;
}

/* No processor missed a change, and no fault came up. */
static void end(void)
{
    pass(400);
    CHECK_EQ(device.faults, 0);
    for (uint32_t i = 0; i < PW_PROCESSORS; i++) {
        CHECK_EQ(all[i].missed_commits, 0);
        CHECK_EQ(all[i].carried_out, seen[i].commits);
    }
}

static uint32_t loads_of(uint8_t kind, uint32_t count)
{
    const uint32_t items = kind == PW_SLOT ? 1u : (kind == PW_STORE_ENTRIES ? 12u : 48u);
    return PW_PROCESSORS * (((kind == PW_SLOT ? 1u : count) + items - 1u) / items);
}

/* A block; returns its acknowledgement. */
static struct pw_ack give(uint8_t kind, uint64_t period, uint16_t count, uint8_t action)
{
    uint8_t block[PW_BLOCK] = {0x50, 0x57, 1, kind};
    struct pw_ack ack;
    number++;
    pw_put32(&block[4], number);
    pw_put64(&block[8], period);
    pw_put16(&block[18], count);
    pw_put16(&block[20], kind == PW_MODULATION ? 1u : 0u);
    block[27] = action;
    if (kind == PW_UPDATE || kind == PW_SLOT) {
        const struct pw_pulse pulse = {(uint8_t)(number % 100u), 3};
        pw_pulse_put(&block[32], (uint16_t)(number % PW_CHANNELS), pulse);
    }
    for (uint32_t i = 0; kind == PW_STORE_ENTRIES && i < count; i++) {
        block[34u + 4u * i] = 3; /* slot 0 for three periods */
    }
    pw_put32(&block[28], pw_crc32(0, block, PW_BLOCK));
    pw_device_block(&device, PW_DOOR_USB, block, sizeof block, device.now, &ack);
    if (ack.reason == PW_ACCEPTED) {
        ordered += pw_kind_is_store(kind) ? loads_of(kind, count) : 0u;
        needed[ack.commit_period % PERIODS] = ordered;
    }
    return ack;
}

/* BUD-004: the rate that holds, for updates as soon as possible; each is in the first period that the links allow. */
static void test_successive_updates(void)
{
    begin("successive updates");
    uint64_t last = 0;
    for (uint32_t i = 0; i < FEW; i++) {
        const struct pw_ack ack = give(PW_UPDATE, 0, 0, 0);
        CHECK_EQ(ack.reason, PW_ACCEPTED);
        CHECK(last == 0u || ack.commit_period == last + PERIODS_APART);
        last = ack.commit_period;
    }
    pass(FEW * PERIODS_APART + 10u);
    CHECK_EQ(seen[0].commits, FEW);
    end();
}

/* BLK-023: the same for updates that name their periods. */
static void test_named_periods(void)
{
    begin("named periods");
    const uint64_t first = device.now / PW_TICKS + 5u;
    for (uint32_t i = 0; i < FEW; i++) {
        const struct pw_ack ack = give(PW_UPDATE, first + i, 0, 0);
        const bool holds = i % PW_PERIODS_PER_UPDATE == 0u;
        CHECK_EQ(ack.reason, holds ? PW_ACCEPTED : PW_RATE);
        CHECK_EQ(ack.commit_period, holds ? first + i : 0u);
        CHECK_EQ(ack.flags & PW_LATE, 0);
    }
    end();
}

/* BUD-007: at least five loads leave after every update, and they delay none. */
static void test_stores_beside_updates(void)
{
    begin("stores beside updates");
    for (uint32_t i = 0; i < FEW; i++) {
        CHECK_EQ(give(PW_UPDATE, 0, 0, 0).reason, PW_ACCEPTED);
    }
    CHECK_EQ(give(PW_STORE_SAMPLES, 0, 480, 0).reason, PW_ACCEPTED);
    for (uint32_t i = 0; i < 2u * FEW; i++) {
        pass(1);
        const uint64_t begun = (clock_now - device.origin) / PW_TICKS * PW_TOKENS_PER_PERIOD;
        CHECK(busy_until <= begun + 2u * PW_TOKENS_PER_PERIOD);
        CHECK(loads == 100u || loads >= 5u * ((i + 1u) / PERIODS_APART));
    }
    end();
    CHECK_EQ(loads, 100);
}

/* CHN-019: a modulation and a sequence wait for their loads, however full the periods before are. */
static void test_programs_follow_loads(void)
{
    for (uint32_t shift = 0; shift < 2u * PW_TICKS; shift += 7u) {
        begin("programs follow loads");
        pass_ticks(shift);
        CHECK_EQ(give(PW_STORE_SAMPLES, 0, 1, 0).reason, PW_ACCEPTED);
        CHECK_EQ(give(PW_MODULATION, 0, 1, 0).reason, PW_ACCEPTED);
        pass(20);
        CHECK_EQ(give(PW_UPDATE, 0, 0, 0).reason, PW_ACCEPTED);
        CHECK_EQ(give(PW_OUTPUT, 0, 0, PW_SILENCE).reason, PW_ACCEPTED);
        CHECK_EQ(give(PW_UPDATE, 0, 0, 0).reason, PW_ACCEPTED);
        CHECK_EQ(give(PW_UPDATE, 0, 0, 0).reason, PW_ACCEPTED);
        CHECK_EQ(give(PW_SLOT, 0, 0, 0).reason, PW_ACCEPTED);
        CHECK_EQ(give(PW_STORE_ENTRIES, 0, 120, 0).reason, PW_ACCEPTED);
        CHECK_EQ(give(PW_SEQUENCE, 0, 120, 0).reason, PW_ACCEPTED);
        pass(100);
        CHECK(all[9].plays.sequence);
        end();
        CHECK_EQ(loads, ordered);
    }
}

/* BLK-005: the fifth period after that of the arrival is in time, at every tick and for every change. */
static void test_fifth_period(void)
{
    static const uint8_t kinds[] = {PW_UPDATE, PW_SEQUENCE, PW_MODULATION, PW_OUTPUT, PW_OUTPUT, PW_OUTPUT};
    begin("fifth period");
    CHECK_EQ(give(PW_SLOT, 0, 0, 0).reason, PW_ACCEPTED);
    pass(20);
    CHECK_EQ(give(PW_STORE_ENTRIES, 0, 1, 0).reason, PW_ACCEPTED);
    CHECK_EQ(give(PW_STORE_SAMPLES, 0, 1, 0).reason, PW_ACCEPTED);
    pass(40);
    for (uint32_t i = 0; i < 6u * PW_TICKS; i++) {
        const uint8_t kind = kinds[i % 6u];
        const uint8_t action = kind == PW_OUTPUT ? (uint8_t)(i % 6u - 2u) : 0u;
        const uint64_t period = device.now / PW_TICKS + 5u;
        if (!pw_state_enabled(device.state)) {
            order(PW_REQ_ENABLE);
        }
        const uint16_t count = kind == PW_SEQUENCE || kind == PW_MODULATION ? 1u : 0u;
        const struct pw_ack ack = give(kind, period, count, action);
        CHECK_EQ(ack.reason, PW_ACCEPTED);
        CHECK_EQ(ack.commit_period, period);
        pass(10);
        pass_ticks(1);
    }
    end();
}

static bool silent(void)
{
    bool good = true;
    for (uint32_t i = 0; i < PW_PROCESSORS; i++) {
        good = good && pw_all_zero(all[i].plays.slice, PW_SLICE) && !all[i].plays.modulation;
    }
    return good;
}

/* Blocks of all kinds, PULSES and DISABLE at any tick: SAF-004 holds, too. */
static void test_any_order(void)
{
    static const uint8_t kinds[] = {PW_UPDATE, PW_UPDATE, PW_SLOT, PW_STORE_ENTRIES, PW_SEQUENCE, PW_STORE_SAMPLES,
                                    PW_MODULATION, PW_OUTPUT};
    begin("any order");
    for (uint32_t i = 0; i < ROUNDS; i++) {
        pass_ticks(check_below(check_below(4) == 0u ? 400u : 40u));
        if (check_below(40) == 0u) {
            const uint64_t asked = device.now / PW_TICKS;
            order(PW_REQ_DISABLE);
            pass_ticks((asked + 6u) * PW_TICKS - (clock_now - device.origin));
            CHECK(silent());
            order(PW_REQ_ENABLE);
        }
        if (!pw_state_enabled(device.state)) {
            order(PW_REQ_ENABLE);
        }
        if (pw_device_has_room(&device)) {
            const uint8_t kind = kinds[check_below(sizeof kinds)];
            const bool counts = kind != PW_UPDATE && kind != PW_SLOT && kind != PW_OUTPUT;
            const bool named = pw_kind_is_change(kind) && check_below(3) == 0u;
            const uint64_t period = named ? device.now / PW_TICKS + check_below(20) : 0u;
            (void)give(kind, period, (uint16_t)(counts ? 1u + check_below(120) : 0u),
                       (uint8_t)(kind == PW_OUTPUT ? 1u + check_below(3) : 0u));
        }
        if (check_below(4) == 0u) {
            const struct pw_setup setup = {PW_REQUEST_IN, PW_REQ_PULSES, 0, 0, 496};
            uint8_t answer[PW_ANSWER];
            uint16_t size = 0;
            if (!device.reading) {
                (void)pw_device_request(&device, PW_DOOR_USB, &setup, answer, &size);
            } else {
                (void)pw_device_answer(&device, PW_DOOR_USB, answer, &size);
            }
        }
    }
    end();
    CHECK(questions > 10u);
}

int main(void)
{
    test_successive_updates();
    test_named_periods();
    test_stores_beside_updates();
    test_programs_follow_loads();
    test_fifth_period();
    test_any_order();
    return check_end();
}
