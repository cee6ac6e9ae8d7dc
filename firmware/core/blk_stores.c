/* Chapter BLK: slots, entries and samples. The processors hold them; the controller knows which were stored, how much
   each slot drives, and what an accepted sequence or modulation uses. */
#include "device_parts.h"

#include <string.h>

#define ENTRIES_PER_LOAD 12u
#define SAMPLES_PER_LOAD 48u

static bool bit_of(const uint8_t *bits, uint32_t index)
{
    return (((uint32_t)bits[index / 8u] >> (index % 8u)) & 1u) != 0u;
}

static void set_bit(uint8_t *bits, uint32_t index)
{
    bits[index / 8u] |= (uint8_t)(1u << (index % 8u));
}

/* Judging ------------------------------------------------------------------------------------------------------ */

static bool overlap(uint32_t first, uint32_t count, const struct pw_use *use)
{
    return first < (uint32_t)use->first + use->count && use->first < first + count;
}

static bool used_by(const struct pw_use *use, const struct pw_block *block)
{
    switch (block->kind) {
    case PW_SLOT:
        return !use->modulation && bit_of(use->slots, block->first);
    case PW_STORE_ENTRIES:
        return !use->modulation && overlap(block->first, block->count, use);
    default:
        return use->modulation && overlap(block->first, block->count, use);
    }
}

static bool in_use(const struct pw_device *self, const struct pw_block *block)
{
    for (uint32_t i = 0; i < self->use_count; i++) {
        const struct pw_use *use = &self->uses[i];
        if (use->until > pw_period_now(self) && used_by(use, block)) {
            return true;
        }
    }
    return false;
}

/* What a sequence would play (SAF-006, BLK-021). */
static enum pw_reason judge_sequence(const struct pw_device *self, const struct pw_block *block)
{
    enum pw_reason reason = PW_ACCEPTED;
    for (uint32_t i = 0; i < block->count; i++) {
        const struct pw_entry entry = pw_entry_get(&self->entries[0][0], (uint32_t)block->first + i);
        const uint32_t power = entry.periods == 0u ? UINT32_MAX : self->slot_power[entry.slot];
        if (power == UINT32_MAX) {
            reason = PW_EMPTY;
        } else if (power > 1000u * (uint32_t)self->drive_limit) {
            return PW_DRIVE; /* it comes before EMPTY in ACK-003 */
        } else {
            /* This entry can play. */
        }
    }
    return reason;
}

static enum pw_reason judge_modulation(const struct pw_device *self, const struct pw_block *block)
{
    for (uint32_t i = 0; i < block->count; i++) {
        if (!bit_of(self->sampled, (uint32_t)block->first + i)) {
            return PW_EMPTY;
        }
    }
    return PW_ACCEPTED;
}

enum pw_reason pw_judge_stores(const struct pw_device *self, const struct pw_block *block)
{
    const bool has_pulses = block->kind == PW_UPDATE || block->kind == PW_SLOT;
    if (has_pulses && pw_pulses_power(block->payload, PW_CHANNELS) > 1000u * (uint32_t)self->drive_limit) {
        return PW_DRIVE;
    }
    if (block->kind == PW_SEQUENCE) {
        return judge_sequence(self, block);
    }
    if (block->kind == PW_MODULATION) {
        return judge_modulation(self, block);
    }
    return pw_kind_is_store(block->kind) && in_use(self, block) ? PW_IN_USE : PW_ACCEPTED;
}

/* Uses --------------------------------------------------------------------------------------------------------- */

void pw_end_uses(struct pw_device *self, bool sequences, bool modulations, uint64_t period)
{
    uint32_t kept = 0;
    for (uint32_t i = 0; i < self->use_count; i++) {
        struct pw_use *use = &self->uses[i];
        if ((use->modulation ? modulations : sequences) && use->until > period) {
            use->until = period;
        }
        if (use->until > pw_period_now(self)) {
            self->uses[kept] = *use;
            kept++;
        }
    }
    self->use_count = kept;
}

uint64_t pw_sequence_end(const struct pw_device *self, const struct pw_block *block, uint64_t period)
{
    uint64_t once = 0;
    for (uint32_t i = 0; i < block->count; i++) {
        once += pw_entry_get(&self->entries[0][0], (uint32_t)block->first + i).periods;
    }
    return block->repeats == 0u ? PW_NEVER : period + once * block->repeats;
}

void pw_note_uses(struct pw_device *self, const struct pw_block *block, uint64_t period, uint64_t ends)
{
    const bool output = block->kind == PW_OUTPUT;
    const bool only_modulation = block->kind == PW_MODULATION || (output && block->action == PW_END_MODULATION);
    pw_end_uses(self, !only_modulation, only_modulation || output, period);
    if (block->kind != PW_SEQUENCE && block->kind != PW_MODULATION) {
        return;
    }
    struct pw_use *use = &self->uses[self->use_count];
    memset(use, 0, sizeof *use);
    use->until = ends;
    use->modulation = block->kind == PW_MODULATION;
    use->first = block->first;
    use->count = block->count;
    for (uint32_t i = 0; i < block->count && !use->modulation; i++) {
        set_bit(use->slots, pw_entry_get(&self->entries[0][0], (uint32_t)block->first + i).slot);
    }
    self->use_count++;
}

/* Stores on their way ------------------------------------------------------------------------------------------ */

static uint32_t items_per_load(uint8_t kind)
{
    return kind == PW_STORE_ENTRIES ? ENTRIES_PER_LOAD : SAMPLES_PER_LOAD;
}

void pw_add_store(struct pw_device *self, const struct pw_block *block)
{
    struct pw_store *store = &self->stores[(self->first_store + self->store_count) % PW_QUEUE_STORES];
    self->store_count++;
    store->kind = block->kind;
    store->first = block->first;
    store->count = block->count;
    store->sent = 0;
    store->loads = PW_PROCESSORS;
    if (block->kind == PW_SLOT) {
        uint8_t slices[PW_PROCESSORS][PW_SLICE];
        pw_pulses_sort(block->payload, self->about->wiring, slices);
        memcpy(store->data, slices, sizeof store->data);
        self->slot_power[block->first] = pw_pulses_power(block->payload, PW_CHANNELS);
        return;
    }
    const uint32_t items = items_per_load(block->kind);
    store->loads = (uint16_t)(PW_PROCESSORS * ((block->count + items - 1u) / items));
    memcpy(store->data, block->payload, sizeof store->data);
    if (block->kind == PW_STORE_ENTRIES) {
        memcpy(self->entries[block->first], block->payload, 4u * (size_t)block->count);
        return;
    }
    for (uint32_t i = 0; i < block->count; i++) {
        set_bit(self->sampled, (uint32_t)block->first + i);
    }
}

/* Load `index` of a store: of a slot one for each processor, of the rest the same ones for all in turn. */
static uint16_t load_of(const struct pw_store *store, struct pw_load *load)
{
    const uint16_t node = (uint16_t)(store->sent % PW_PROCESSORS);
    memset(load, 0, sizeof *load);
    if (store->kind == PW_SLOT) {
        load->memory = PW_MEMORY_SLOTS;
        load->first = store->first;
        load->count = 1;
        memcpy(load->data, store->data + (size_t)node * PW_SLICE, PW_SLICE);
        return node;
    }
    const uint32_t items = items_per_load(store->kind);
    const uint32_t begin = store->sent / PW_PROCESSORS * items;
    const uint32_t left = store->count - begin;
    const uint32_t size = store->kind == PW_STORE_ENTRIES ? 4u : 1u;
    load->memory = store->kind == PW_STORE_ENTRIES ? PW_MEMORY_ENTRIES : PW_MEMORY_SAMPLES;
    load->first = (uint16_t)(store->first + begin);
    load->count = (uint8_t)(left < items ? left : items);
    memcpy(load->data, store->data + (size_t)begin * size, (size_t)load->count * size);
    return node;
}

uint32_t pw_loads_left(const struct pw_device *self)
{
    uint32_t loads = 0;
    for (uint32_t i = 0; i < self->store_count; i++) {
        const struct pw_store *store = &self->stores[(self->first_store + i) % PW_QUEUE_STORES];
        loads += (uint32_t)store->loads - store->sent;
    }
    return loads;
}

uint32_t pw_send_loads(struct pw_device *self, uint32_t tokens)
{
    uint8_t message[PW_MESSAGE];
    uint32_t left = tokens;
    for (; left >= PW_LOAD_TOKENS && self->store_count != 0u; left -= PW_LOAD_TOKENS) {
        struct pw_store *store = &self->stores[self->first_store];
        struct pw_load load;
        const uint16_t node = load_of(store, &load);
        pw_send(self, message, pw_load_put(message, node, &load));
        store->sent++;
        if (store->sent == store->loads) {
            self->first_store = (self->first_store + 1u) % PW_QUEUE_STORES;
            self->store_count--;
        }
    }
    return tokens - left;
}
