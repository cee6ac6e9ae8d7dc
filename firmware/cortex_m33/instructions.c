/* The worst case of each kind of block in instructions of a Cortex-M33. QEMU counts them: with -icount shift=0 one takes a
   nanosecond, and the SysTick timer counts every 50 of them on an mps2-an505. */
#include <stdio.h>
#include <string.h>

#include "device_parts.h"
#include "processor.h"
#include "sums.h"

#define TICK_INSTRUCTIONS 50u
#define SYST_CSR (*(volatile uint32_t *)0xE000E010u)
#define SYST_RVR (*(volatile uint32_t *)0xE000E014u)
#define SYST_CVR (*(volatile uint32_t *)0xE000E018u)
#define SYST_MAX 0xFFFFFFu

static struct pw_device device;
static struct pw_processor processor;
static uint16_t wiring[PW_CHANNELS];
static uint64_t tick;
static uint32_t number;

static uint64_t port_now(void *self)
{
    (void)self;
    return tick;
}

static bool port_chain(void *self, const uint8_t *message, size_t size)
{
    (void)self;
    return message[0] != 0xFEu || size != 0u;
}

static void port_sync(void *self)
{
    (void)self;
}

static const struct pw_port port = {.now = port_now, .chain = port_chain, .sync = port_sync};
static const struct pw_about about = {.wiring = wiring, .serial_number = "M33", .product_name = "M33"};

static uint32_t begin_count(void)
{
    return SYST_CVR;
}

static uint32_t end_count(uint32_t before)
{
    return ((before - SYST_CVR) & SYST_MAX) * TICK_INSTRUCTIONS;
}

/* A device that serves, without its chain: nothing answers, and nothing is asked. */
static void begin(void)
{
    tick = 0;
    number = 0;
    pw_device_begin(&device, &port, &about);
    device.serving = true;
    device.numbered = PW_PROCESSORS;
    device.collect_at = PW_NEVER;
    pw_event(&device, PW_EVENT_ENABLE, PW_NO_DOOR);
    device.watchdog_ms = 60000;
}

static void make(uint8_t block[PW_BLOCK], uint8_t kind)
{
    memset(block, 0, PW_BLOCK);
    memcpy(block, "PW\1", 3);
    block[3] = kind;
    number++;
    pw_put32(block + 4, number);
}

static uint32_t cost(uint8_t block[PW_BLOCK], const char *what)
{
    struct pw_ack ack;
    pw_put32(block + 28, pw_crc32(0, block, PW_BLOCK)); /* the field is 0 until here */
    const uint32_t before = begin_count();
    pw_device_block(&device, PW_DOOR_USB, block, PW_BLOCK, device.now, &ack);
    const uint32_t taken = end_count(before);
    if (what != NULL) {
        (void)printf("  %8lu  %s%s\n", (unsigned long)taken, what, ack.reason == PW_ACCEPTED ? "" : ", refused");
    }
    return taken;
}

/* Let so many periods pass; the most instructions that one of them took. */
static uint32_t pass(uint32_t periods)
{
    uint32_t most = 0;
    for (uint32_t i = 0; i < periods; i++) {
        tick += PW_TICKS;
        const uint32_t before = begin_count();
        pw_device_poll(&device);
        const uint32_t taken = end_count(before);
        most = taken > most ? taken : most;
    }
    return most;
}

static void fill(uint8_t block[PW_BLOCK], uint8_t width)
{
    for (uint32_t i = 0; i < PW_CHANNELS; i++) {
        const struct pw_pulse pulse = {(uint8_t)(i % 100u), width};
        pw_pulse_put(block + 32, i, pulse);
    }
}

/* Every entry and every sample stored, so that the longest sequence and modulation can play. */
static void store_all(void)
{
    uint8_t block[PW_BLOCK];
    for (uint32_t slot = 0; slot < PW_SLOTS; slot++) {
        make(block, PW_SLOT);
        pw_put16(block + 16, slot);
        fill(block, 12);
        (void)cost(block, slot == 255u ? "SLOT" : NULL);
        (void)pass(2);
    }
    for (uint32_t first = 0; first < PW_ENTRIES; first += 64u) {
        make(block, PW_STORE_ENTRIES);
        pw_put16(block + 16, first);
        pw_put16(block + 18, 64);
        for (uint32_t i = 0; i < 64u; i++) {
            pw_put16(block + 32 + 4u * (size_t)i, i % PW_SLOTS);
            pw_put16(block + 34 + 4u * (size_t)i, 1);
        }
        (void)cost(block, NULL);
        (void)pass(20);
    }
    for (uint32_t first = 0; first < PW_SAMPLES; first += 256u) {
        make(block, PW_STORE_SAMPLES);
        pw_put16(block + 16, first);
        pw_put16(block + 18, 256);
        memset(block + 32, 200, 256);
        (void)cost(block, NULL);
        (void)pass(20);
    }
}

static void kinds(void)
{
    uint8_t block[PW_BLOCK];
    make(block, PW_UPDATE);
    fill(block, 25);
    (void)cost(block, "UPDATE");
    make(block, PW_STORE_ENTRIES);
    pw_put16(block + 18, 120);
    for (uint32_t i = 0; i < 120u; i++) {
        pw_put16(block + 34 + 4u * (size_t)i, 1);
    }
    (void)cost(block, "ENTRIES, 120 of them");
    (void)pass(60);
    make(block, PW_STORE_SAMPLES);
    pw_put16(block + 18, 480);
    (void)cost(block, "SAMPLES, 480 of them");
    (void)pass(60);
    make(block, PW_SEQUENCE);
    pw_put16(block + 18, PW_ENTRIES);
    (void)cost(block, "SEQUENCE, of 1024 entries");
    make(block, PW_MODULATION);
    pw_put16(block + 18, PW_SAMPLES);
    pw_put16(block + 20, 1);
    (void)cost(block, "MODULATION, of 4096 samples");
    make(block, PW_OUTPUT);
    block[27] = PW_SILENCE;
    (void)cost(block, "OUTPUT");
    make(block, PW_CLOCK);
    (void)cost(block, "CLOCK");
    make(block, PW_NO_OP);
    (void)cost(block, "NO_OP");
    make(block, PW_STORE_SAMPLES);
    pw_put16(block + 18, 480);
    (void)cost(block, "SAMPLES in use");
    make(block, PW_UPDATE);
    block[511] = 0xFF;
    block[510] = 0xFF;
    (void)cost(block, "UPDATE with a reserved pulse");
}

static void periods(void)
{
    uint8_t block[PW_BLOCK];
    (void)pass(20);
    uint32_t most = 0;
    for (uint32_t i = 0; i < 40u; i++) {
        make(block, PW_UPDATE);
        fill(block, (uint8_t)(i % 26u));
        (void)cost(block, NULL);
        const uint32_t taken = pass(1);
        most = taken > most ? taken : most;
    }
    (void)printf("  %8lu  a period of a stream: ten commits and ten slices leave\n", (unsigned long)most);
}

static void of_a_processor(void)
{
    static const uint8_t none[8] = {0};
    uint8_t slice[PW_SLICE];
    for (uint32_t i = 0; i < PW_PORT_BITS; i++) {
        const struct pw_pulse pulse = {(uint8_t)(3u * i), (uint8_t)(i % 26u)};
        pw_pulse_put(slice, i, pulse);
    }
    pw_processor_begin(&processor, none, none);
    uint32_t before = begin_count();
    pw_rasterise(slice, 255, processor.words);
    (void)printf("  %8lu  rasterising 32 pulses\n", (unsigned long)end_count(before));
    before = begin_count();
    pw_rasterise(slice, 99, processor.words);
    (void)printf("  %8lu  rasterising them under a modulation\n", (unsigned long)end_count(before));
}

int main(void)
{
    for (uint16_t i = 0; i < PW_CHANNELS; i++) {
        wiring[i] = (uint16_t)((i * 7u) % PW_CHANNELS);
    }
    SYST_RVR = SYST_MAX;
    SYST_CVR = 0;
    SYST_CSR = 5; /* on, by the processor's clock */
    (void)printf("instructions to judge and plan a block, worst case, all stores filled:\n");
    begin();
    store_all();
    kinds();
    (void)printf("instructions of the controller's period, and of a processor's:\n");
    begin();
    periods();
    of_a_processor();
    return 0;
}
