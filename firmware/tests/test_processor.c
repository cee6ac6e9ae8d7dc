/* One processor, when something goes wrong on its chain or its board, where no case of the suite can look. */
#include "check.h"
#include "processor.h"

#define SYNC (4096u * (uint64_t)PW_TICKS)
#define DEAF (50u * (uint64_t)PW_PERIODS_PER_MS)

static struct pw_processor one;
static uint8_t loud[PW_SLICE], other[PW_SLICE];

static void begin_one(const char *name)
{
    static const uint8_t nothing[8] = {0};
    const struct pw_pulse pulse = {0, 9};
    uint8_t message[PW_MESSAGE];
    uint8_t answer[PW_MESSAGE];
    check_case = name;
    memset(loud, 0, sizeof loud);
    memset(other, 0, sizeof other);
    pw_pulse_put(loud, 3, pulse);
    pw_pulse_put(other, 4, pulse);
    pw_processor_begin(&one, nothing, nothing);
    pw_number_put(message, 3);
    CHECK(pw_processor_message(&one, PW_END_NUMBER, &message[3], 5, false, answer) != 0u);
    pw_processor_sync(&one, 0);
    CHECK(pw_processor_period(&one, 0));
}

static void tell(const uint8_t *message, size_t size)
{
    uint8_t answer[PW_MESSAGE];
    CHECK_EQ(pw_processor_message(&one, message[2], &message[3], size - 3u, false, answer), 0);
}

static struct pw_report ask(void)
{
    struct pw_report report = {0};
    uint8_t message[PW_MESSAGE];
    uint8_t answer[PW_MESSAGE];
    (void)pw_collect_put(message, 3, PW_END_REPORT);
    const size_t size = pw_processor_message(&one, PW_END_COLLECT, &message[3], 5, false, answer);
    CHECK(size != 0u && pw_report_get(&report, &answer[3], size - 3u));
    return report;
}

static void commit(const uint8_t *slice, uint64_t period)
{
    uint8_t message[PW_MESSAGE];
    tell(message, pw_commit_put(message, 3, period, pw_commit_checksum(slice, period)));
}

static void update(const uint8_t *slice, uint64_t period)
{
    uint8_t message[PW_MESSAGE];
    tell(message, pw_slice_put(message, 3, slice));
    commit(slice, period);
}

static bool is_silent(void)
{
    return pw_all_zero((const uint8_t *)one.words, sizeof one.words);
}

static void test_sensors(void)
{
    static const struct {
        int8_t celsius;
        uint16_t millivolts, faults;
    } STEPS[] = {
        {85, 12000, 0}, {86, 15000, PW_FAULT_TEMPERATURE}, {80, 15000, PW_FAULT_TEMPERATURE}, {79, 15000, 0},
        {-40, 11999, PW_FAULT_SUPPLY}, {84, 18000, 0}, {84, 18001, PW_FAULT_SUPPLY},
        {127, 60000, PW_FAULT_SUPPLY | PW_FAULT_TEMPERATURE}, {-1, 12000, 0},
    };
    begin_one("sensors");
    for (size_t i = 0; i < sizeof STEPS / sizeof STEPS[0]; i++) {
        pw_processor_sensors(&one, STEPS[i].celsius, STEPS[i].millivolts);
        const struct pw_report report = ask();
        CHECK_EQ(report.faults, STEPS[i].faults);
        CHECK_EQ((uint8_t)report.temperature_c, (uint8_t)STEPS[i].celsius);
    }
}

static void test_what_came_and_went(void)
{
    begin_one("a supply that was wrong for a moment");
    update(loud, 1);
    (void)pw_processor_period(&one, 1);
    CHECK(!is_silent());
    pw_processor_sensors(&one, 30, 11000);
    (void)pw_processor_period(&one, 2);
    CHECK(is_silent());
    pw_processor_sensors(&one, 30, 15000);
    update(loud, 3);
    (void)pw_processor_period(&one, 3);
    CHECK(is_silent()); /* nobody knows of it yet */
    CHECK_EQ(ask().faults, PW_FAULT_SUPPLY);
    CHECK_EQ(ask().faults, 0);
    update(loud, 4);
    (void)pw_processor_period(&one, 4);
    CHECK(!is_silent());
    CHECK_EQ(ask().missed_commits, 0);
}

static void test_a_hot_processor_misses_nothing(void)
{
    uint8_t message[PW_MESSAGE];
    begin_one("a slice before a boundary and its commit after");
    pw_processor_sensors(&one, 99, 15000);
    tell(message, pw_slice_put(message, 3, loud));
    (void)pw_processor_period(&one, 1);
    commit(loud, 2);
    (void)pw_processor_period(&one, 2);
    const struct pw_report report = ask();
    CHECK_EQ(report.faults, PW_FAULT_TEMPERATURE);
    CHECK_EQ(report.carried_out, 1);
    CHECK(is_silent());
}

static void test_sync(void)
{
    static const int8_t OFF[] = {0, 1, -1, 2, -2};
    for (size_t i = 0; i < sizeof OFF; i++) {
        begin_one("a pulse that is off");
        one.period = 4096u;
        pw_processor_sync(&one, SYNC + (uint64_t)(int64_t)OFF[i]);
        const struct pw_report report = ask();
        CHECK_EQ((uint8_t)report.drift, (uint8_t)OFF[i]);
        CHECK_EQ(report.faults, i < 3u ? 0 : PW_FAULT_SYNC);
    }
    begin_one("a pulse that is missing");
    update(loud, 4000);
    for (uint64_t period = 1; period <= 4096u; period++) {
        (void)ask();
        (void)pw_processor_period(&one, period);
    }
    CHECK_EQ(ask().faults, 0); /* it may still come */
    CHECK(!is_silent());
    (void)pw_processor_period(&one, 4097);
    CHECK(is_silent());
    pw_processor_sync(&one, 2u * SYNC + 1u);
    CHECK_EQ((uint8_t)ask().drift, 1); /* it is the one before that was missing */
    CHECK_EQ(ask().faults, PW_FAULT_SYNC);
    begin_one("no first pulse");
    one.synced = false;
    CHECK_EQ(ask().faults, PW_FAULT_SYNC);
}

static void test_alone(void)
{
    begin_one("nobody asks");
    update(loud, 1);
    (void)pw_processor_period(&one, 1);
    (void)ask();
    for (uint64_t period = 2; period <= DEAF + 1u; period++) {
        (void)pw_processor_period(&one, period);
    }
    CHECK(!is_silent());
    (void)pw_processor_period(&one, DEAF + 2u);
    CHECK(is_silent());
    update(loud, DEAF + 3u);
    (void)pw_processor_period(&one, DEAF + 3u);
    CHECK(!is_silent());
    CHECK_EQ(ask().faults, PW_FAULT_CHAIN);
}

static void load_two_entries(void)
{
    uint8_t message[PW_MESSAGE];
    struct pw_load load = {PW_MEMORY_SLOTS, 0, 1, {0}};
    memcpy(load.data, loud, PW_SLICE);
    tell(message, pw_load_put(message, 3, &load));
    load.first = 1;
    memcpy(load.data, other, PW_SLICE);
    tell(message, pw_load_put(message, 3, &load));
    const struct pw_load entries = {PW_MEMORY_ENTRIES, 0, 2, {0, 0, 3, 0, 1, 0, 3, 0}};
    tell(message, pw_load_put(message, 3, &entries));
}

static void start_at(uint64_t period)
{
    uint8_t message[PW_MESSAGE];
    const struct pw_program program = {PW_MEMORY_ENTRIES, 0, 2, 0, 0, period};
    tell(message, pw_program_put(message, 3, &program));
}

static void test_overrun(void)
{
    begin_one("an update that is not ready");
    update(loud, 1);
    (void)pw_processor_period(&one, 1);
    update(other, 2);
    CHECK_EQ(ask().carried_out, 2);
    (void)pw_processor_period(&one, 2);
    pw_processor_overrun(&one);
    struct pw_report report = ask();
    CHECK_EQ(report.faults, PW_FAULT_CHAIN | PW_FAULT_OVERRUN);
    CHECK_EQ(report.carried_out, 1);
    CHECK_EQ(report.missed_commits, 1);
    CHECK(pw_processor_period(&one, 3));
    CHECK_BYTES(one.plays.slice, loud, PW_SLICE);
    CHECK_EQ(one.plays.since, 1);
    CHECK(!pw_processor_period(&one, 4));
    begin_one("a sequence that is not ready");
    load_two_entries();
    start_at(1);
    (void)pw_processor_period(&one, 1);
    pw_processor_overrun(&one);
    report = ask();
    CHECK_EQ(report.missed_commits, 1);
    CHECK_EQ(report.carried_out, 0);
    CHECK(!one.plays.sequence);
    begin_one("a step that is not ready");
    load_two_entries();
    start_at(1);
    for (uint64_t period = 1; period <= 4u; period++) {
        (void)pw_processor_period(&one, period);
    }
    pw_processor_overrun(&one);
    CHECK(pw_processor_period(&one, 5)); /* its words are made anew, and it keeps its time */
    CHECK_BYTES(one.plays.slice, other, PW_SLICE);
    (void)pw_processor_period(&one, 6);
    CHECK_BYTES(one.plays.slice, other, PW_SLICE);
    (void)pw_processor_period(&one, 7);
    CHECK_BYTES(one.plays.slice, loud, PW_SLICE);
    report = ask();
    CHECK_EQ(report.faults, PW_FAULT_OVERRUN);
    CHECK_EQ(report.missed_commits, 0);
}

static void test_silence_outlasts_an_overrun(void)
{
    begin_one("what began with the silence does not come back");
    update(loud, 1);
    (void)pw_processor_period(&one, 1);
    update(other, 2);
    pw_processor_sensors(&one, 99, 15000);
    (void)pw_processor_period(&one, 2);
    pw_processor_overrun(&one);
    CHECK(pw_all_zero(one.plays.slice, PW_SLICE));
}

int main(void)
{
    test_sensors();
    test_what_came_and_went();
    test_a_hot_processor_misses_nothing();
    test_sync();
    test_alone();
    test_overrun();
    test_silence_outlasts_an_overrun();
    return check_end();
}
