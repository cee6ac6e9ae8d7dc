/* A sigrok session file: a zip archive of `version`, `metadata` and samples in the members logic-1-1, logic-1-2, ... */
#ifndef SIGROK_H
#define SIGROK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#define ZLIB_CONST
#include <zlib.h>

#define SIGROK_REPEATS 64u /* of bytes that stand deflated in the cache */
#define SIGROK_BYTES 2000u /* that can be repeated: a period */

/* A member of the archive, for the directory at its end. */
struct sigrok_member {
    uint32_t crc, packed, size, offset;
};

struct sigrok {
    FILE *file;
    bool failed;
    uint64_t at; /* bytes of the file so far */
    /* All members. */
    struct sigrok_member *members;
    size_t count, room;
    /* The member that is being written. */
    bool open;
    uint64_t packed, size;
    uint32_t crc;
    uint32_t calls; /* of sigrok_write */
    bool hurry;     /* the next member is not deflated */
    z_stream stream;
    /* SIGROK_REPEATS times the same bytes, deflated on their own. */
    z_stream cache_stream;
    size_t cached_size; /* of the bytes; 0: nothing is cached */
    uint8_t cached[SIGROK_BYTES];
    uint32_t cache_crc;
    size_t cache_packed;
    uint8_t cache[2u * SIGROK_BYTES * SIGROK_REPEATS];
};

bool sigrok_open(struct sigrok *self, const char *path);
/* Samples, so many times. They take at most SIGROK_BYTES. False: the file cannot be written, or is full. */
bool sigrok_write(struct sigrok *self, const uint8_t *bytes, size_t size, uint64_t repeats);
/* Writes the directory, without which the file cannot be read. */
bool sigrok_close(struct sigrok *self);

#endif
