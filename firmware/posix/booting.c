/* A boot program that keeps nothing of what it receives: the processors of this port are part of it. */
#include "booting.h"

#include "sums.h"

#define HEAD 4u
#define TAIL 4u

bool booting_take(void *self, const uint8_t *bytes, size_t size)
{
    struct booting *booting = self;
    for (size_t i = 0; i < size; i++) {
        const uint32_t at = booting->came++;
        if (at < HEAD) {
            booting->size |= (uint32_t)bytes[i] << (8u * at);
        } else if (at - HEAD < booting->size) {
            booting->sum = pw_crc32(booting->sum, &bytes[i], 1);
        } else if (at - HEAD - booting->size < TAIL) {
            booting->checksum[at - HEAD - booting->size] = bytes[i];
        } else {
            return false;
        }
    }
    return true;
}

bool booting_starts(const struct booting *self)
{
    return self->came == HEAD + self->size + TAIL && pw_get32(self->checksum) == self->sum;
}
