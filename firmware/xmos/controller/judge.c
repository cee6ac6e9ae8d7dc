/* The checks of a block that need neither its checksum computed nor its pulses read: block_crc and scatter do that. The
   reference (firmware/core/blk.c) does all in one; here a block lies at the address of a word and is read in words. */
#include <stdint.h>

#include "codes.h"
#include "config.h"

#define HEADER 8u  /* words */
#define PAYLOAD 120u
#define MAGIC 0x5750u
#define VERSION 1u

/* The words of a block's header (BLK-002): kind, version and magic; the number; the period, 2; count and first; repeats
   and hold; action, flags and a reserved field; the checksum. */
struct rule {
    uint32_t period, items, hold, others; /* bits that are not used and must be 0 (BLK-011) */
    uint16_t places, most;                /* for first and count, if count is used */
    uint8_t item_bytes;
};

#define ALL 0xFFFFFFFFu
#define NO_ACTION 0xFFFEFFFFu /* RESTART alone */
#define UNATTENDED_TOO 0xFFFCFFFFu
#define ACTION 0x00FEFFFFu
#define FIRST_BYTE 0xFFFFFF00u

static const struct rule rules[PW_NO_OP + 1] = {
    [PW_UPDATE] = { 0, ALL, ALL, NO_ACTION, 0, 0, 0 },
    [PW_SLOT] = { ALL, FIRST_BYTE, ALL, NO_ACTION, 0, 0, 0 },
    [PW_STORE_ENTRIES] = { ALL, 0, ALL, NO_ACTION, PW_ENTRIES, 120, 4 },
    [PW_SEQUENCE] = { 0, 0, 0x0000FFFFu, UNATTENDED_TOO, PW_ENTRIES, PW_ENTRIES, 0 },
    [PW_STORE_SAMPLES] = { ALL, 0, ALL, NO_ACTION, PW_SAMPLES, PW_PAYLOAD, 1 },
    [PW_MODULATION] = { 0, 0, 0xFFFF0000u, NO_ACTION, PW_SAMPLES, PW_SAMPLES, 0 },
    [PW_OUTPUT] = { 0, ALL, ALL, ACTION, 0, 0, 0 },
    [PW_CLOCK] = { ALL, ALL, ALL, NO_ACTION, 0, 0, 0 },
    [PW_NO_OP] = { ALL, ALL, ALL, NO_ACTION, 0, 0, 0 }
};

static uint32_t any_bit(const uint32_t *words, uint32_t count)
{
    uint32_t any = 0;
    for (; count >= 8u; count -= 8u) {
        any |= words[0] | words[1] | words[2] | words[3] | words[4] | words[5] | words[6] | words[7];
        words += 8;
    }
    for (; count != 0u; count--) {
        any |= *words;
        words++;
    }
    return any;
}

/* Whether an entry plays a slot above 255, or for no period (BLK-014). */
static uint32_t entries_wrong(const uint32_t *words, uint32_t count)
{
    uint32_t slots = 0;
    uint32_t none = 0;
    for (; count >= 4u; count -= 4u) {
        slots |= words[0] | words[1] | words[2] | words[3];
        none |= (uint32_t)((words[0] >> 16) == 0u) | (uint32_t)((words[1] >> 16) == 0u);
        none |= (uint32_t)((words[2] >> 16) == 0u) | (uint32_t)((words[3] >> 16) == 0u);
        words += 4;
    }
    for (; count != 0u; count--) {
        slots |= *words;
        none |= (uint32_t)((*words >> 16) == 0u);
        words++;
    }
    return none | (slots & 0xFF00u);
}

static uint32_t field_wrong(const uint32_t *block, uint32_t kind)
{
    const struct rule *rule = &rules[kind];
    uint32_t wrong = ((block[2] | block[3]) & rule->period) | (block[4] & rule->items);
    wrong |= (block[5] & rule->hold) | (block[6] & rule->others);
    if ((wrong != 0u) || (kind <= (uint32_t)PW_SLOT)) {
        return wrong;
    }
    const uint32_t count = block[4] >> 16;
    if (rule->most != 0u) {
        const uint32_t end = (block[4] & 0xFFFFu) + count;
        wrong = (uint32_t)(count == 0u) | (uint32_t)(count > rule->most) | (uint32_t)(end > rule->places);
    }
    if (kind == (uint32_t)PW_MODULATION) {
        wrong |= (uint32_t)(block[5] == 0u);
    }
    if (kind == (uint32_t)PW_OUTPUT) {
        wrong |= (uint32_t)(((block[6] >> 24) - 1u) >= (uint32_t)PW_DISABLE);
    }
    if (wrong != 0u) {
        return wrong;
    }
    const uint32_t *payload = &block[HEADER];
    const uint32_t used = count * rule->item_bytes;
    uint32_t whole = used >> 2;
    if ((used & 3u) != 0u) {
        wrong = payload[whole] >> (8u * (used & 3u));
        whole++;
    }
    wrong |= any_bit(&payload[whole], PAYLOAD - whole);
    if (kind == (uint32_t)PW_STORE_ENTRIES) {
        wrong |= entries_wrong(payload, count);
    }
    return wrong;
}

/* The reason (ACK-003 from CHECKSUM down to FIELD) that a block of 512 bytes is refused for, or 0. `found` is the CRC-32
   that it should have. */
uint32_t judge(const uint32_t *block, uint32_t found)
{
    const uint32_t kind = block[0] >> 24;
    uint32_t reason = PW_ACCEPTED;
    if (block[7] != found) {
        reason = PW_CHECKSUM;
    } else if ((block[0] & 0xFFFFu) != MAGIC) {
        reason = PW_MAGIC;
    } else if (((block[0] >> 16) & 0xFFu) != VERSION) {
        reason = PW_VERSION;
    } else if ((kind < (uint32_t)PW_UPDATE) || (kind > (uint32_t)PW_NO_OP)) {
        reason = PW_KIND;
    } else if (field_wrong(block, kind) != 0u) {
        reason = PW_FIELD;
    } else {
        /* accepted, as far as this goes */
    }
    return reason;
}
