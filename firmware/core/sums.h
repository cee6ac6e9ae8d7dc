/* The two checksums of the protocol: CRC-32 (IEEE 802.3, as in zlib) and SHA-256 (FIPS 180-4). */
#ifndef PW_SUMS_H
#define PW_SUMS_H

#include "bytes.h"

/* CRC-32 of `size` bytes, continued from that of the bytes before them; of none it is 0. */
uint32_t pw_crc32(uint32_t before, const uint8_t *data, size_t size);

struct pw_sha256 {
    uint32_t state[8];
    uint64_t bytes;
    uint8_t block[64];
};
void pw_sha256_begin(struct pw_sha256 *sum);
void pw_sha256_add(struct pw_sha256 *sum, const uint8_t *data, size_t size);
void pw_sha256_end(struct pw_sha256 *sum, uint8_t digest[32]);

#endif
