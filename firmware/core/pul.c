/* Chapter PUL. Loops run over pairs of pulses, as these share three bytes (PUL-005). */
#include "pul.h"

#include <string.h>

#define CODES_OF_WIDTH 32u /* five bits; the codes 26 to 31 are reserved (PUL-001) */

/* SAF-006. Reserved widths count as the widest, so that no code reads past the table. */
static const uint16_t powers[CODES_OF_WIDTH] = {
    0,   4,   16,  35,  62,  95,  136, 181, 232, 287, 345, 406,  469,  531,  594,  655,
    713, 768, 819, 864, 905, 938, 965, 984, 996, 1000, 1000, 1000, 1000, 1000, 1000, 1000
};

/* PUL-006 without a sine at run time. A pulse of width w gets at least the width v if
   sample/255 * sin(pi w/50) >= sin(pi (v - 1/2)/50). Both sides are multiplied by 255 * 2^24, which fits 32 bits.
   The rounding moves the bound by 2e-5 of a tick at most, and no value is nearer to it than 9e-5. */
static const uint32_t amplitudes[PW_WIDTHS] = { /* 2^24 sin(pi w/50) */
    0,        1053450,  2102743,  3143737,  4172324,  5184445,  6176105,  7143391,  8082485,
    8989682,  9861400,  10694200, 11484795, 12230064, 12927067, 13573053, 14165472, 14701986,
    15180479, 15599061, 15956081, 16250129, 16480045, 16644923, 16744110, 16777216
};
static const uint32_t bounds[PW_WIDTHS] = { /* 255 * 2^24 sin(pi (v - 1/2)/50); of width 0 there is none */
    0,           134381198u,  402613252u,  669256377u,  933258251u,  1193576982u, 1449185210u, 1699074166u, 1942257652u,
    2177775935u, 2404699531u, 2622132877u, 2829217862u, 3025137217u, 3209117737u, 3380433336u, 3538407908u, 3682418001u,
    3811895273u, 3926328735u, 4025266772u, 4108318920u, 4175157410u, 4225518461u, 4259203321u, 4276079051u
};

static inline uint32_t pair_get(const uint8_t *at)
{
    return (uint32_t)at[0] | ((uint32_t)at[1] << 8) | ((uint32_t)at[2] << 16);
}

struct pw_pulse pw_pulse_get(const uint8_t *packed, uint32_t index)
{
    const uint32_t pair = pair_get(&packed[(index >> 1) * 3u]);
    const uint32_t code = ((index & 1u) == 0u) ? (pair & 0xFFFu) : (pair >> 12);
    const struct pw_pulse pulse = { (uint8_t)(code & 0x7Fu), (uint8_t)(code >> 7) };
    return pulse;
}

void pw_pulse_put(uint8_t *packed, uint32_t index, struct pw_pulse pulse)
{
    uint8_t *at = &packed[(index >> 1) * 3u];
    const uint32_t code = ((uint32_t)pulse.phase & 0x7Fu) | (((uint32_t)pulse.width & 0x1Fu) << 7);
    if ((index & 1u) == 0u) {
        at[0] = (uint8_t)(code & 0xFFu);
        at[1] = (uint8_t)((at[1] & 0xF0u) | (code >> 8));
    } else {
        at[1] = (uint8_t)((at[1] & 0x0Fu) | ((code & 0x0Fu) << 4));
        at[2] = (uint8_t)(code >> 4);
    }
}

bool pw_pulses_valid(const uint8_t *packed, uint32_t count)
{
    /* Both pulses of a pair at once, without a branch: a phase above 99 carries into bit 7 if 28 is added, a width
       above 25 into bit 5 if 6 is. */
    uint32_t bad = 0;
    for (uint32_t i = 0; i < (count / 2u); i++) {
        const uint32_t pair = pair_get(&packed[i * 3u]);
        const uint32_t phases = pair & 0x07F07Fu;
        const uint32_t widths = (pair >> 7) & 0x01F01Fu;
        bad |= (phases + 0x01C01Cu) & 0x080080u;
        bad |= (widths + 0x006006u) & 0x020020u;
    }
    return bad == 0u;
}

uint32_t pw_pulses_power(const uint8_t *packed, uint32_t count)
{
    uint32_t power = 0;
    for (uint32_t i = 0; i < (count / 2u); i++) {
        const uint32_t pair = pair_get(&packed[i * 3u]);
        power += (uint32_t)powers[(pair >> 7) & 0x1Fu];
        power += (uint32_t)powers[pair >> 19];
    }
    return power;
}

void pw_pulses_sort(const uint8_t packed[PW_PAYLOAD], const uint16_t wiring[PW_CHANNELS],
                    uint8_t slices[PW_PROCESSORS][PW_SLICE])
{
    /* By way of one code for each channel, as a pulse alone is no whole number of bytes. A channel that does not
       exist is passed over, so that a wrong table cannot write beyond. */
    uint16_t codes[PW_CHANNELS] = { 0 };
    for (uint32_t i = 0; i < (PW_CHANNELS / 2u); i++) {
        const uint32_t pair = pair_get(&packed[i * 3u]);
        const uint32_t first = wiring[2u * i];
        const uint32_t second = wiring[(2u * i) + 1u];
        if (first < PW_CHANNELS) {
            codes[first] = (uint16_t)(pair & 0xFFFu);
        }
        if (second < PW_CHANNELS) {
            codes[second] = (uint16_t)(pair >> 12);
        }
    }
    for (uint32_t processor = 0; processor < PW_PROCESSORS; processor++) {
        const uint16_t *from = &codes[processor * PW_PORT_BITS];
        uint8_t *to = slices[processor];
        for (uint32_t i = 0; i < (PW_PORT_BITS / 2u); i++) {
            const uint32_t pair = (uint32_t)from[2u * i] | ((uint32_t)from[(2u * i) + 1u] << 12);
            to[3u * i] = (uint8_t)(pair & 0xFFu);
            to[(3u * i) + 1u] = (uint8_t)((pair >> 8) & 0xFFu);
            to[(3u * i) + 2u] = (uint8_t)(pair >> 16);
        }
    }
}

void pw_pulses_unsort(const uint8_t slice[PW_SLICE], uint32_t processor, const uint16_t wiring[PW_CHANNELS],
                      uint8_t packed[PW_PAYLOAD])
{
    for (uint32_t i = 0; i < PW_CHANNELS; i++) {
        const uint32_t channel = wiring[i];
        if ((channel / PW_PORT_BITS) == processor) {
            pw_pulse_put(packed, i, pw_pulse_get(slice, channel % PW_PORT_BITS));
        }
    }
}

uint32_t pw_pulse_begin(struct pw_pulse pulse)
{
    /* 100 half ticks more keep the difference above 0, and are a whole period. */
    return ((((uint32_t)pulse.phase + (2u * PW_TICKS)) - (uint32_t)pulse.width) / 2u) % PW_TICKS;
}

static inline bool reaches(uint32_t width, uint32_t target, uint8_t sample)
{
    return ((uint32_t)sample * amplitudes[width]) >= bounds[target];
}

uint8_t pw_modulated_width(uint8_t width, uint8_t sample)
{
    uint32_t modulated = 0;
    if (width < PW_WIDTHS) {
        while ((modulated < width) && reaches(width, modulated + 1u, sample)) {
            modulated++;
        }
    }
    return (uint8_t)modulated;
}

/* What every code of a width becomes. A wider pulse never becomes narrower than a narrower one, so that one walk
   finds all. */
static void widths_under(uint8_t sample, uint8_t widths[CODES_OF_WIDTH])
{
    uint32_t modulated = 0;
    (void)memset(widths, 0, CODES_OF_WIDTH);
    for (uint32_t width = 0; width < PW_WIDTHS; width++) {
        while ((modulated < width) && reaches(width, modulated + 1u, sample)) {
            modulated++;
        }
        widths[width] = (uint8_t)modulated;
    }
}

void pw_rasterise(const uint8_t slice[PW_SLICE], uint8_t sample, uint32_t words[PW_TICKS])
{
    /* First each word gets the bits that change at its tick, then each the levels of the one before it, changed so.
       `level` is what the period begins with: the bits of the pulses that go round its end. */
    uint8_t widths[CODES_OF_WIDTH];
    uint32_t level = 0;
    widths_under(sample, widths);
    (void)memset(words, 0, PW_TICKS * sizeof words[0]);
    for (uint32_t bit = 0; bit < PW_PORT_BITS; bit++) {
        struct pw_pulse pulse = pw_pulse_get(slice, bit);
        pulse.width = widths[pulse.width];
        const uint32_t mask = (uint32_t)1u << bit;
        const uint32_t begin = pw_pulse_begin(pulse);
        uint32_t end = begin + pulse.width;
        if (end >= PW_TICKS) {
            end -= PW_TICKS;
            level ^= mask;
        }
        words[begin] ^= mask;
        words[end] ^= mask;
    }
    for (uint32_t tick = 0; tick < PW_TICKS; tick++) {
        level ^= words[tick];
        words[tick] = level;
    }
}
