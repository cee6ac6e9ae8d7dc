/* The boot program of a processor, as a board's own matter: it takes size, segment and CRC-32 (FWU-021). */
#ifndef BOOTING_H
#define BOOTING_H

#include "bytes.h"

struct booting {
    uint32_t came, size, sum;
    uint8_t checksum[4];
};

/* Takes the next bytes; for pw_boot_program. */
bool booting_take(void *self, const uint8_t *bytes, size_t size);
/* Whether it starts what it received. */
bool booting_starts(const struct booting *self);

#endif
