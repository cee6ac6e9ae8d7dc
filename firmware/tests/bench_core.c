/* What a controller does for each update, by how much time: check with CRC, power, sort, and ten commit checksums. */
#define _POSIX_C_SOURCE 199309L

#include <stdio.h>
#include <string.h>
#include <time.h>

#include "blk.h"
#include "chn.h"
#include "pul.h"
#include "sums.h"

#define BLOCKS 16u
#define ROUNDS 200000u
#define FEWER 20000u

static uint8_t blocks[BLOCKS][PW_BLOCK];
static uint16_t wiring[PW_CHANNELS];
static uint8_t slices[PW_PROCESSORS][PW_SLICE];
static uint32_t words[PW_TICKS];
static uint32_t kept; /* of every result, so that none is left out */

static void make_blocks(void)
{
    for (uint32_t n = 0; n < BLOCKS; n++) {
        uint8_t *block = blocks[n];
        (void)memset(block, 0, PW_BLOCK);
        block[0] = 0x50;
        block[1] = 0x57;
        block[2] = 1;
        block[3] = PW_UPDATE;
        pw_put32(&block[4], n);
        pw_put64(&block[8], 1000u + n);
        for (uint32_t i = 0; i < PW_CHANNELS; i++) {
            const struct pw_pulse pulse = { (uint8_t)((i * (7u + n)) % 100u), (uint8_t)((i + n) % 26u) };
            pw_pulse_put(&block[32], i, pulse);
        }
        pw_put32(&block[28], pw_crc32(0, block, PW_BLOCK));
    }
    for (uint32_t i = 0; i < PW_CHANNELS; i++) {
        wiring[i] = (uint16_t)((i * 77u) % PW_CHANNELS); /* 77 and 320 have no common divisor */
    }
}

static void run_check(uint32_t round)
{
    struct pw_block block;
    kept += (uint32_t)pw_block_check(blocks[round % BLOCKS], PW_BLOCK, &block);
}

static void run_crc(uint32_t round)
{
    kept += pw_crc32(0, blocks[round % BLOCKS], PW_BLOCK);
}

static void run_power(uint32_t round)
{
    kept += pw_pulses_power(&blocks[round % BLOCKS][32], PW_CHANNELS);
}

static void run_sort(uint32_t round)
{
    pw_pulses_sort(&blocks[round % BLOCKS][32], wiring, slices);
    kept += slices[round % PW_PROCESSORS][0];
}

static void run_commits(uint32_t round)
{
    for (uint32_t processor = 0; processor < PW_PROCESSORS; processor++) {
        kept += pw_commit_checksum(slices[processor], round);
    }
}

static void run_update(uint32_t round)
{
    run_check(round);
    run_power(round);
    run_sort(round);
    run_commits(round);
}

static void run_rasterise(uint32_t round)
{
    pw_rasterise(&blocks[round % BLOCKS][32], 255, words);
    kept += words[round % PW_TICKS];
}

static void run_modulate(uint32_t round)
{
    pw_rasterise(&blocks[round % BLOCKS][32], (uint8_t)(round & 0xFFu), words);
    kept += words[round % PW_TICKS];
}

/* The shortest of five runs: other work on the machine only makes one longer. */
static double nanoseconds(void (*work)(uint32_t round), uint32_t rounds)
{
    double best = 1e9;
    for (int run = 0; run < 5; run++) {
        struct timespec begin;
        struct timespec end;
        double taken;
        (void)clock_gettime(CLOCK_MONOTONIC, &begin);
        for (uint32_t round = 0; round < rounds; round++) {
            work(round);
        }
        (void)clock_gettime(CLOCK_MONOTONIC, &end);
        taken = ((double)(end.tv_sec - begin.tv_sec) * 1e9) + (double)(end.tv_nsec - begin.tv_nsec);
        best = ((taken / rounds) < best) ? (taken / rounds) : best;
    }
    return best;
}

int main(void)
{
    static const struct {
        const char *name;
        void (*work)(uint32_t round);
    } parts[] = {
        { "check, with the CRC", run_check },
        { "  of which the CRC", run_crc },
        { "power", run_power },
        { "sort", run_sort },
        { "ten commit checksums", run_commits },
        { "rasterise one slice", run_rasterise },
        { "rasterise, modulated", run_modulate },
    };
    double update;
    make_blocks();
    for (size_t i = 0; i < (sizeof parts / sizeof parts[0]); i++) {
        printf("%-22s %7.0f ns\n", parts[i].name, nanoseconds(parts[i].work, FEWER));
    }
    update = nanoseconds(run_update, ROUNDS);
    printf("%-22s %7.0f ns, %.0f updates/s\n", "an update", update, 1e9 / update);
    printf("(%08lX)\n", (unsigned long)kept);
    return (update < 5000.0) ? 0 : 1; /* 200 000 updates/s */
}
