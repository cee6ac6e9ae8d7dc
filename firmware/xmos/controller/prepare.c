/* The tables of the sorting threads, made once at the start from the wiring and the reference's functions. */
#include "pul.h"

#define RESERVED (-32768)

extern const uint16_t wiring[PW_CHANNELS];
extern uint32_t codes[PW_CHANNELS];
extern uint32_t *places[PW_CHANNELS];
extern int16_t powers[4096];

void prepare(void)
{
    uint8_t packed[3] = { 0, 0, 0 };
    for (uint32_t i = 0; i < PW_CHANNELS; i++) {
        places[i] = &codes[wiring[i]];
    }
    for (uint32_t code = 0; code < 4096u; code++) {
        const struct pw_pulse pulse = { (uint8_t)(code & 0x7Fu), (uint8_t)(code >> 7) };
        pw_pulse_put(packed, 0, pulse);
        powers[code] = pw_pulses_valid(packed, 2) ? (int16_t)pw_pulses_power(packed, 2) : (int16_t)RESERVED;
    }
}
