/* Chapter TIM: the device's time, and what is due in it. */
#include "device_parts.h"

#include <string.h>

void pw_device_begin(struct pw_device *self, const struct pw_port *port, const struct pw_about *about)
{
    memset(self, 0, sizeof *self);
    self->port = port;
    self->about = about;
    if (port->restart_processors != NULL) {
        port->restart_processors(port->self);
    }
    self->state = PW_STATE_OFF;
    self->faults = about->faults;
    self->persisting = about->faults;
    self->watchdog_ms = PW_WATCHDOG_MS;
    self->drive_limit = PW_DRIVE_LIMIT;
    self->any_number = true;
    self->sequence_ends = PW_NEVER;
    self->reading_until = PW_NEVER;
    for (uint32_t slot = 0; slot < PW_SLOTS; slot++) {
        self->slot_power[slot] = UINT32_MAX;
    }
}

bool pw_device_serving(const struct pw_device *self)
{
    return self->serving;
}

static uint64_t earlier(uint64_t a, uint64_t b)
{
    return a < b ? a : b;
}

/* The tick of the device at which something is due. */
static uint64_t due(const struct pw_device *self)
{
    const uint64_t period = pw_period_due(self);
    uint64_t tick = period == PW_NEVER ? PW_NEVER : period * PW_TICKS;
    tick = earlier(tick, pw_watchdog_due(self));
    return earlier(tick, pw_chain_due(self));
}

uint64_t pw_device_due(const struct pw_device *self)
{
    if (!self->serving) {
        return pw_chain_due(self);
    }
    uint64_t tick = due(self);
    if (self->leaving != PW_STAY) {
        tick = earlier(tick, self->leave_at);
    }
    return tick == PW_NEVER ? PW_NEVER : tick + self->origin;
}

void pw_device_poll(struct pw_device *self)
{
    if (!self->serving) {
        pw_number_chain(self);
        if (!self->serving) {
            return;
        }
        pw_work_on_period(self, 0);
    }
    const uint64_t target = self->port->now(self->port->self) - self->origin;
    for (uint64_t next = due(self); next <= target; next = due(self)) {
        if (self->now < next) {
            self->now = next;
        }
        /* What takes effect at a boundary comes before the watchdog: a sequence may let it rest there. */
        if (pw_period_due(self) <= pw_period_now(self)) {
            pw_work_on_period(self, pw_period_due(self));
        }
        if (pw_watchdog_due(self) <= self->now) {
            self->watchdog_fired = true;
            pw_event(self, PW_EVENT_WATCHDOG, PW_NO_DOOR);
        }
        pw_work_on_chain(self);
        pw_note_broken(self);
    }
    self->now = target;
    self->worked = pw_period_now(self); /* nothing was due in the periods that were left out */
}

uint64_t pw_device_tick(struct pw_device *self)
{
    pw_device_poll(self);
    return self->now;
}

enum pw_leave pw_device_leaving(struct pw_device *self)
{
    return self->leaving != PW_STAY && pw_device_tick(self) >= self->leave_at ? self->leaving : PW_STAY;
}
