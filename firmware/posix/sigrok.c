/* The session file. Samples come at 80 MB/s, and mostly the same period over and over. So a period is deflated once in
   SIGROK_REPEATS copies, and that is put into the stream as often as it plays: a full flush before it makes the stream
   stand at a byte, and keeps what comes after it from pointing back over it. While most periods differ from the one
   before, deflating would take most of a core: then the samples are stored as they are. */
#include "sigrok.h"

#include <stdlib.h>
#include <string.h>

#define LEVEL 1
#define NO_LEVEL 0
#define CACHE_LEVEL 4 /* a quarter of the bytes that level 1 makes of silence */
#define RAW_WINDOW (-15) /* deflate without a header of zlib */
#define MEMORY 9
#define MEMBER_BYTES 20000000u /* a quarter of a second */
#define PROBES 320u
#define UNIT_BYTES 40u
#define MOST_MEMBERS 65000u
#define MOST_BYTES 0xF0000000u /* offsets have 32 bits */
#define METADATA_ROOM 8192u

/* Records of a zip archive, little-endian. */
#define LOCAL_HEADER 30u
#define CENTRAL_HEADER 46u
#define END_RECORD 22u
#define VERSION_NEEDED 20u
#define DEFLATED 8u
#define DATE_1980 0x21u /* the first day that the format has: the same recording gives the same bytes */
#define NAME_ROOM 24u

static void put16(uint8_t *at, uint32_t value)
{
    at[0] = (uint8_t)(value & 0xFFu);
    at[1] = (uint8_t)((value >> 8) & 0xFFu);
}

static void put32(uint8_t *at, uint32_t value)
{
    put16(at, value & 0xFFFFu);
    put16(at + 2, value >> 16);
}

static void put(struct sigrok *self, const void *bytes, size_t size)
{
    if (fwrite(bytes, 1, size, self->file) != size) {
        self->failed = true;
    }
    self->at += size;
}

static size_t name_of(size_t index, char name[NAME_ROOM])
{
    int size;
    if (index < 2u) {
        size = snprintf(name, NAME_ROOM, "%s", index == 0u ? "version" : "metadata");
    } else {
        size = snprintf(name, NAME_ROOM, "logic-1-%lu", (unsigned long)(index - 1u));
    }
    return (size_t)size;
}

/* What the local header and the directory have in common, from `version needed` on. */
static void put_common(uint8_t at[26], const struct sigrok_member *member, size_t name_size)
{
    memset(at, 0, 26);
    put16(at, VERSION_NEEDED);
    put16(at + 4, DEFLATED);
    put16(at + 8, DATE_1980);
    put32(at + 10, member->crc);
    put32(at + 14, member->packed);
    put32(at + 18, member->size);
    put16(at + 22, (uint32_t)name_size);
}

static void put_local(struct sigrok *self, size_t index)
{
    uint8_t header[LOCAL_HEADER];
    char name[NAME_ROOM];
    const size_t name_size = name_of(index, name);
    memcpy(header, "PK\003\004", 4);
    put_common(header + 4, &self->members[index], name_size);
    put(self, header, LOCAL_HEADER);
    put(self, name, name_size);
}

/* Members --------------------------------------------------------------------------------------------------------- */

static bool room_for_member(struct sigrok *self)
{
    if (self->count < self->room) {
        return true;
    }
    const size_t room = self->room == 0u ? 64u : 2u * self->room;
    struct sigrok_member *members = realloc(self->members, room * sizeof *members);
    if (members == NULL) {
        return false;
    }
    self->members = members;
    self->room = room;
    return true;
}

static bool begin_member(struct sigrok *self)
{
    if (self->count == MOST_MEMBERS || self->at > MOST_BYTES || !room_for_member(self)) {
        self->failed = true;
        return false;
    }
    struct sigrok_member *member = &self->members[self->count];
    memset(member, 0, sizeof *member);
    member->offset = (uint32_t)self->at;
    put_local(self, self->count); /* written again when its sizes are known */
    self->count++;
    self->open = true;
    self->packed = 0;
    self->size = 0;
    self->crc = 0;
    self->calls = 0;
    (void)deflateReset(&self->stream);
    (void)deflateParams(&self->stream, self->hurry ? NO_LEVEL : LEVEL, Z_DEFAULT_STRATEGY);
    return true;
}

/* Takes what the stream has deflated. */
static void deflate_to_file(struct sigrok *self, const uint8_t *bytes, size_t size, int flush)
{
    uint8_t out[16384];
    self->stream.next_in = bytes;
    self->stream.avail_in = (uInt)size;
    do {
        self->stream.next_out = out;
        self->stream.avail_out = (uInt)sizeof out;
        (void)deflate(&self->stream, flush);
        const size_t count = sizeof out - self->stream.avail_out;
        put(self, out, count);
        self->packed += count;
    } while (self->stream.avail_out == 0u);
}

static void end_member(struct sigrok *self)
{
    deflate_to_file(self, NULL, 0, Z_FINISH);
    const size_t index = self->count - 1u;
    struct sigrok_member *member = &self->members[index];
    member->crc = self->crc;
    member->packed = (uint32_t)self->packed;
    member->size = (uint32_t)self->size;
    const uint64_t end = self->at;
    if (fseek(self->file, (long)member->offset, SEEK_SET) != 0) {
        self->failed = true;
    }
    put_local(self, index);
    if (fseek(self->file, (long)end, SEEK_SET) != 0) {
        self->failed = true;
    }
    self->at = end;
    self->open = false;
    self->hurry = (uint64_t)self->calls * 2u > self->size / SIGROK_BYTES;
}

static void feed(struct sigrok *self, const uint8_t *bytes, size_t size)
{
    self->crc = (uint32_t)crc32(self->crc, bytes, (uInt)size);
    self->size += size;
    deflate_to_file(self, bytes, size, Z_NO_FLUSH);
}

/* Repeats --------------------------------------------------------------------------------------------------------- */

static void fill_cache(struct sigrok *self, const uint8_t *bytes, size_t size)
{
    if (self->cached_size == size && memcmp(self->cached, bytes, size) == 0) {
        return;
    }
    memcpy(self->cached, bytes, size);
    self->cached_size = size;
    self->cache_crc = 0;
    z_stream *stream = &self->cache_stream;
    (void)deflateReset(stream);
    stream->next_out = self->cache;
    stream->avail_out = (uInt)sizeof self->cache;
    for (uint32_t i = 0; i < SIGROK_REPEATS; i++) {
        self->cache_crc = (uint32_t)crc32(self->cache_crc, bytes, (uInt)size);
        stream->next_in = bytes;
        stream->avail_in = (uInt)size;
        (void)deflate(stream, i == SIGROK_REPEATS - 1u ? Z_FULL_FLUSH : Z_NO_FLUSH);
    }
    self->cache_packed = sizeof self->cache - stream->avail_out;
}

/* Puts in the deflated repeats until the member is full; returns how many repeats are left. */
static uint64_t put_repeats(struct sigrok *self, size_t size, uint64_t repeats)
{
    const z_off_t bytes = (z_off_t)(size * SIGROK_REPEATS);
    uint64_t left = repeats;
    deflate_to_file(self, NULL, 0, Z_FULL_FLUSH);
    while (left >= SIGROK_REPEATS && self->size < MEMBER_BYTES && !self->failed) {
        put(self, self->cache, self->cache_packed);
        self->packed += self->cache_packed;
        self->size += (uint64_t)bytes;
        self->crc = (uint32_t)crc32_combine(self->crc, self->cache_crc, bytes);
        left -= SIGROK_REPEATS;
    }
    return left;
}

bool sigrok_write(struct sigrok *self, const uint8_t *bytes, size_t size, uint64_t repeats)
{
    uint64_t left = repeats;
    while (left != 0u && !self->failed) {
        if (!self->open && !begin_member(self)) {
            break;
        }
        self->calls += left == repeats ? 1u : 0u;
        if (left >= 2u * SIGROK_REPEATS) {
            fill_cache(self, bytes, size);
            left = put_repeats(self, size, left);
        } else {
            feed(self, bytes, size);
            left--;
        }
        if (self->size >= MEMBER_BYTES) {
            end_member(self);
        }
    }
    return !self->failed;
}

/* The file -------------------------------------------------------------------------------------------------------- */

static void write_metadata(struct sigrok *self)
{
    static char text[METADATA_ROOM];
    int size = snprintf(text, sizeof text,
                        "[global]\nsigrok version=0.5.2\n\n[device 1]\ncapturefile=logic-1\ntotal probes=%u\n"
                        "samplerate=2 MHz\ntotal analog=0\n", PROBES);
    for (uint32_t i = 0; i < PROBES; i++) {
        /* In the order of the chain: two processors of 32 outputs on each board. */
        size += snprintf(text + size, sizeof text - (size_t)size, "probe%u=b%up%u_%02u\n", i + 1u, i / 64u,
                         i / 32u % 2u, i % 32u);
    }
    size += snprintf(text + size, sizeof text - (size_t)size, "unitsize=%u\n", UNIT_BYTES);
    const uint8_t *bytes = (const uint8_t *)text;
    for (size_t done = 0; done < (size_t)size; done += 1000u) {
        const size_t left = (size_t)size - done;
        feed(self, bytes + done, left < 1000u ? left : 1000u);
    }
}

bool sigrok_open(struct sigrok *self, const char *path)
{
    memset(self, 0, sizeof *self);
    self->file = fopen(path, "wb");
    if (self->file == NULL) {
        return false;
    }
    if (deflateInit2(&self->stream, LEVEL, Z_DEFLATED, RAW_WINDOW, MEMORY, Z_DEFAULT_STRATEGY) != Z_OK
        || deflateInit2(&self->cache_stream, CACHE_LEVEL, Z_DEFLATED, RAW_WINDOW, MEMORY, Z_DEFAULT_STRATEGY) != Z_OK) {
        return false;
    }
    if (begin_member(self)) {
        feed(self, (const uint8_t *)"2", 1);
        end_member(self);
    }
    if (begin_member(self)) {
        write_metadata(self);
        end_member(self);
    }
    return !self->failed;
}

static void write_directory(struct sigrok *self)
{
    const uint64_t begin = self->at;
    for (size_t i = 0; i < self->count; i++) {
        uint8_t header[CENTRAL_HEADER];
        char name[NAME_ROOM];
        const size_t name_size = name_of(i, name);
        memset(header, 0, sizeof header);
        memcpy(header, "PK\001\002", 4);
        put16(header + 4, VERSION_NEEDED);
        put_common(header + 6, &self->members[i], name_size);
        put32(header + 42, self->members[i].offset);
        put(self, header, CENTRAL_HEADER);
        put(self, name, name_size);
    }
    uint8_t end[END_RECORD] = {'P', 'K', 5, 6};
    put16(end + 8, (uint32_t)self->count);
    put16(end + 10, (uint32_t)self->count);
    put32(end + 12, (uint32_t)(self->at - begin));
    put32(end + 16, (uint32_t)begin);
    put(self, end, END_RECORD);
}

bool sigrok_close(struct sigrok *self)
{
    const bool whole = !self->failed; /* what was recorded until then is kept */
    if (self->open) {
        end_member(self);
    }
    write_directory(self);
    const bool closed = fclose(self->file) == 0;
    (void)deflateEnd(&self->stream);
    (void)deflateEnd(&self->cache_stream);
    free(self->members);
    return whole && closed;
}
