/* Assertions for the test programs. They need printf alone, so that they run on a bare Cortex-M too; printf there may
   not know 64 bits, hence the halves. `check_case` is named in every failure. */
#ifndef CHECK_H
#define CHECK_H

#include <stdint.h>
#include <stdio.h>
#include <string.h>

static unsigned long check_passed, check_failed;
static const char *check_case = "";

static inline void check_count(int good, const char *file, int line, const char *what, uint64_t got, uint64_t wanted)
{
    if (good) {
        check_passed++;
    } else {
        check_failed++;
        if (check_failed <= 20u) {
            printf("%s:%d: %s: %s: got 0x%08lX%08lX, not 0x%08lX%08lX\n", file, line, check_case, what,
                   (unsigned long)(got >> 32), (unsigned long)(got & 0xFFFFFFFFu),
                   (unsigned long)(wanted >> 32), (unsigned long)(wanted & 0xFFFFFFFFu));
        }
    }
}

/* Where two byte strings differ first: `got` and `wanted` are what stands there. */
static inline void check_bytes(const char *file, int line, const char *what, const uint8_t *got, const uint8_t *wanted,
                               size_t size)
{
    size_t at = 0;
    while ((at < size) && (got[at] == wanted[at])) {
        at++;
    }
    if (at == size) {
        check_passed++;
    } else {
        printf("byte %lu of %lu differs:\n", (unsigned long)at, (unsigned long)size);
        check_count(0, file, line, what, got[at], wanted[at]);
    }
}

#define CHECK(good) check_count((good) ? 1 : 0, __FILE__, __LINE__, #good, 0, 1)
#define CHECK_EQ(got, wanted) check_equal(__FILE__, __LINE__, #got, (uint64_t)(got), (uint64_t)(wanted))
#define CHECK_BYTES(got, wanted, size) check_bytes(__FILE__, __LINE__, #got, got, wanted, size)

static inline void check_equal(const char *file, int line, const char *what, uint64_t got, uint64_t wanted)
{
    check_count(got == wanted, file, line, what, got, wanted);
}

/* The last line of every test: what main returns. */
static inline int check_end(void)
{
    printf("%lu passed, %lu failed\n", check_passed, check_failed);
    return (check_failed == 0u) && (check_passed > 0u) ? 0 : 1;
}

/* Marsaglia's xorshift: the same numbers everywhere. */
static inline uint32_t check_random(void)
{
    static uint64_t state = 0x9E3779B97F4A7C15u;
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return (uint32_t)(state >> 32);
}

static inline uint32_t check_below(uint32_t limit)
{
    return (uint32_t)(((uint64_t)check_random() * limit) >> 32);
}

#endif
