/* The life of a device. */
#include "life.h"

#include <string.h>

#define CONFIRM_TICKS (5u * (uint64_t)PW_TICKS_PER_MS) /* between two attempts */

static uint64_t now(const struct pw_life *self)
{
    return self->port->now(self->port->self);
}

void pw_unique_id(uint8_t unique_id[8], const char *serial_number)
{
    struct pw_sha256 sum;
    uint8_t digest[32];
    pw_sha256_begin(&sum);
    pw_sha256_add(&sum, (const uint8_t *)serial_number, strlen(serial_number));
    pw_sha256_end(&sum, digest);
    memcpy(unique_id, digest, 8);
}

static bool begin_device(struct pw_life *self)
{
    const bool boots = pw_boot(self->port, &self->boot);
    memcpy(self->about.firmware, self->boot.firmware, sizeof self->about.firmware);
    self->about.bank = self->boot.bank;
    self->about.faults = self->boot.faults;
    self->confirmed = false;
    self->confirm_at = now(self);
    pw_device_begin(&self->device, self->port, &self->about);
    for (uint32_t i = 0; i < self->line_count; i++) {
        pw_line_begin(self->lines[i], (uint8_t)PW_DOOR_LINE(i), i != 0u);
    }
    return boots;
}

bool pw_life_begin(struct pw_life *self, enum pw_leave how)
{
    self->usb.attached = false;
    self->usb.was_configured = false; /* by a host of the life before */
    self->in_dfu = how == PW_LEAVE_DFU;
    if (!self->in_dfu) {
        if (how == PW_LEAVE_REVERT) {
            pw_boot_revert(self->port);
        }
        return begin_device(self);
    }
    for (uint32_t i = 0; i < self->line_count; i++) {
        self->lines[i]->deaf = true; /* STA-005 */
    }
    pw_dfu_begin(&self->dfu, self->port, &self->boot);
    return true;
}

void pw_life_attach(struct pw_life *self, bool high_speed)
{
    pw_usb_begin(&self->usb, &self->device, self->lines[0], &self->dfu, &self->about, high_speed, self->in_dfu);
}

void pw_life_confirm(struct pw_life *self)
{
    bool spoken = self->usb.was_configured;
    for (uint32_t i = 0; i < self->line_count; i++) {
        spoken = spoken || self->lines[i]->answered;
    }
    if (!self->confirmed && spoken && (self->device.numbered == PW_PROCESSORS) && (now(self) >= self->confirm_at)) {
        self->confirmed = pw_boot_confirm(self->port, &self->boot);
        self->confirm_at = now(self) + CONFIRM_TICKS;
    }
}
