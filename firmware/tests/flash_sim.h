/* A serial NOR flash in memory, whose power can be cut within any operation, and which can fail in all ways of DFU-005.
   Programming clears bits, and an erasure clears them before it sets all: so it can be caught with any bits. */
#ifndef FLASH_SIM_H
#define FLASH_SIM_H

#include "check.h"
#include "dfu.h"

#define SIM_BYTES 0x400000u
#define SIM_MODES 7u /* of a cut */

struct sim {
    uint8_t bytes[SIM_BYTES];
    uint64_t now;
    uint32_t step; /* ticks by which time goes on with each look at the clock */
    uint64_t busy_until;
    uint32_t erase_ticks, program_ticks;
    uint32_t erasures, programs;
    /* Power: it is cut in operation `cut_at`, counted from 1; 0 is never. */
    uint32_t operations, cut_at, cut_mode;
    bool dead;
    /* Failures. */
    bool mute;          /* nothing is answered */
    bool locked;        /* erasures and programs are refused */
    bool sticky;        /* erasures leave a bit, programs too */
    bool lame;          /* programs do nothing */
    uint8_t blind;      /* a bank that cannot be read */
    bool stuck;         /* busy for ever */
    uint32_t misused;   /* calls that the port does not allow */
};

static struct sim sim;

static inline uint64_t sim_now(void *self)
{
    (void)self;
    sim.now += sim.step;
    return sim.now;
}

static inline bool sim_busy(void *self)
{
    (void)self;
    return !sim.dead && (sim.stuck || (sim.now < sim.busy_until));
}

static inline bool sim_read(void *self, uint32_t address, uint8_t *data, size_t size)
{
    const bool answers = !sim.mute && ((sim.blind == 0u) || ((address / PW_BANK_SIZE) != sim.blind));
    if (sim_busy(self) || ((address + size) > SIM_BYTES)) {
        sim.misused++;
    }
    if (answers) {
        (void)memcpy(data, &sim.bytes[address], size);
    }
    return answers;
}

/* Bits of `mask`, each with probability 1/2. */
static inline uint8_t sim_some(uint8_t mask) { return (uint8_t)(mask & check_random()); }

/* What a sector or a part of a page looks like after an operation that was cut short. `target` NULL is an erasure. */
static inline void sim_cut(uint32_t address, const uint8_t *target, uint32_t size)
{
    const uint32_t border = check_below(size + 1u);
    const uint32_t chosen = (target == NULL) ? (48u + check_below(8)) : check_below(size); /* of a mark, if it is one */
    for (uint32_t i = 0; i < size; i++) {
        uint8_t *at = &sim.bytes[address + i];
        const uint8_t goal = (target == NULL) ? 0xFFu : (uint8_t)(*at & target[i]);
        const uint8_t clears = (target == NULL) ? *at : (uint8_t)(*at & (uint8_t)~target[i]);
        switch (sim.cut_mode % SIM_MODES) {
        case 0: /* nothing was done */
            break;
        case 1: /* all was done, and nobody saw it */
            *at = goal;
            break;
        case 2:
            *at = (uint8_t)(*at & (uint8_t)~sim_some(clears));
            break;
        case 3:
            *at = (target == NULL) ? sim_some(0xFF) : (uint8_t)(*at & (uint8_t)~sim_some(clears));
            break;
        case 4: /* one byte loses one bit */
            if (i == chosen) {
                *at = (uint8_t)(*at & (uint8_t)~(clears & (uint8_t)(1u << check_below(8))));
            }
            break;
        case 5:
            *at = (i < border) ? goal : *at;
            break;
        default:
            *at = (i >= border) ? goal : *at;
            break;
        }
    }
}

/* Counts an operation; false if its power is cut. */
static inline bool sim_powered(uint32_t address, const uint8_t *target, uint32_t size)
{
    bool powered = !sim.dead;
    sim.operations++;
    if (powered && (sim.operations == sim.cut_at)) {
        sim_cut(address, target, size);
        sim.dead = true;
        powered = false;
    }
    return powered;
}

static inline bool sim_erase(void *self, uint32_t address)
{
    if (sim_busy(self) || ((address % PW_FLASH_SECTOR) != 0u) || (address < PW_BANK_ADDRESS(PW_BANK_A)) ||
        (address >= SIM_BYTES)) {
        sim.misused++;
    }
    if (!sim.mute && !sim.locked && sim_powered(address, NULL, PW_FLASH_SECTOR)) {
        (void)memset(&sim.bytes[address], 0xFF, PW_FLASH_SECTOR);
        if (sim.sticky) {
            sim.bytes[address + 4095u] = 0xFE;
        }
        sim.busy_until = sim.now + sim.erase_ticks;
        sim.erasures++;
    }
    return !sim.mute && !sim.locked;
}

static inline bool sim_program(void *self, uint32_t address, const uint8_t *data, size_t size)
{
    if (sim_busy(self) || (size == 0u) || (((address % PW_FLASH_PAGE) + size) > PW_FLASH_PAGE) ||
        (address < PW_BANK_ADDRESS(PW_BANK_A)) || ((address + size) > SIM_BYTES)) {
        sim.misused++;
    }
    if (!sim.mute && !sim.locked && sim_powered(address, data, (uint32_t)size)) {
        for (size_t i = 0; i < size; i++) {
            sim.bytes[address + i] &= sim.lame ? 0xFFu : data[i];
        }
        if (sim.sticky) {
            sim.bytes[address] ^= 1u;
        }
        sim.busy_until = sim.now + sim.program_ticks;
        sim.programs++;
    }
    return !sim.mute && !sim.locked;
}

static const struct pw_port sim_port = { .now = sim_now, .flash_read = sim_read, .flash_erase = sim_erase,
                                         .flash_program = sim_program, .flash_busy = sim_busy };

/* Power comes (back): whatever the flash did has ended. */
static inline void sim_power(void)
{
    sim.dead = false;
    sim.cut_at = 0;
    sim.busy_until = 0;
    sim.operations = 0;
}

/* An empty flash with everything in order, and times that are typical (DFU-008). */
static inline void sim_begin(void)
{
    (void)memset(&sim, 0, sizeof sim);
    (void)memset(sim.bytes, 0xFF, sizeof sim.bytes);
    sim.now = 12345;
    sim.step = 1;
    sim.erase_ticks = 60u * PW_TICKS_PER_MS;
    sim.program_ticks = 1u * PW_TICKS_PER_MS;
}

/* Images ------------------------------------------------------------------------------------------------------- */

#define MADE_LARGEST PW_IMAGE_LARGEST

/* Writes an image of 2 or 11 segments of `size` bytes each, not signed; `patch` tells it from others. Returns its
   size. */
static inline uint32_t make_image(uint8_t *image, uint32_t segments, uint32_t size, uint8_t patch)
{
    const uint32_t table_ends = PW_IMAGE_HEADER + (segments * PW_IMAGE_ENTRY);
    uint32_t at = table_ends;
    (void)memset(image, 0, table_ends);
    for (uint32_t i = 0; i < segments; i++) {
        uint8_t *entry = &image[PW_IMAGE_HEADER + (i * PW_IMAGE_ENTRY)];
        struct pw_sha256 sum;
        entry[0] = (uint8_t)(((i + 1u) == segments) ? PW_CONTROLLER : ((segments == 2u) ? PW_ALL_PROCESSORS : i));
        pw_put32(&entry[4], at);
        pw_put32(&entry[8], size);
        for (uint32_t k = 0; k < size; k++) {
            image[at + k] = (uint8_t)(((k * 7u) + (k >> 8) + i) ^ patch);
        }
        pw_put32(&entry[12], pw_crc32(0, &image[at], size));
        pw_sha256_begin(&sum);
        pw_sha256_add(&sum, &image[at], size);
        pw_sha256_end(&sum, &entry[16]);
        for (at += size; (at & 3u) != 0u; at++) {
            image[at] = 0;
        }
    }
    (void)memset(&image[at], 0, PW_IMAGE_SIGNED);
    at += PW_IMAGE_SIGNED;
    (void)memcpy(image, "PWFW\1", 5);
    image[5] = (uint8_t)segments;
    image[6] = 1;
    image[10] = patch;
    image[11] = 1;
    pw_put32(&image[12], at);
    pw_put32(&image[28], pw_crc32(pw_crc32(0, image, 28), &image[PW_IMAGE_HEADER], table_ends - PW_IMAGE_HEADER));
    return at;
}

/* Puts an image with its record into a bank. */
static inline void sim_put(uint8_t bank, const uint8_t *image, uint32_t size, uint32_t generation, uint32_t started,
                           uint32_t confirmed)
{
    struct pw_record record = { .generation = generation, .size = size };
    struct pw_sha256 sum;
    uint8_t *at = &sim.bytes[PW_BANK_ADDRESS(bank)];
    pw_sha256_begin(&sum);
    pw_sha256_add(&sum, image, size);
    pw_sha256_end(&sum, record.digest);
    (void)memcpy(&sim.bytes[PW_BANK_IMAGE(bank)], image, size);
    pw_record_put(at, &record);
    pw_put32(&at[48], started);
    pw_put32(&at[52], confirmed);
}

/* A host ------------------------------------------------------------------------------------------------------- */

static struct pw_dfu dfu;
static uint8_t dfu_in[PW_DFU_BLOCK];

static inline int request(uint8_t code, uint16_t value, uint16_t length, const uint8_t *out)
{
    const bool in = (code == (uint8_t)PW_DFU_UPLOAD) || (code == (uint8_t)PW_DFU_GETSTATUS) ||
                    (code == (uint8_t)PW_DFU_GETSTATE);
    const struct pw_setup setup = { in ? 0xA1u : 0x21u, code, value, 0, length };
    return pw_dfu_request(&dfu, &setup, out, dfu_in);
}

static inline struct pw_dfu_reply get_status(void)
{
    struct pw_dfu_reply reply = { 0xFF, 0, 0xFF, 0 };
    if (request(PW_DFU_GETSTATUS, 0, 6, NULL) == 6) {
        reply.status = dfu_in[0];
        reply.poll_ms = pw_get16(&dfu_in[1]) + ((uint32_t)dfu_in[3] << 16);
        reply.state = dfu_in[4];
        reply.string = dfu_in[5];
    }
    return reply;
}

/* Time goes on, and the device works when something is due. */
static inline void wait_ticks(uint64_t ticks)
{
    const uint64_t end = sim.now + ticks;
    while (sim.now < end) {
        uint64_t due;
        pw_dfu_poll(&dfu);
        due = pw_dfu_due(&dfu);
        if (due > sim.now) {
            sim.now = (due < end) ? due : end;
        }
    }
    pw_dfu_poll(&dfu);
}

/* GETSTATUS until the device is not busy, as a host that keeps the poll times. */
static inline struct pw_dfu_reply settle(void)
{
    struct pw_dfu_reply reply = get_status();
    for (uint32_t i = 0; (i < 100u) && ((reply.state == (uint8_t)PW_DFU_DNBUSY) ||
                                        (reply.state == (uint8_t)PW_DFU_MANIFEST)); i++) {
        wait_ticks((uint64_t)reply.poll_ms * PW_TICKS_PER_MS);
        reply = get_status();
    }
    return reply;
}

/* The blocks of an image, without the end of the download; false if the device does not take one. */
static inline bool send_blocks(const uint8_t *image, uint32_t size)
{
    bool good = true;
    for (uint32_t at = 0; good && (at < size); at += PW_DFU_BLOCK) {
        const uint32_t left = size - at;
        const uint32_t length = (left < PW_DFU_BLOCK) ? left : PW_DFU_BLOCK;
        good = request(PW_DFU_DNLOAD, (uint16_t)(at / PW_DFU_BLOCK), (uint16_t)length, &image[at]) == 0;
        good = good && (settle().state == (uint8_t)PW_DFU_DNLOAD_IDLE);
    }
    return good;
}

static inline bool send_image(const uint8_t *image, uint32_t size)
{
    return send_blocks(image, size) && (request(PW_DFU_DNLOAD, (uint16_t)((size + 2047u) / 2048u), 0, NULL) == 0) &&
           (settle().state == (uint8_t)PW_DFU_IDLE);
}

#endif
