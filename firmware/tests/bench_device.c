/* How many updates a second the controller judges, plans and sends: each block whole, then the period in which its
   slices and commits leave. The chain takes the messages and answers nothing. Fails below 200 000/s. */
#define _POSIX_C_SOURCE 200809L /* clock_gettime */

#include <stdio.h>
#include <string.h>
#include <time.h>

#include "device_parts.h"
#include "sums.h"

#define UPDATES 200000u
#define ROUNDS 5u
#define LEAST_PER_SECOND 200000.0
#define BLOCKS 16u

static struct pw_device device;
static uint16_t wiring[PW_CHANNELS];
static uint8_t blocks[BLOCKS][PW_BLOCK];
static uint64_t tick;
static uint64_t messages;

static uint64_t port_now(void *self)
{
    (void)self;
    return tick;
}

static bool port_chain(void *self, const uint8_t *message, size_t size)
{
    (void)self;
    messages += message[size - 1u] & 1u; /* read, so that it has to be written */
    return true;
}

static void port_sync(void *self)
{
    (void)self;
}

static const struct pw_port port = {.now = port_now, .chain = port_chain, .sync = port_sync};
static const struct pw_about about = {.wiring = wiring, .serial_number = "BENCH", .product_name = "BENCH"};

static double seconds(void)
{
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static void make_blocks(void)
{
    for (uint32_t n = 0; n < BLOCKS; n++) {
        memcpy(blocks[n], "PW\1\1", 4);
        blocks[n][26] = PW_RESTART; /* so that 16 blocks serve for all numbers */
        for (uint32_t i = 0; i < PW_CHANNELS; i++) {
            const struct pw_pulse pulse = {(uint8_t)((i * 7u + n) % 100u), (uint8_t)((i + n) % 26u)};
            pw_pulse_put(blocks[n] + 32, i, pulse);
        }
        pw_put32(blocks[n] + 28, pw_crc32(0, blocks[n], PW_BLOCK));
    }
}

static double one_round(void)
{
    struct pw_ack ack;
    uint32_t accepted = 0;
    const double began = seconds();
    for (uint32_t i = 0; i < UPDATES; i++) {
        tick += PW_TICKS;
        pw_device_poll(&device);
        pw_device_block(&device, PW_DOOR_USB, blocks[i % BLOCKS], PW_BLOCK, device.now, &ack);
        accepted += ack.reason == PW_ACCEPTED ? 1u : 0u;
    }
    const double taken = seconds() - began;
    return accepted == UPDATES ? UPDATES / taken : 0.0;
}

int main(void)
{
    double best = 0.0;
    for (uint16_t i = 0; i < PW_CHANNELS; i++) {
        wiring[i] = (uint16_t)((i * 7u) % PW_CHANNELS);
    }
    make_blocks();
    pw_device_begin(&device, &port, &about);
    device.serving = true;
    device.collect_at = PW_NEVER;
    pw_event(&device, PW_EVENT_ENABLE, PW_NO_DOOR);
    for (uint32_t round = 0; round < ROUNDS; round++) {
        const double rate = one_round();
        best = rate > best ? rate : best;
    }
    printf("%.0f updates/s judged, planned and sent as ten slices and ten commits, best of %u rounds of %u\n", best,
           ROUNDS, UPDATES);
    return best >= LEAST_PER_SECOND ? 0 : 1;
}
