/* Chapter BLK: the checks that depend on a block alone, by a table of what each kind uses. */
#include "blk.h"

#include <string.h>

#include "pul.h"
#include "sums.h"

#define HEADER 32u
#define CHECKSUM_AT 28u
#define VERSION 1u

/* BLK-011, one row for each kind. 0 and false mean that the field is not used and is 0. */
struct rule {
    uint16_t places;     /* of the memory that `first` points into */
    uint16_t most;       /* of `count`; the least is 1 */
    uint16_t item_bytes; /* in the payload, of each of the `count` items */
    uint8_t flags;       /* that may be set */
    uint8_t actions;     /* 1 to this */
    bool period;
    bool hold;
    bool repeats;
    bool pulses; /* fill the payload */
};

static const struct rule rules[PW_NO_OP + 1] = {
    [PW_UPDATE] = { .period = true, .pulses = true, .flags = PW_RESTART },
    [PW_SLOT] = { .places = PW_SLOTS, .pulses = true, .flags = PW_RESTART },
    [PW_STORE_ENTRIES] = { .places = PW_ENTRIES, .most = 120, .item_bytes = 4, .flags = PW_RESTART },
    [PW_SEQUENCE] = { .period = true, .places = PW_ENTRIES, .most = PW_ENTRIES, .repeats = true,
                      .flags = PW_RESTART | PW_UNATTENDED },
    [PW_STORE_SAMPLES] = { .places = PW_SAMPLES, .most = PW_PAYLOAD, .item_bytes = 1, .flags = PW_RESTART },
    [PW_MODULATION] = { .period = true, .places = PW_SAMPLES, .most = PW_SAMPLES, .hold = true, .flags = PW_RESTART },
    [PW_OUTPUT] = { .period = true, .actions = PW_DISABLE, .flags = PW_RESTART },
    [PW_CLOCK] = { .flags = PW_RESTART },
    [PW_NO_OP] = { .flags = PW_RESTART }
};

/* BLK-003: the four bytes of the checksum count as 0. */
static uint32_t checksum_of(const uint8_t *bytes)
{
    uint8_t header[HEADER];
    (void)memcpy(header, bytes, CHECKSUM_AT);
    pw_put32(&header[CHECKSUM_AT], 0);
    return pw_crc32(pw_crc32(0, header, HEADER), &bytes[HEADER], PW_BLOCK - HEADER);
}

static void fields_get(const uint8_t *bytes, struct pw_block *block)
{
    block->kind = bytes[3];
    block->sequence = pw_get32(&bytes[4]);
    block->period = pw_get64(&bytes[8]);
    block->first = pw_get16(&bytes[16]);
    block->count = pw_get16(&bytes[18]);
    block->hold = pw_get16(&bytes[20]);
    block->repeats = pw_get16(&bytes[22]);
    block->flags = bytes[26];
    block->action = bytes[27];
    block->payload = &bytes[HEADER];
}

static bool items_valid(const struct rule *rule, const struct pw_block *block)
{
    const uint32_t items = (rule->most == 0u) ? 1u : block->count; /* a SLOT has one place and no count */
    bool valid = (rule->most == 0u) ? (block->count == 0u) : ((block->count >= 1u) && (block->count <= rule->most));
    if (rule->places == 0u) {
        valid = valid && (block->first == 0u);
    } else {
        valid = valid && (((uint32_t)block->first + items) <= rule->places);
    }
    return valid;
}

static bool others_valid(const struct rule *rule, const struct pw_block *block)
{
    bool valid = (block->flags & (uint8_t)~rule->flags) == 0u;
    valid = valid && (rule->period || (block->period == 0u));
    valid = valid && (rule->hold == (block->hold != 0u));
    valid = valid && (rule->repeats || (block->repeats == 0u));
    valid = valid && (block->action <= rule->actions) && ((rule->actions == 0u) || (block->action != 0u));
    return valid;
}

/* Only for a block whose `count` is valid: the payload holds the items then. */
static bool payload_valid(const struct rule *rule, const struct pw_block *block)
{
    bool valid = true;
    if (!rule->pulses) {
        const size_t used = (size_t)block->count * rule->item_bytes;
        valid = pw_all_zero(&block->payload[used], PW_PAYLOAD - used);
    }
    if (block->kind == (uint8_t)PW_STORE_ENTRIES) {
        for (uint32_t i = 0; i < block->count; i++) {
            const struct pw_entry entry = pw_entry_get(block->payload, i);
            valid = valid && (entry.slot < PW_SLOTS) && (entry.periods != 0u);
        }
    }
    return valid;
}

enum pw_reason pw_block_check(const uint8_t *bytes, size_t size, struct pw_block *block)
{
    struct pw_block seen;
    enum pw_reason reason = PW_ACCEPTED;
    if (size != PW_BLOCK) {
        reason = PW_LENGTH;
    } else if (pw_get32(&bytes[CHECKSUM_AT]) != checksum_of(bytes)) {
        reason = PW_CHECKSUM;
    } else if ((bytes[0] != 0x50u) || (bytes[1] != 0x57u)) {
        reason = PW_MAGIC;
    } else if (bytes[2] != VERSION) {
        reason = PW_VERSION;
    } else if ((bytes[3] < (uint8_t)PW_UPDATE) || (bytes[3] > (uint8_t)PW_NO_OP)) {
        reason = PW_KIND;
    } else {
        const struct rule *rule = &rules[bytes[3]];
        fields_get(bytes, &seen);
        if ((pw_get16(&bytes[24]) != 0u) || !items_valid(rule, &seen) || !others_valid(rule, &seen) ||
            !payload_valid(rule, &seen)) {
            reason = PW_FIELD;
        } else if (rule->pulses && !pw_pulses_valid(seen.payload, PW_CHANNELS)) {
            reason = PW_PULSE;
        } else {
            *block = seen;
        }
    }
    return reason;
}

bool pw_kind_is_change(uint8_t kind)
{
    return (kind == (uint8_t)PW_UPDATE) || (kind == (uint8_t)PW_SEQUENCE) || (kind == (uint8_t)PW_MODULATION) ||
           (kind == (uint8_t)PW_OUTPUT);
}

bool pw_kind_is_store(uint8_t kind)
{
    return (kind == (uint8_t)PW_SLOT) || (kind == (uint8_t)PW_STORE_ENTRIES) || (kind == (uint8_t)PW_STORE_SAMPLES);
}

uint32_t pw_block_number(const uint8_t *bytes, size_t size)
{
    uint32_t number = 0;
    for (uint32_t i = 0; (i < 4u) && ((i + 4u) < size); i++) {
        number |= (uint32_t)bytes[i + 4u] << (8u * i);
    }
    return number;
}

uint16_t pw_block_features(const struct pw_block *block)
{
    uint16_t features = 0;
    switch (block->kind) {
    case PW_SLOT:
    case PW_STORE_ENTRIES:
        features = PW_HAS_SEQUENCES;
        break;
    case PW_SEQUENCE:
        features = ((block->flags & PW_UNATTENDED) != 0u) ? (PW_HAS_SEQUENCES | PW_HAS_UNATTENDED) : PW_HAS_SEQUENCES;
        break;
    case PW_STORE_SAMPLES:
    case PW_MODULATION:
        features = PW_HAS_MODULATION;
        break;
    case PW_OUTPUT:
        features = (block->action == (uint8_t)PW_END_MODULATION) ? PW_HAS_MODULATION : 0u;
        break;
    default: /* UPDATE, CLOCK and NO_OP need none */
        break;
    }
    return features;
}

struct pw_entry pw_entry_get(const uint8_t *entries, uint32_t index)
{
    const uint8_t *at = &entries[4u * index];
    const struct pw_entry entry = { pw_get16(at), pw_get16(&at[2]) };
    return entry;
}
