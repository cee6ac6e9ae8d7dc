/* Chapter BLK: what a block says, and the checks that depend on the block alone (ACK-003 down to PULSE). Pure. */
#ifndef PW_BLK_H
#define PW_BLK_H

#include "bytes.h"
#include "codes.h"
#include "config.h"

struct pw_block {
    uint8_t kind; /* enum pw_kind */
    uint8_t flags; /* enum pw_flag */
    uint8_t action; /* enum pw_action */
    uint32_t sequence;
    uint64_t period;
    uint16_t first;
    uint16_t count;
    uint16_t hold;
    uint16_t repeats;
    const uint8_t *payload; /* 480 bytes within the block */
};

/* Checks a block of any length by the reasons LENGTH to PULSE. `block` is filled if that is ACCEPTED. */
enum pw_reason pw_block_check(const uint8_t *bytes, size_t size, struct pw_block *block);
/* Whether a kind is a change, or a store (BLK-004). */
bool pw_kind_is_change(uint8_t kind);
bool pw_kind_is_store(uint8_t kind);
/* The sequence number of a block of any length, of which there may be only a part (ACK-002). */
uint32_t pw_block_number(const uint8_t *bytes, size_t size);
/* The features (VER-005) that a valid block needs, as bits. */
uint16_t pw_block_features(const struct pw_block *block);
/* Entry `index` of a payload of entries (BLK-014). */
struct pw_entry {
    uint16_t slot;
    uint16_t periods;
};
struct pw_entry pw_entry_get(const uint8_t *entries, uint32_t index);

#endif
