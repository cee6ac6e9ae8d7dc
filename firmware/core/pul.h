/* Chapter PUL: pulses, their packing, power, modulation and the words of a port. Pure functions. */
#ifndef PW_PUL_H
#define PW_PUL_H

#include "bytes.h"
#include "config.h"

struct pw_pulse {
    uint8_t phase; /* of the centre, 0 to 99 half ticks */
    uint8_t width; /* 0 to 25 ticks */
};

/* Pulse `index` of packed ones (PUL-005). */
struct pw_pulse pw_pulse_get(const uint8_t *packed, uint32_t index);
void pw_pulse_put(uint8_t *packed, uint32_t index, struct pw_pulse pulse);
/* Whether none of `count` pulses (an even number) is reserved (PUL-001). */
bool pw_pulses_valid(const uint8_t *packed, uint32_t count);
/* The total drive (SAF-006) of `count` pulses, an even number. */
uint32_t pw_pulses_power(const uint8_t *packed, uint32_t count);
/* The slices of all processors: wiring[i] is the output channel of pulse i (REQ-004). */
void pw_pulses_sort(const uint8_t packed[PW_PAYLOAD], const uint16_t wiring[PW_CHANNELS],
                    uint8_t slices[PW_PROCESSORS][PW_SLICE]);
/* The inverse: the pulses of a processor to their places in array order (REQ-007). */
void pw_pulses_unsort(const uint8_t slice[PW_SLICE], uint32_t processor, const uint16_t wiring[PW_CHANNELS],
                      uint8_t packed[PW_PAYLOAD]);
/* The tick of its period at which a pulse begins (PUL-004). */
uint32_t pw_pulse_begin(struct pw_pulse pulse);
/* Width of a pulse under a modulation sample (PUL-006). Integers only. */
uint8_t pw_modulated_width(uint8_t width, uint8_t sample);
/* The words of a port for one period: word t holds the levels of its 32 outputs in tick t. `sample` 255 is none. */
void pw_rasterise(const uint8_t slice[PW_SLICE], uint8_t sample, uint32_t words[PW_TICKS]);

#endif
