/* Chapter SAF, and the events of chapter STA: silence, watchdog, faults, and who is told. */
#include "device_parts.h"

void pw_tell(struct pw_device *self, uint8_t door)
{
    for (uint8_t other = 0; other < PW_DOORS; other++) {
        if (other != door && (self->listening & (1u << other)) != 0u) {
            self->telling |= (uint8_t)(1u << other);
            pw_device_status(self, &self->told[other]);
        }
    }
}

void pw_device_listen(struct pw_device *self, uint8_t door, bool listens)
{
    const uint8_t bit = (uint8_t)(1u << door);
    if (listens) {
        self->listening |= bit;
    } else {
        self->listening &= (uint8_t)~bit;
        self->telling &= (uint8_t)~bit;
    }
}

bool pw_device_tells(struct pw_device *self, uint8_t door, uint8_t record[PW_STATUS])
{
    const uint8_t bit = (uint8_t)(1u << door);
    if ((self->telling & bit) == 0u) {
        return false;
    }
    self->telling &= (uint8_t)~bit;
    /* A block that waited is judged after the event, and its counters belong to this record (SER-011). */
    struct pw_status *told = &self->told[door];
    struct pw_status now;
    pw_device_status(self, &now);
    told->accepted = now.accepted;
    told->refused = now.refused;
    told->late = now.late;
    told->lost = now.lost;
    told->last_refusal = now.last_refusal;
    pw_status_put(record, told);
    return true;
}

uint64_t pw_watchdog_due(const struct pw_device *self)
{
    if (self->state != PW_STATE_READY && self->state != PW_STATE_PLAYING) {
        return PW_NEVER;
    }
    return self->last_sign + (uint64_t)self->watchdog_ms * PW_TICKS_PER_MS;
}

/* Whether ACK-006 tells every door of this event, also the one through which it came. */
static bool told_to_all(enum pw_event event)
{
    return event == PW_EVENT_WATCHDOG || event == PW_EVENT_FAULT || event == PW_EVENT_SUSPEND
        || event == PW_EVENT_RESUME;
}

static void change_state(struct pw_device *self, enum pw_event event, uint8_t door)
{
    const enum pw_state before = self->state;
    self->state = pw_state_after(before, event);
    if (event == PW_EVENT_ENABLE) {
        self->last_sign = self->now;
        self->watchdog_fired = false;
        self->rated = false;
    }
    if (before == PW_STATE_UNATTENDED) {
        self->last_sign = self->now; /* the watchdog starts, if it rested */
    }
    if (pw_state_enabled(before) && !pw_state_enabled(self->state)) {
        pw_silence(self, false);
    }
    if (told_to_all(event)) {
        pw_tell(self, PW_NO_DOOR);
    } else if (self->state != before && door != PW_NO_DOOR) {
        pw_tell(self, door);
    } else {
        /* The device itself caused it, and tells of the end of a sequence where it ends. */
    }
}

void pw_event(struct pw_device *self, enum pw_event event, uint8_t door)
{
    if (!pw_state_allows(self->state, event)) {
        return;
    }
    change_state(self, event, door);
    /* STA-004: what could ignore the suspended bus has been left. */
    if (self->suspended && pw_state_allows(self->state, PW_EVENT_SUSPEND)) {
        change_state(self, PW_EVENT_SUSPEND, PW_NO_DOOR);
    }
}

void pw_silence(struct pw_device *self, bool again)
{
    /* What is committed may begin (SAF-004), but is no event any more; what is not is dropped. Silence that waits
       already is soon enough, and stays. */
    uint64_t committed = 0;
    bool ordered = false;
    uint32_t kept = 0;
    while (kept < self->change_count && !ordered) {
        struct pw_change *change = pw_change_at(self, kept);
        if (!change->committed && !change->silent) {
            break;
        }
        ordered = change->silent && !change->committed;
        change->silent = true;
        committed = change->period;
        kept++;
    }
    self->change_count = kept;
    const bool silent = kept == 0u && !self->plays && !self->modulation_sent;
    self->modulation_sent = self->modulation_sent || (again && self->stops_sent); /* the stop may be what was missed */
    self->plays = false;
    self->plays_sequence = false;
    self->modulates = false;
    self->since_period = 0;
    self->sequence_ends = PW_NEVER;
    self->last_program = false;
    uint64_t period = committed;
    if (silent && !again) {
        period = pw_period_now(self); /* nothing plays or is on its way */
    } else if (!ordered) {
        self->last_period = committed; /* what was dropped delays nothing */
        period = pw_first_period(self, PW_OUTPUT, PW_DISABLE);
        struct pw_change *silence = pw_change_add(self);
        silence->kind = PW_OUTPUT;
        silence->action = PW_DISABLE;
        silence->period = period;
        silence->silent = true;
        silence->door = PW_NO_DOOR;
    } else {
        /* It comes soon enough. */
    }
    self->last_period = period;
    pw_end_uses(self, true, true, period);
}

void pw_raise_faults(struct pw_device *self, uint16_t faults)
{
    const uint16_t fresh = (uint16_t)(faults & (uint16_t)~self->faults);
    self->faults |= faults;
    if ((fresh & PW_SILENCING) != 0u && pw_state_allows(self->state, PW_EVENT_FAULT)) {
        pw_event(self, PW_EVENT_FAULT, PW_NO_DOOR);
    } else if (fresh != 0u) {
        pw_tell(self, PW_NO_DOOR);
    } else {
        /* It is known already. */
    }
}

void pw_clear_faults(struct pw_device *self, uint8_t door)
{
    const uint16_t before = self->faults;
    self->faults &= self->persisting;
    for (uint32_t i = 0; i < PW_PROCESSORS; i++) {
        self->processors[i].report.faults &= self->processors[i].lasting;
    }
    if ((self->faults & PW_SILENCING) == 0u) {
        pw_event(self, PW_EVENT_CLEAR, door);
    }
    if (self->faults != before) {
        pw_tell(self, PW_NO_DOOR); /* of both, in one record */
    }
}

void pw_device_bus(struct pw_device *self, enum pw_event event)
{
    pw_device_poll(self);
    if (event == PW_EVENT_SUSPEND) {
        self->suspended = true;
    } else {
        self->suspended = false;
    }
    if (event == PW_EVENT_BUS_RESET) {
        self->any_number = true;
        if (self->leaving == PW_LEAVE_DFU) {
            self->leave_at = self->now; /* DFU-002 */
        }
    }
    pw_event(self, event, PW_DOOR_USB);
}

bool pw_device_detach(struct pw_device *self, uint8_t door)
{
    pw_device_poll(self);
    if ((PW_FEATURES & PW_HAS_DFU) == 0u || !pw_state_allows(self->state, PW_EVENT_DETACH)) {
        return false;
    }
    pw_event(self, PW_EVENT_DETACH, door);
    self->leaving = PW_LEAVE_DFU;
    self->leave_at = self->now + 20u * (uint64_t)PW_TICKS_PER_MS; /* 10 to 1000 ms: DFU-002 */
    return true;
}
