/* CRC-32 by tables and SHA-256. The tables are constant, so that they stay in flash. */
#include "sums.h"

#include <string.h>

#include "config.h"

/* Bytes of input for each step of the CRC. 8 is about five times as fast as 1 and costs 8 KiB of tables, not 1. */
#ifndef PW_CRC_SLICES
#define PW_CRC_SLICES 8
#endif
#if (PW_CRC_SLICES != 1) && (PW_CRC_SLICES != 8)
#error "PW_CRC_SLICES is 1 or 8"
#endif

/* The CRC is linear: the entry of a byte is the exclusive or of the entries of its bits. BASIS_k has the eight entries
   of table k for the bytes 01, 02, 04 to 80. Table k is for a byte with k bytes behind it. */
#define BASIS_0 \
    0x77073096u, 0xEE0E612Cu, 0x076DC419u, 0x0EDB8832u, 0x1DB71064u, 0x3B6E20C8u, 0x76DC4190u, 0xEDB88320u
#define BASIS_1 \
    0x191B3141u, 0x32366282u, 0x646CC504u, 0xC8D98A08u, 0x4AC21251u, 0x958424A2u, 0xF0794F05u, 0x3B83984Bu
#define BASIS_2 \
    0x01C26A37u, 0x0384D46Eu, 0x0709A8DCu, 0x0E1351B8u, 0x1C26A370u, 0x384D46E0u, 0x709A8DC0u, 0xE1351B80u
#define BASIS_3 \
    0xB8BC6765u, 0xAA09C88Bu, 0x8F629757u, 0xC5B428EFu, 0x5019579Fu, 0xA032AF3Eu, 0x9B14583Du, 0xED59B63Bu
#define BASIS_4 \
    0x3D6029B0u, 0x7AC05360u, 0xF580A6C0u, 0x30704BC1u, 0x60E09782u, 0xC1C12F04u, 0x58F35849u, 0xB1E6B092u
#define BASIS_5 \
    0xCB5CD3A5u, 0x4DC8A10Bu, 0x9B914216u, 0xEC53826Du, 0x03D6029Bu, 0x07AC0536u, 0x0F580A6Cu, 0x1EB014D8u
#define BASIS_6 \
    0xA6770BB4u, 0x979F1129u, 0xF44F2413u, 0x33EF4E67u, 0x67DE9CCEu, 0xCFBD399Cu, 0x440B7579u, 0x8816EAF2u
#define BASIS_7 \
    0xCCAA009Eu, 0x4225077Du, 0x844A0EFAu, 0xD3E51BB5u, 0x7CBB312Bu, 0xF9766256u, 0x299DC2EDu, 0x533B85DAu

#define PICK(n, bit, basis) (((((uint32_t)(n)) >> (bit)) & 1u) * (basis))
#define SUM(n, a, b, c, d, e, f, g, h) \
    (PICK(n, 0, a) ^ PICK(n, 1, b) ^ PICK(n, 2, c) ^ PICK(n, 3, d) ^ \
     PICK(n, 4, e) ^ PICK(n, 5, f) ^ PICK(n, 6, g) ^ PICK(n, 7, h))
#define ENTRY(n, ...) SUM(n, __VA_ARGS__)
#define ENTRIES_4(n, ...) \
    ENTRY(n, __VA_ARGS__), ENTRY((n) + 1, __VA_ARGS__), ENTRY((n) + 2, __VA_ARGS__), ENTRY((n) + 3, __VA_ARGS__)
#define ENTRIES_16(n, ...) \
    ENTRIES_4(n, __VA_ARGS__), ENTRIES_4((n) + 4, __VA_ARGS__), \
    ENTRIES_4((n) + 8, __VA_ARGS__), ENTRIES_4((n) + 12, __VA_ARGS__)
#define ENTRIES_64(n, ...) \
    ENTRIES_16(n, __VA_ARGS__), ENTRIES_16((n) + 16, __VA_ARGS__), \
    ENTRIES_16((n) + 32, __VA_ARGS__), ENTRIES_16((n) + 48, __VA_ARGS__)
#define TABLE(...) \
    { ENTRIES_64(0, __VA_ARGS__), ENTRIES_64(64, __VA_ARGS__), \
      ENTRIES_64(128, __VA_ARGS__), ENTRIES_64(192, __VA_ARGS__) }

static const uint32_t crc_tables[PW_CRC_SLICES][256] = {
    TABLE(BASIS_0),
#if PW_CRC_SLICES == 8
    TABLE(BASIS_1),
    TABLE(BASIS_2),
    TABLE(BASIS_3),
    TABLE(BASIS_4),
    TABLE(BASIS_5),
    TABLE(BASIS_6),
    TABLE(BASIS_7),
#endif
};

uint32_t pw_crc32(uint32_t before, const uint8_t *data, size_t size)
{
    uint32_t crc = ~before;
    size_t at = 0;
#if PW_CRC_SLICES == 8
    for (; (size - at) >= 8u; at += 8u) {
        const uint32_t low = pw_get32(&data[at]) ^ crc;
        const uint32_t high = pw_get32(&data[at + 4u]);
        crc = crc_tables[7][low & 0xFFu] ^ crc_tables[6][(low >> 8) & 0xFFu] ^
              crc_tables[5][(low >> 16) & 0xFFu] ^ crc_tables[4][low >> 24] ^
              crc_tables[3][high & 0xFFu] ^ crc_tables[2][(high >> 8) & 0xFFu] ^
              crc_tables[1][(high >> 16) & 0xFFu] ^ crc_tables[0][high >> 24];
    }
#endif
    for (; at < size; at++) {
        crc = crc_tables[0][(crc ^ data[at]) & 0xFFu] ^ (crc >> 8);
    }
    return ~crc;
}

/* FIPS 180-4, 4.2.2 and 5.3.3 */
static const uint32_t round_constants[64] = {
    0x428A2F98u, 0x71374491u, 0xB5C0FBCFu, 0xE9B5DBA5u, 0x3956C25Bu, 0x59F111F1u, 0x923F82A4u, 0xAB1C5ED5u,
    0xD807AA98u, 0x12835B01u, 0x243185BEu, 0x550C7DC3u, 0x72BE5D74u, 0x80DEB1FEu, 0x9BDC06A7u, 0xC19BF174u,
    0xE49B69C1u, 0xEFBE4786u, 0x0FC19DC6u, 0x240CA1CCu, 0x2DE92C6Fu, 0x4A7484AAu, 0x5CB0A9DCu, 0x76F988DAu,
    0x983E5152u, 0xA831C66Du, 0xB00327C8u, 0xBF597FC7u, 0xC6E00BF3u, 0xD5A79147u, 0x06CA6351u, 0x14292967u,
    0x27B70A85u, 0x2E1B2138u, 0x4D2C6DFCu, 0x53380D13u, 0x650A7354u, 0x766A0ABBu, 0x81C2C92Eu, 0x92722C85u,
    0xA2BFE8A1u, 0xA81A664Bu, 0xC24B8B70u, 0xC76C51A3u, 0xD192E819u, 0xD6990624u, 0xF40E3585u, 0x106AA070u,
    0x19A4C116u, 0x1E376C08u, 0x2748774Cu, 0x34B0BCB5u, 0x391C0CB3u, 0x4ED8AA4Au, 0x5B9CCA4Fu, 0x682E6FF3u,
    0x748F82EEu, 0x78A5636Fu, 0x84C87814u, 0x8CC70208u, 0x90BEFFFAu, 0xA4506CEBu, 0xBEF9A3F7u, 0xC67178F2u
};
static const uint32_t first_state[8] = {
    0x6A09E667u, 0xBB67AE85u, 0x3C6EF372u, 0xA54FF53Au, 0x510E527Fu, 0x9B05688Cu, 0x1F83D9ABu, 0x5BE0CD19u
};

static inline uint32_t rotated(uint32_t value, unsigned bits)
{
    return (value >> bits) | (value << (32u - bits));
}

static uint32_t big_endian_get(const uint8_t *at)
{
    return ((uint32_t)at[0] << 24) | ((uint32_t)at[1] << 16) | ((uint32_t)at[2] << 8) | (uint32_t)at[3];
}

static void big_endian_put(uint8_t *at, uint32_t value)
{
    at[0] = (uint8_t)(value >> 24);
    at[1] = (uint8_t)((value >> 16) & 0xFFu);
    at[2] = (uint8_t)((value >> 8) & 0xFFu);
    at[3] = (uint8_t)(value & 0xFFu);
}

/* FIPS 180-4, 6.2.2. Only the last 16 words of the schedule are kept; s[0] to s[7] are its a to h. */
static void compress(uint32_t state[8], const uint8_t block[64])
{
    uint32_t words[16];
    uint32_t s[8];
    for (unsigned i = 0; i < 16u; i++) {
        words[i] = big_endian_get(&block[4u * i]);
    }
    (void)memcpy(s, state, sizeof s);
    for (unsigned i = 0; i < 64u; i++) {
        if (i >= 16u) {
            const uint32_t w15 = words[(i + 1u) & 15u];
            const uint32_t w2 = words[(i + 14u) & 15u];
            const uint32_t small0 = rotated(w15, 7u) ^ rotated(w15, 18u) ^ (w15 >> 3);
            const uint32_t small1 = rotated(w2, 17u) ^ rotated(w2, 19u) ^ (w2 >> 10);
            words[i & 15u] += small0 + words[(i + 9u) & 15u] + small1;
        }
        const uint32_t big0 = rotated(s[0], 2u) ^ rotated(s[0], 13u) ^ rotated(s[0], 22u);
        const uint32_t big1 = rotated(s[4], 6u) ^ rotated(s[4], 11u) ^ rotated(s[4], 25u);
        const uint32_t choice = (s[4] & s[5]) ^ (~s[4] & s[6]);
        const uint32_t majority = (s[0] & s[1]) ^ (s[0] & s[2]) ^ (s[1] & s[2]);
        const uint32_t t1 = s[7] + big1 + choice + round_constants[i] + words[i & 15u];
        for (unsigned k = 7; k > 0u; k--) {
            s[k] = s[k - 1u];
        }
        s[4] += t1;
        s[0] = t1 + big0 + majority;
    }
    for (unsigned i = 0; i < 8u; i++) {
        state[i] += s[i];
    }
}

void pw_sha256_begin(struct pw_sha256 *sum)
{
    (void)memcpy(sum->state, first_state, sizeof sum->state);
    sum->bytes = 0;
}

void pw_sha256_add(struct pw_sha256 *sum, const uint8_t *data, size_t size)
{
    size_t used = (size_t)(sum->bytes & 63u);
    size_t at = 0;
    sum->bytes += size;
    while (at < size) {
        const size_t room = sizeof sum->block - used;
        const size_t part = ((size - at) < room) ? (size - at) : room;
        (void)memcpy(&sum->block[used], &data[at], part);
        at += part;
        used += part;
        if (used == sizeof sum->block) {
            compress(sum->state, sum->block);
            used = 0;
        }
    }
}

void pw_sha256_end(struct pw_sha256 *sum, uint8_t digest[32])
{
    size_t used = (size_t)(sum->bytes & 63u);
    const uint64_t bits = sum->bytes * 8u;
    sum->block[used] = 0x80u;
    used++;
    if (used > 56u) {
        (void)memset(&sum->block[used], 0, sizeof sum->block - used);
        compress(sum->state, sum->block);
        used = 0;
    }
    (void)memset(&sum->block[used], 0, 56u - used);
    big_endian_put(&sum->block[56], (uint32_t)(bits >> 32));
    big_endian_put(&sum->block[60], (uint32_t)(bits & 0xFFFFFFFFu));
    compress(sum->state, sum->block);
    for (unsigned i = 0; i < 8u; i++) {
        big_endian_put(&digest[4u * i], sum->state[i]);
    }
}
