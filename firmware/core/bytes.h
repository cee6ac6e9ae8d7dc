/* Little-endian numbers in bytes; no alignment is assumed. */
#ifndef PW_BYTES_H
#define PW_BYTES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

static inline uint16_t pw_get16(const uint8_t *at) { return (uint16_t)(at[0] | ((unsigned)at[1] << 8)); }

static inline uint32_t pw_get32(const uint8_t *at)
{
    return (uint32_t)pw_get16(at) | ((uint32_t)pw_get16(at + 2) << 16);
}

static inline uint64_t pw_get64(const uint8_t *at)
{
    return (uint64_t)pw_get32(at) | ((uint64_t)pw_get32(at + 4) << 32);
}

static inline void pw_put16(uint8_t *at, uint32_t value)
{
    at[0] = (uint8_t)(value & 0xFFu);
    at[1] = (uint8_t)((value >> 8) & 0xFFu);
}

static inline void pw_put32(uint8_t *at, uint32_t value)
{
    pw_put16(at, value & 0xFFFFu);
    pw_put16(at + 2, value >> 16);
}

static inline void pw_put64(uint8_t *at, uint64_t value)
{
    pw_put32(at, (uint32_t)(value & 0xFFFFFFFFu));
    pw_put32(at + 4, (uint32_t)(value >> 32));
}

static inline bool pw_all_zero(const uint8_t *at, size_t size)
{
    uint8_t any = 0;
    for (size_t i = 0; i < size; i++) {
        any |= at[i];
    }
    return any == 0;
}

#endif
