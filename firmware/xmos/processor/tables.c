/* What is computed once, before the threads start. */
#include "processor.h"

#include "hardware.h"

struct message play_ring[PLAY_MESSAGES], handle_ring[HANDLE_MESSAGES];
uint32_t slots[SLOTS][SLICE_WORDS];
uint32_t entries[ENTRIES];
uint8_t samples[SAMPLES];
uint32_t no_edges[TICKS];
uint32_t tables[3][TICKS];
uint32_t silent_table[TICKS];
uint8_t pulse_begins[CODES], pulse_ends[CODES];
uint8_t widths[SAMPLE_VALUES * WIDTHS + 6u];

/* PUL-006 without a sine. A pulse of width w gets at least the width v if s/255 sin(pi w/50) >= sin(pi (v - 1/2)/50). Both
   sides are multiplied by 255 * 2^24, which fits 32 bits. The rounding moves the bound by 2e-5 of a tick at most, and no
   value is nearer to it than 9e-5. */
static const uint32_t amplitudes[WIDTHS] = { /* 2^24 sin(pi w/50) */
    0,        1053450,  2102743,  3143737,  4172324,  5184445,  6176105,  7143391,  8082485,
    8989682,  9861400,  10694200, 11484795, 12230064, 12927067, 13573053, 14165472, 14701986,
    15180479, 15599061, 15956081, 16250129, 16480045, 16644923, 16744110, 16777216
};
static const uint32_t bounds[WIDTHS] = { /* 255 * 2^24 sin(pi (v - 1/2)/50); of width 0 there is none */
    0,           134381198u,  402613252u,  669256377u,  933258251u,  1193576982u, 1449185210u, 1699074166u, 1942257652u,
    2177775935u, 2404699531u, 2622132877u, 2829217862u, 3025137217u, 3209117737u, 3380433336u, 3538407908u, 3682418001u,
    3811895273u, 3926328735u, 4025266772u, 4108318920u, 4175157410u, 4225518461u, 4259203321u, 4276079051u
};

/* A wider pulse never becomes narrower than a narrower one, so one walk finds all. */
static void widths_under(uint32_t sample, uint8_t *row)
{
    uint32_t modulated = 0;
    for (uint32_t width = 0; width < WIDTHS; width++) {
        const uint32_t amplitude = sample * amplitudes[width];
        while (modulated < width && amplitude >= bounds[modulated + 1u]) {
            modulated++;
        }
        row[width] = (uint8_t)modulated;
    }
}

/* PUL-004. A pulse that ends with the period ends at tick 0. */
static void edges_of_pulses(void)
{
    for (uint32_t width = 1; width < WIDTHS; width++) {
        for (uint32_t phase = 0; phase < PHASES; phase++) {
            uint32_t begin = (phase + 2u * TICKS - width) >> 1;
            begin -= begin >= TICKS ? TICKS : 0u;
            uint32_t end = begin + width;
            end -= end >= TICKS ? TICKS : 0u;
            pulse_begins[width << 7 | phase] = (uint8_t)begin;
            pulse_ends[width << 7 | phase] = (uint8_t)end;
        }
    }
}

static void ring_begin(struct message *ring, uint32_t count)
{
    for (uint32_t place = 0; place < count; place++) {
        ring[place].next = &ring[place + 1u == count ? 0u : place + 1u];
    }
}

void memories_begin(void)
{
    ring_begin(play_ring, PLAY_MESSAGES);
    ring_begin(handle_ring, HANDLE_MESSAGES);
    next_table = silent_table;
    edges_of_pulses();
    for (uint32_t sample = 0; sample < SAMPLE_VALUES; sample++) {
        widths_under(sample, &widths[sample * WIDTHS]);
    }
}
