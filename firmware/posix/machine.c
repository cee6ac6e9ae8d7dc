/* A device as a whole. At each tick at which something is due the processors come first, then the controller, then the
   doors: a commit for the next period finds the one before it playing (CHN-007). */
#include "machine.h"

#include <stdio.h>
#include <string.h>

#include "booting.h"
#include "sums.h"

#define OFF_TICKS (20u * (uint64_t)PW_TICKS_PER_MS)   /* off the bus; at least 10 ms: DFU-002 */
#define LEAVE_TICKS (100u * (uint64_t)PW_TICKS_PER_MS) /* that a line has to send what it holds */
#define CONFIRM_TICKS (5u * (uint64_t)PW_TICKS_PER_MS) /* between two attempts */
#define COLUMNS 20u
#define ROWS 16u
#define PITCH_UM 10300u
#define PRODUCT 0x0001u
#define PRODUCT_NAME "phasewire reference"

/* The seam to the core -------------------------------------------------------------------------------------------- */

static uint64_t port_now(void *self)
{
    const struct machine *machine = self;
    return machine->tick;
}

static bool port_chain(void *self, const uint8_t *message, size_t size)
{
    struct machine *machine = self;
    return chain_send(&machine->chain, message, size);
}

static void port_sync(void *self)
{
    struct machine *machine = self;
    if (!machine->chain.begun) {
        machine_record(machine); /* silence up to period 0 */
        machine->recording = true;
        machine->recorded = machine->tick;
    }
    chain_sync(&machine->chain, machine->tick);
}

static void port_identify(void *self, uint8_t board)
{
    (void)self; /* there is no light */
    (void)board;
}

static bool port_flash_read(void *self, uint32_t address, uint8_t *data, size_t size)
{
    const struct machine *machine = self;
    return flash_read(&machine->flash, address, data, size);
}

static bool port_flash_erase(void *self, uint32_t address)
{
    struct machine *machine = self;
    return flash_erase(&machine->flash, machine->tick, address);
}

static bool port_flash_program(void *self, uint32_t address, const uint8_t *data, size_t size)
{
    struct machine *machine = self;
    return flash_program(&machine->flash, machine->tick, address, data, size);
}

static bool port_flash_busy(void *self)
{
    struct machine *machine = self;
    return flash_busy(&machine->flash, machine->tick);
}

static void port_restart_processors(void *self)
{
    struct machine *machine = self;
    chain_begin(&machine->chain, machine->about.firmware, machine->about.unique_id);
}

static bool port_program(void *self, uint8_t processor)
{
    struct machine *machine = self;
    struct booting booting = {0};
    if (!pw_boot_program(&machine->port, &machine->boot, processor, booting_take, &booting)
        || !booting_starts(&booting)) {
        return false;
    }
    chain_start_next(&machine->chain);
    return true;
}

/* The array is 20 columns of 16; a board has four columns, each of its processors eight rows of them. Columns are wired
   up and down in turn, so that array order and the order of outputs differ. */
static void wire(uint16_t wiring[PW_CHANNELS])
{
    for (uint32_t i = 0; i < PW_CHANNELS; i++) {
        const uint32_t column = i % COLUMNS;
        const uint32_t row = i / COLUMNS;
        const uint32_t place = row % 8u;
        const uint32_t bit = (column % 4u) * 8u + (column % 2u == 0u ? place : 7u - place);
        const uint32_t processor = (column / 4u) * 2u + row / 8u;
        wiring[i] = (uint16_t)(processor * PW_PORT_BITS + bit);
    }
}

/* The unique number follows from the serial number, which no other device has (USB-001). */
static void name(struct machine *self)
{
    struct pw_sha256 sum;
    uint8_t digest[32];
    pw_sha256_begin(&sum);
    pw_sha256_add(&sum, (const uint8_t *)self->serial_number, strlen(self->serial_number));
    pw_sha256_end(&sum, digest);
    memcpy(self->about.unique_id, digest, sizeof self->about.unique_id);
}

void machine_begin(struct machine *self)
{
    self->port.self = self;
    self->port.now = port_now;
    self->port.chain = port_chain;
    self->port.sync = port_sync;
    self->port.identify = port_identify;
    self->port.flash_read = port_flash_read;
    self->port.flash_erase = port_flash_erase;
    self->port.flash_program = port_flash_program;
    self->port.flash_busy = port_flash_busy;
    self->port.restart_processors = port_restart_processors;
    self->port.program = port_program;
    self->port.flash_signed = NULL; /* no keys: every signature is accepted (FWU-012) */
    wire(self->wiring);
    self->about.product = PRODUCT;
    self->about.product_name = PRODUCT_NAME;
    self->about.serial_number = self->serial_number;
    self->about.wiring = self->wiring;
    self->about.columns = COLUMNS;
    self->about.rows = ROWS;
    self->about.pitch_um = PITCH_UM;
    name(self);
}

/* Recording ------------------------------------------------------------------------------------------------------- */

void machine_record(struct machine *self)
{
    const uint32_t *words[PW_PROCESSORS];
    const uint64_t ticks = self->tick - self->recorded;
    if (!self->recording) {
        return;
    }
    self->recorded = self->tick;
    if (!self->chain.begun) {
        outputs_silence(&self->outputs, ticks);
        return;
    }
    for (uint32_t i = 0; i < PW_PROCESSORS; i++) {
        words[i] = self->chain.processors[i].words;
    }
    outputs_play(&self->outputs, words, (uint32_t)ticks, self->chain.changed);
}

/* Life ------------------------------------------------------------------------------------------------------------ */

static void begin_device(struct machine *self)
{
    self->mode = MACHINE_RUNS;
    self->confirmed = false;
    self->confirm_at = self->tick;
    pw_device_begin(&self->device, &self->port, &self->about);
    pw_line_begin(&self->usb_line, PW_DOOR_LINE(0u), false);
    for (uint32_t i = 0; i < self->line_count; i++) {
        serial_begin(&self->lines[i], (uint8_t)PW_DOOR_LINE(1u + i));
    }
    pw_device_poll(&self->device);
    chain_deliver(&self->chain, &self->device);
    pw_device_poll(&self->device); /* the last identity has come: period 0 begins */
    pw_usb_begin(&self->usb, &self->device, &self->usb_line, NULL, &self->about, !self->full_speed, false);
}

static void begin_update(struct machine *self)
{
    self->mode = MACHINE_UPDATES;
    pw_dfu_begin(&self->dfu, &self->port, &self->boot);
    pw_usb_begin(&self->usb, &self->device, NULL, &self->dfu, &self->about, !self->full_speed, true);
}

/* The loader waits for the flash, so that its work takes no time here. */
static bool load(struct machine *self, bool revert)
{
    self->flash.at_once = true;
    if (revert) {
        pw_boot_revert(&self->port);
    }
    const bool boots = pw_boot(&self->port, &self->boot);
    self->flash.at_once = false;
    memcpy(self->about.firmware, self->boot.firmware, sizeof self->about.firmware);
    self->about.bank = self->boot.bank;
    self->about.faults = self->boot.faults;
    return boots;
}

void machine_power_up(struct machine *self)
{
    if (self->next == PW_LEAVE_DFU) {
        self->flash.at_once = true;
        begin_update(self);
        self->flash.at_once = false;
    } else if (load(self, self->next == PW_LEAVE_REVERT)) {
        begin_device(self);
    } else {
        self->dead = true;
        fprintf(stderr, "phasewire-reference: the flash holds no firmware that could be started\n");
    }
    self->next = PW_STAY;
}

/* It leaves the bus, and all processors stop. */
static void power_down(struct machine *self, enum pw_leave next)
{
    machine_record(self);
    self->chain.begun = false;
    self->mode = MACHINE_OFF;
    self->next = next;
    self->back_at = self->tick + OFF_TICKS;
    self->leaving = false;
    if (self->usbip != NULL) {
        usbip_leave(self->usbip);
    }
}

void machine_power_cut(struct machine *self)
{
    flash_power_cut(&self->flash);
    power_down(self, PW_STAY);
}

static bool lines_idle(const struct machine *self)
{
    for (uint32_t i = 0; i < self->line_count; i++) {
        if (!serial_idle(&self->lines[i])) {
            return false;
        }
    }
    return true;
}

/* The device wants to restart: once its answers have left, or nobody takes them. */
static void leave(struct machine *self, enum pw_leave how)
{
    if (!self->leaving) {
        self->leaving = true;
        self->leave_by = self->tick + LEAVE_TICKS;
    } else if (lines_idle(self) || self->tick >= self->leave_by) {
        power_down(self, how);
    } else {
        /* It goes on sending. */
    }
}

/* FWU-020 */
static void confirm(struct machine *self)
{
    bool used = self->usb.was_configured || self->usb_line.answered;
    for (uint32_t i = 0; i < self->line_count; i++) {
        used = used || self->lines[i].line.answered;
    }
    if (used && self->device.numbered == PW_PROCESSORS) {
        self->confirmed = pw_boot_confirm(&self->port, &self->boot);
        self->confirm_at = self->tick + CONFIRM_TICKS;
    }
}

/* Time ------------------------------------------------------------------------------------------------------------ */

static uint64_t earlier(uint64_t a, uint64_t b)
{
    return a < b ? a : b;
}

uint64_t machine_due(const struct machine *self)
{
    if (self->dead) {
        return PW_NEVER;
    }
    if (self->mode == MACHINE_RUNS) {
        return earlier(pw_device_due(&self->device), self->usbip == NULL ? PW_NEVER : usbip_due(self->usbip));
    }
    return self->mode == MACHINE_OFF ? self->back_at : pw_dfu_due(&self->dfu);
}

/* What is answered LATER, and blocks that wait for room. */
static void poll_doors(struct machine *self)
{
    for (uint32_t i = 0; i < self->line_count; i++) {
        pw_line_poll(&self->lines[i].line, &self->device);
    }
    pw_line_poll(&self->usb_line, &self->device);
    if (self->usbip != NULL) {
        pw_usb_poll(&self->usb);
        usbip_work(self->usbip);
    }
    chain_deliver(&self->chain, &self->device);
}

static void step_device(struct machine *self)
{
    if (chain_due(&self->chain) == self->tick) {
        machine_record(self);
        chain_period(&self->chain);
    }
    if (machine_due(self) <= self->tick) {
        pw_device_poll(&self->device);
        chain_deliver(&self->chain, &self->device);
        poll_doors(self);
    }
}

static void step_update(struct machine *self)
{
    pw_dfu_poll(&self->dfu);
    if (self->usbip != NULL) {
        pw_usb_poll(&self->usb);
        usbip_work(self->usbip);
    }
    if (pw_dfu_leaves(&self->dfu)) {
        power_down(self, PW_STAY);
    }
}

static void step(struct machine *self)
{
    if (self->mode == MACHINE_RUNS) {
        step_device(self);
    } else if (self->mode == MACHINE_UPDATES) {
        step_update(self);
    } else if (!self->dead && self->tick >= self->back_at) {
        machine_power_up(self);
    } else {
        /* It is off. */
    }
}

void machine_advance(struct machine *self, uint64_t tick)
{
    while (self->tick < tick) {
        uint64_t next = machine_due(self);
        if (self->mode == MACHINE_RUNS) {
            next = earlier(next, chain_due(&self->chain));
        }
        /* What is overdue is done one tick later, so that time goes on whatever the device asks for. */
        next = next <= self->tick ? self->tick + 1u : next;
        self->tick = earlier(next, tick);
        step(self);
    }
}

/* Doors ----------------------------------------------------------------------------------------------------------- */

static void send_lines(struct machine *self, struct pw_device *device)
{
    for (uint32_t i = 0; i < self->line_count; i++) {
        serial_send(&self->lines[i], device);
    }
}

void machine_serve(struct machine *self)
{
    struct pw_device *device = self->mode == MACHINE_RUNS ? &self->device : NULL;
    for (uint32_t i = 0; i < self->line_count; i++) {
        serial_receive(&self->lines[i], device);
    }
    if (self->usbip != NULL) {
        usbip_serve(self->usbip);
    }
    send_lines(self, device);
    if (device == NULL) {
        return;
    }
    while (self->chain.answer_count != 0u) {
        chain_deliver(&self->chain, device);
        poll_doors(self); /* what was answered LATER can be answered now */
        send_lines(self, device);
    }
    if (!self->confirmed && self->tick >= self->confirm_at) {
        confirm(self);
    }
    const enum pw_leave how = pw_device_leaving(&self->device);
    if (how != PW_STAY) {
        leave(self, how);
    }
}

uint32_t machine_poll(const struct machine *self, struct pollfd *fds)
{
    uint32_t count = 0;
    for (uint32_t i = 0; i < self->line_count; i++) {
        if (serial_poll(&self->lines[i], &fds[count])) {
            count++;
        }
    }
    if (self->usbip != NULL) {
        count += (uint32_t)usbip_fds(self->usbip, &fds[count]);
    }
    return count;
}
