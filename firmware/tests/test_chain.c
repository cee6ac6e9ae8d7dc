/* The controller with ten processors, when messages are lost, damaged or stuck, where no case of the conformance suite
   can look or cause it. */
#include "check.h"
#include "device.h"
#include "processor.h"
#include "sums.h"

#define CHANNEL(node, bit) (PW_PORT_BITS * (node) + (bit))

static struct pw_processor all[PW_PROCESSORS];
static struct pw_device device;
static uint16_t wiring[PW_CHANNELS];
static uint64_t clock_now;
static uint8_t answers[64][PW_MESSAGE];
static size_t sizes[64], waiting;
/* What befalls messages to processor 3. */
static uint8_t lost_end;     /* channel end of those that do not arrive */
static uint32_t lost;        /* how many */
static uint32_t collects, programs; /* to it */
static uint32_t sent, leave;        /* messages, and how many leave */
static bool damage;          /* answers */

static uint64_t now(void *self)
{
    (void)self;
    return clock_now;
}

static bool befalls(const uint8_t *message)
{
    collects += message[2] == PW_END_COLLECT ? 1u : 0u;
    programs += message[2] == PW_END_PROGRAM ? 1u : 0u;
    if (message[2] != lost_end || lost == 0u) {
        return false;
    }
    lost--;
    return true;
}

static bool send(void *self, const uint8_t *message, size_t size)
{
    (void)self;
    uint32_t to = message[0] == 0u ? message[1] : 0u;
    while (message[0] != 0u && all[to].number != PW_NO_NUMBER) {
        to++;
    }
    sent++;
    if (sent > leave) {
        return false;
    }
    if (to == 3u && befalls(message)) {
        return true;
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

static void blink(void *self, uint8_t board)
{
    (void)self;
    (void)board;
}

/* The seam of processors that get their programs from the controller. */
static uint32_t restarts, tries, fails;
static uint8_t programmed, fails_at;

static void restart(void *self)
{
    static const uint8_t nothing[8] = {0};
    (void)self;
    restarts++;
    programmed = 0;
    for (uint32_t i = 0; i < PW_PROCESSORS; i++) {
        pw_processor_begin(&all[i], nothing, nothing);
    }
}

static bool program(void *self, uint8_t processor)
{
    (void)self;
    tries++;
    clock_now += 6600u; /* 64 KiB on two wires: 3.3 ms */
    CHECK_EQ(processor, programmed);
    for (uint32_t i = 0; i < PW_PROCESSORS; i++) { /* those before it have their numbers, and no other */
        CHECK_EQ(all[i].number, i < processor ? i : PW_NO_NUMBER);
    }
    if (processor == fails_at && fails != 0u) {
        fails--;
        return false;
    }
    programmed++;
    return true;
}

static const struct pw_port port = {.now = now, .chain = send, .sync = sync_line, .identify = blink};
static const struct pw_port programming = {
    .now = now, .chain = send, .sync = sync_line, .restart_processors = restart, .program = program,
};
static const struct pw_about about = {
    {1, 2, 3, 4, 5, 6, 7, 8}, {1, 2, 3}, PW_BANK_A, 0, 1, "chain", "PW-0001", wiring, 20, 16, 10300,
};

static void work(void)
{
    pw_device_poll(&device);
    for (size_t i = 0; i < waiting; i++) {
        answers[i][sizes[i] - 1u] ^= damage ? 1u : 0u;
        pw_device_chain(&device, answers[i][2], &answers[i][3], sizes[i] - 3u);
    }
    waiting = 0;
    pw_device_poll(&device);
}

static void pass(uint64_t periods)
{
    for (uint64_t i = 0; i < periods; i++) {
        clock_now += PW_TICKS;
        for (uint32_t k = 0; k < PW_PROCESSORS; k++) {
            (void)pw_processor_period(&all[k], (clock_now - device.origin) / PW_TICKS);
        }
        work();
    }
}

static bool order(uint8_t request)
{
    const struct pw_setup setup = {PW_REQUEST_OUT, request, 0, 0, 0};
    uint8_t answer[PW_ANSWER];
    uint16_t size = 0;
    return pw_device_request(&device, PW_DOOR_USB, &setup, answer, &size) == PW_ANSWERED;
}

static void begin_all(const char *name)
{
    static const uint8_t nothing[8] = {0};
    check_case = name;
    clock_now = 0;
    waiting = 0;
    lost = 0;
    sent = 0;
    leave = UINT32_MAX;
    damage = false;
    for (uint16_t i = 0; i < PW_CHANNELS; i++) {
        wiring[i] = i;
    }
    for (uint32_t i = 0; i < PW_PROCESSORS; i++) {
        pw_processor_begin(&all[i], nothing, nothing);
    }
    pw_device_begin(&device, &port, &about);
    while (!pw_device_serving(&device) && clock_now < 10u * PW_TICKS) {
        work();
        clock_now += waiting == 0u && !pw_device_serving(&device) ? PW_TICKS : 0u;
        for (size_t i = 0; i < waiting; i++) {
            pw_device_chain(&device, answers[i][2], &answers[i][3], sizes[i] - 3u);
        }
        waiting = 0;
    }
    device.watchdog_ms = 60000;
    CHECK(pw_device_serving(&device));
    CHECK(order(PW_REQ_ENABLE));
    pass(420);
    CHECK_EQ(device.faults, 0);
}

/* Play on one transducer of processor 3. */
static void play_tone(void)
{
    CHECK_EQ(pw_device_test(&device, PW_DOOR_USB, CHANNEL(3u, 5u)), PW_ACCEPTED);
    pass(10);
    CHECK_EQ(device.state, PW_STATE_PLAYING);
}

static bool three_is_silent(void)
{
    return pw_all_zero(all[3].plays.slice, PW_SLICE);
}

static void modulate(void)
{
    uint8_t block[PW_BLOCK] = {0};
    struct pw_ack ack;
    const uint8_t kinds[2] = {PW_STORE_SAMPLES, PW_MODULATION};
    for (uint32_t i = 0; i < 2u; i++) {
        memset(block, 0, sizeof block);
        block[0] = (uint8_t)'P';
        block[1] = (uint8_t)'W';
        block[2] = 1;
        block[3] = kinds[i];
        pw_put32(&block[4], 1u + i);
        pw_put16(&block[18], 1);
        pw_put16(&block[20], i);
        block[32] = kinds[i] == PW_STORE_SAMPLES ? 100u : 0u;
        pw_put32(&block[28], pw_crc32(0, block, PW_BLOCK));
        pw_device_block(&device, PW_DOOR_USB, block, sizeof block, device.now, &ack);
        CHECK_EQ(ack.reason, PW_ACCEPTED);
        pass(30);
    }
    CHECK(device.modulates);
}

static void test_a_damaged_answer(void)
{
    begin_all("a damaged answer");
    damage = true;
    pass(40);
    damage = false;
    CHECK_EQ(device.faults, PW_FAULT_CHAIN);
    CHECK(order(PW_REQ_CLEAR_FAULTS));
    pass(800);
    CHECK_EQ(device.faults, 0);
}

static void test_a_lost_processor(void)
{
    begin_all("a processor that is lost and found");
    lost_end = PW_END_COLLECT;
    lost = 3;
    pass(1240);
    CHECK_EQ(device.faults, PW_FAULT_PROCESSOR);
    CHECK_EQ(device.state, PW_STATE_FAULT);
    CHECK(order(PW_REQ_CLEAR_FAULTS));
    CHECK_EQ(device.state, PW_STATE_FAULT);
    pass(400);
    CHECK_EQ(lost, 0);
    pw_device_listen(&device, PW_DOOR_LINE(0u), true);
    CHECK(order(PW_REQ_CLEAR_FAULTS));
    CHECK_EQ(device.state, PW_STATE_OFF);
    CHECK_EQ(device.told[PW_DOOR_LINE(0u)].state, PW_STATE_OFF);
    CHECK_EQ(device.told[PW_DOOR_LINE(0u)].faults, 0);
}

static void test_a_lost_silence(void)
{
    begin_all("the silence, and the stop of a modulation, come again");
    play_tone();
    modulate();
    lost_end = PW_END_COMMIT;
    lost = 1;
    programs = 0;
    CHECK(order(PW_REQ_DISABLE));
    pass(6);
    CHECK(!three_is_silent());
    CHECK_EQ(programs, 1);
    pass(420);
    CHECK(three_is_silent());
    CHECK_EQ(programs, 2);
    pass(2200);
    CHECK_EQ(programs, 2);
}

static void test_a_deaf_processor(void)
{
    const struct pw_setup setup = {PW_REQUEST_IN, PW_REQ_PULSES, 0, 0, 496};
    uint8_t answer[PW_ANSWER];
    uint16_t size = 0;
    begin_all("a processor that is to fall silent by itself is not asked anything");
    play_tone();
    lost_end = PW_END_SLICE;
    lost = 2;
    CHECK(order(PW_REQ_DISABLE));
    pass(400);
    CHECK(!three_is_silent());
    collects = 0;
    CHECK_EQ(pw_device_request(&device, PW_DOOR_USB, &setup, answer, &size), PW_LATER);
    pass(600);
    CHECK_EQ(pw_device_answer(&device, PW_DOOR_USB, answer, &size), PW_ANSWERED);
    CHECK_EQ(pw_get64(answer), UINT64_MAX);
    pass(900);
    CHECK_EQ(collects, 0);
    pass(500);
    CHECK(three_is_silent());
    pass(400);
    CHECK(collects != 0u);
    CHECK_EQ(device.faults, PW_FAULT_CHAIN);
}

static void test_a_broken_chain(void)
{
    for (uint32_t left = 0; left < 20u; left++) {
        begin_all("a message that cannot leave");
        play_tone();
        CHECK_EQ(pw_device_test(&device, PW_DOOR_USB, CHANNEL(3u, 6u)), PW_ACCEPTED);
        leave = sent + left;
        pass(8);
        CHECK_EQ(device.faults, PW_FAULT_CHAIN | PW_FAULT_PROCESSOR);
        CHECK_EQ(device.state, PW_STATE_FAULT);
        CHECK_EQ(sent, leave + 1u); /* nothing after it */
        CHECK(order(PW_REQ_CLEAR_FAULTS));
        CHECK_EQ(device.faults, PW_FAULT_CHAIN | PW_FAULT_PROCESSOR);
        pass(2100);
        CHECK_EQ(sent, leave + 1u);
        CHECK(three_is_silent());
        CHECK_EQ(device.change_count, 0);
        CHECK_EQ(pw_device_has_room(&device) ? 1 : 0, 1);
    }
}

/* Power-up or RESET of a chain whose processors have no programs of their own. */
static void start_all(uint8_t place, uint32_t failures)
{
    fails_at = place;
    fails = failures;
    tries = 0;
    sent = 0;
    waiting = 0;
    pw_device_begin(&device, &programming, &about);
    for (uint32_t i = 0; i < 30u; i++) {
        work();
    }
    CHECK(pw_device_serving(&device));
}

static void test_programs(void)
{
    check_case = "programs";
    clock_now = 0;
    restarts = 0;
    leave = UINT32_MAX;
    for (uint32_t life = 1; life <= 3u; life++) { /* CHN-021: RESET starts the processors anew */
        start_all(0, 0);
        CHECK_EQ(restarts, life);
        CHECK_EQ(tries, PW_PROCESSORS);
        CHECK_EQ(device.faults, 0);
        CHECK(device.origin >= life * 66000u); /* after the last program */
        CHECK(order(PW_REQ_ENABLE));
        pass(420);
        CHECK_EQ(device.faults, 0);
    }
    for (uint8_t place = 0; place < PW_PROCESSORS; place++) { /* FWU-021: three attempts */
        start_all(place, 2);
        CHECK_EQ(tries, PW_PROCESSORS + 2u);
        CHECK_EQ(device.faults, 0);
        start_all(place, 3);
        CHECK_EQ(tries, place + 3u);
        CHECK_EQ(device.numbered, place);
        CHECK_EQ(device.faults, PW_FAULT_PROCESSOR);
        CHECK_EQ(device.state, PW_STATE_FAULT);
        CHECK(!order(PW_REQ_ENABLE));
    }
}

int main(void)
{
    test_programs();
    test_a_damaged_answer();
    test_a_lost_processor();
    test_a_lost_silence();
    test_a_deaf_processor();
    test_a_broken_chain();
    return check_end();
}
