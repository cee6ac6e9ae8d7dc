/* Chapters NUM and ACK: a block is judged in the order of ACK-003, numbered, and carried out. */
#include "device_parts.h"

#define HORIZON ((uint64_t)1 << 32) /* BLK-010 */

/* Whether a number follows that of the last accepted block (NUM-002). */
static bool follows(const struct pw_device *self, const struct pw_block *block)
{
    const uint32_t ahead = block->sequence - self->last_number;
    return self->any_number || (block->flags & PW_RESTART) != 0u || (ahead != 0u && ahead < 0x80000000u);
}

/* Part of a stream that the chain cannot carry (BLK-023). */
static bool too_fast(const struct pw_device *self, const struct pw_block *block)
{
    return block->kind == PW_UPDATE && self->rated && block->period > self->rated_period
        && block->period - self->rated_period < PW_PERIODS_PER_UPDATE;
}

/* The reasons that depend on the device, in the order of ACK-003. */
static enum pw_reason judge(const struct pw_device *self, const struct pw_block *block, uint64_t arrived)
{
    const bool change = pw_kind_is_change(block->kind);
    if ((pw_block_features(block) & (uint16_t)~PW_FEATURES) != 0u) {
        return PW_UNSUPPORTED;
    }
    if ((self->faults & PW_SILENCING) != 0u && (change || pw_kind_is_store(block->kind))) {
        return PW_FAULTED;
    }
    if (change && !pw_state_enabled(self->state)) {
        return PW_DISABLED;
    }
    if (!follows(self, block)) {
        return PW_OUT_OF_SEQUENCE;
    }
    if (change && block->period > arrived / PW_TICKS && block->period - arrived / PW_TICKS > HORIZON) {
        return PW_HORIZON;
    }
    if (too_fast(self, block)) {
        return PW_RATE;
    }
    return pw_judge_stores(self, block);
}

/* Queue a change; returns the period at which it takes effect. */
static uint64_t queue(struct pw_device *self, const struct pw_block *block, uint8_t door)
{
    const uint64_t first = pw_first_period(self, block->kind, block->action);
    const uint64_t period = block->period > first ? block->period : first;
    struct pw_change *change = pw_change_add(self);
    change->period = period;
    change->kind = block->kind;
    change->action = block->action;
    change->flags = block->flags;
    change->door = door;
    change->first = block->first;
    change->count = block->count;
    change->hold = block->hold;
    change->repeats = block->repeats;
    if (block->kind == PW_UPDATE) {
        pw_pulses_sort(block->payload, self->about->wiring, change->slices);
    }
    if (block->kind == PW_SEQUENCE) {
        change->ends = pw_sequence_end(self, block, period);
    }
    pw_note_uses(self, block, period, change->ends);
    self->last_period = period;
    self->last_program = !pw_has_slices(block->kind, block->action);
    return period;
}

/* Numbers that were left out before an accepted block (NUM-003). */
static uint32_t left_out(const struct pw_device *self, const struct pw_block *block)
{
    const bool begins = self->any_number || (block->flags & PW_RESTART) != 0u;
    return begins ? 0u : block->sequence - self->last_number - 1u;
}

static void accept(struct pw_device *self, const struct pw_block *block, uint8_t door, struct pw_ack *ack)
{
    const uint32_t lost = left_out(self, block);
    self->lost += lost;
    ack->flags |= lost != 0u ? PW_GAP : 0u;
    self->any_number = false;
    self->last_number = block->sequence;
    self->accepted++;
    self->last_sign = self->now;
    if (pw_kind_is_change(block->kind)) {
        ack->commit_period = queue(self, block, door);
        if (block->period != 0u && ack->commit_period != block->period) {
            ack->flags |= PW_LATE;
            self->late++;
        }
        if (block->kind == PW_UPDATE && block->period != 0u) {
            self->rated = true;
            self->rated_period = block->period;
        }
    } else if (pw_kind_is_store(block->kind)) {
        pw_add_store(self, block);
    } else {
        ack->commit_period = block->kind == PW_CLOCK ? self->sync_period : 0u;
    }
}

void pw_device_block(struct pw_device *self, uint8_t door, const uint8_t *bytes, size_t size, uint64_t arrived,
                     struct pw_ack *ack)
{
    struct pw_block block;
    enum pw_reason reason = pw_block_check(bytes, size, &block);
    if (reason == PW_ACCEPTED) {
        reason = judge(self, &block, arrived);
    }
    ack->reason = (uint8_t)reason;
    ack->sequence = pw_block_number(bytes, size);
    ack->commit_period = 0;
    ack->now = arrived;
    ack->flags = 0;
    ack->state = (uint8_t)self->state;
    if (reason == PW_ACCEPTED) {
        accept(self, &block, door, ack);
    } else {
        self->refused++;
        self->last_refusal = (uint8_t)reason;
    }
    ack->free = pw_free_places(self);
}

int pw_device_test(struct pw_device *self, uint8_t door, uint16_t transducer)
{
    /* CON-008: an update of one weak pulse, without a number. */
    uint8_t payload[PW_PAYLOAD] = {0};
    const struct pw_pulse weak = {0, 2};
    pw_pulse_put(payload, transducer, weak);
    struct pw_block block = {0};
    block.kind = PW_UPDATE;
    block.payload = payload;
    block.flags = PW_RESTART; /* whatever number came last */
    pw_device_poll(self);
    const enum pw_reason reason = judge(self, &block, self->now);
    if (reason != PW_ACCEPTED) {
        self->refused++;
        self->last_refusal = (uint8_t)reason;
        return (int)reason;
    }
    if (!pw_device_has_room(self)) {
        return -1;
    }
    self->accepted++;
    self->last_sign = self->now;
    (void)queue(self, &block, door);
    return (int)PW_ACCEPTED;
}
