/* What the flash does and fails to do. */
#include "memory.h"

#include <string.h>

#include "device.h"

bool memory_open(struct memory *self, struct faults *faults)
{
    bool blank = false;
    self->faults = faults;
    self->dice = 1;
    return flash_open(&self->flash, NULL, &blank);
}

void memory_close(struct memory *self)
{
    flash_close(&self->flash);
}

uint64_t memory_due(const struct memory *self)
{
    return self->cut ? self->cut_at : PW_NEVER;
}

/* Random bits, the same ones in every run. */
static uint32_t throw(struct memory *self)
{
    self->dice = self->dice * 1664525u + 1013904223u;
    return self->dice >> 8;
}

/* A byte of a sector whose erasure was cut short: some of its bits have changed, the more the later that was, and not
   only to 1, as a flash clears all bits before it sets them. */
static uint8_t half_erased(struct memory *self, uint8_t was)
{
    uint8_t byte = was;
    for (uint32_t bit = 0; bit < 8u; bit++) {
        if (throw(self) % FLASH_SECTOR < self->done) {
            const uint8_t one = (uint8_t)(1u << bit);
            byte = (uint8_t)((throw(self) & 1u) != 0u ? byte | one : byte & (uint8_t)~one);
        }
    }
    return byte;
}

/* The power has gone within some work. */
static void leave_undone(struct memory *self)
{
    uint8_t *at = &self->flash.bytes[self->address];
    memcpy(at, self->before, self->size);
    for (uint32_t i = 0; i < self->size; i++) {
        if (self->erases) {
            at[i] = half_erased(self, at[i]);
        } else if (i <= self->done) {
            const uint8_t slow = (uint8_t)(i == self->done ? throw(self) & 0xFFu : 0u); /* bits that were not cleared */
            at[i] &= (uint8_t)(self->page[i] | slow);
        } else {
            break;
        }
    }
}

void memory_power(struct memory *self, bool on)
{
    if (!on) {
        flash_power_cut(&self->flash);
        if (self->cut && !self->dead) {
            leave_undone(self);
        }
    }
    self->dead = !on;
    self->cut = false;
}

bool memory_read(struct memory *self, uint64_t now, uint32_t address, uint8_t *data, size_t size)
{
    if (self->dead || !flash_read(&self->flash, address, data, size)) {
        return false;
    }
    const struct machine_fault *stuck = faults_next(self->faults, now, MACHINE_STUCK_BIT, NULL);
    while (stuck != NULL) {
        const uint32_t at = (uint32_t)stuck->where - address;
        if ((uint32_t)stuck->where >= address && at < size) {
            const uint8_t bit = (uint8_t)(1u << (uint32_t)stuck->what);
            data[at] = (uint8_t)(stuck->value != 0 ? data[at] | bit : data[at] & (uint8_t)~bit);
        }
        stuck = faults_next(self->faults, now, MACHINE_STUCK_BIT, stuck);
    }
    return true;
}

/* Whether a sector or a page fails, as the flash then says. */
static bool fails(struct memory *self, uint64_t now, enum machine_trouble kind, uint32_t address, uint32_t size)
{
    const struct machine_fault *fault = faults_next(self->faults, now, kind, NULL);
    while (fault != NULL && (uint32_t)fault->where / size != address / size) {
        fault = faults_next(self->faults, now, kind, fault);
    }
    return fault != NULL;
}

/* Counts bytes that are written, and finds whether the power goes within them. */
static void count(struct memory *self, uint64_t now)
{
    struct machine_fault *fault = faults_next(self->faults, now, MACHINE_CUT_IN_WRITE, NULL);
    while (fault != NULL) {
        if ((uint32_t)fault->where >= self->size) {
            fault->where -= (int32_t)self->size;
        } else {
            self->cut = true;
            self->done = (uint32_t)fault->where;
            self->off_periods = fault->value;
            fault->times = 0;
        }
        fault = faults_next(self->faults, now, MACHINE_CUT_IN_WRITE, fault);
    }
}

/* Notes what stands where something will be written. */
static void look(struct memory *self, uint32_t address, const uint8_t *data, uint32_t size)
{
    self->erases = data == NULL;
    self->address = address;
    self->size = size;
    memcpy(self->before, &self->flash.bytes[address], size);
    if (data != NULL) {
        memcpy(self->page, data, size);
    }
}

/* The work has begun: if it fails nothing changes, and if the power goes within it that has its tick. */
static bool begun(struct memory *self, uint64_t now, bool fails_now)
{
    self->failed = fails_now;
    if (fails_now) {
        memcpy(&self->flash.bytes[self->address], self->before, self->size);
        flash_power_cut(&self->flash); /* nothing of it remains to be done */
        return true;
    }
    count(self, now);
    if (!self->cut) {
        return true;
    }
    const uint64_t lasts = self->flash.busy ? self->flash.busy_until - now : 0u;
    self->cut_at = now + lasts * self->done / self->size;
    if (self->flash.at_once) {
        leave_undone(self); /* the loader's time stands still: what it does now it does without power */
        self->dead = true;
        self->cut_at = now;
    }
    return true;
}

static bool is_refused(struct memory *self, uint64_t now)
{
    return self->dead || faults_next(self->faults, now, MACHINE_WRITE_PROTECTED, NULL) != NULL;
}

bool memory_erase(struct memory *self, uint64_t now, uint32_t address)
{
    if (is_refused(self, now) || address % FLASH_SECTOR != 0u || address >= FLASH_SIZE) {
        return false;
    }
    look(self, address, NULL, FLASH_SECTOR);
    return flash_erase(&self->flash, now, address)
        && begun(self, now, fails(self, now, MACHINE_FAILING_SECTOR, address, FLASH_SECTOR));
}

bool memory_program(struct memory *self, uint64_t now, uint32_t address, const uint8_t *data, size_t size)
{
    if (is_refused(self, now) || size == 0u || address >= FLASH_SIZE || address % FLASH_PAGE + size > FLASH_PAGE) {
        return false;
    }
    look(self, address, data, (uint32_t)size);
    return flash_program(&self->flash, now, address, data, size)
        && begun(self, now, fails(self, now, MACHINE_FAILING_PAGE, address, FLASH_PAGE));
}

bool memory_busy(struct memory *self, uint64_t now)
{
    return !self->dead && flash_busy(&self->flash, now);
}
