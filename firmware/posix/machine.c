/* A device as a whole. At each tick at which something is due the processors come first, then the controller, then the
   doors: a commit for the next period finds the one before it playing (CHN-007). */
#include "machine.h"

#include <stdio.h>
#include <string.h>

#include "booting.h"

#define OFF_TICKS (20u * (uint64_t)PW_TICKS_PER_MS)   /* off the bus; at least 10 ms: DFU-002 */
#define LEAVE_TICKS (100u * (uint64_t)PW_TICKS_PER_MS) /* that a line has to send what it holds */
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
    chain_begin(&machine->chain, machine->life.about.firmware, machine->life.about.unique_id);
}

static bool port_program(void *self, uint8_t processor)
{
    struct machine *machine = self;
    struct booting booting = {0};
    if (!pw_boot_program(&machine->port, &machine->life.boot, processor, booting_take, &booting)
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
    self->life.port = &self->port;
    self->life.about.product = PRODUCT;
    self->life.about.product_name = PRODUCT_NAME;
    self->life.about.serial_number = self->serial_number;
    self->life.about.wiring = self->wiring;
    self->life.about.columns = COLUMNS;
    self->life.about.rows = ROWS;
    self->life.about.pitch_um = PITCH_UM;
    pw_unique_id(self->life.about.unique_id, self->serial_number);
    self->life.lines[0] = &self->usb_line;
    for (uint32_t i = 0; i < self->line_count; i++) {
        self->life.lines[1u + i] = &self->lines[i].line;
    }
    self->life.line_count = 1u + self->line_count;
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

/* The loader waits for the flash, so that its work takes no time here. */
static bool begin(struct machine *self)
{
    self->flash.at_once = true;
    const bool boots = pw_life_begin(&self->life, self->next);
    self->flash.at_once = false;
    return boots;
}

void machine_power_up(struct machine *self)
{
    if (!begin(self)) {
        self->dead = true;
        fprintf(stderr, "phasewire-reference: the flash holds no firmware that could be started\n");
        return;
    }
    self->next = PW_STAY;
    self->mode = self->life.in_dfu ? MACHINE_UPDATES : MACHINE_RUNS;
    if (!self->life.in_dfu) {
        for (uint32_t i = 0; i < self->line_count; i++) {
            serial_begin(&self->lines[i]);
        }
        pw_device_poll(&self->life.device);
        chain_deliver(&self->chain, &self->life.device);
        pw_device_poll(&self->life.device); /* the last identity has come: period 0 begins */
    }
    pw_life_attach(&self->life, !self->full_speed);
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
        return earlier(pw_device_due(&self->life.device), self->usbip == NULL ? PW_NEVER : usbip_due(self->usbip));
    }
    return self->mode == MACHINE_OFF ? self->back_at : pw_dfu_due(&self->life.dfu);
}

/* What is answered LATER, and blocks that wait for room. */
static void poll_doors(struct machine *self)
{
    for (uint32_t i = 0; i < self->line_count; i++) {
        pw_line_poll(&self->lines[i].line, &self->life.device);
    }
    pw_line_poll(&self->usb_line, &self->life.device);
    if (self->usbip != NULL) {
        pw_usb_poll(&self->life.usb);
        usbip_work(self->usbip);
    }
    chain_deliver(&self->chain, &self->life.device);
}

static void step_device(struct machine *self)
{
    if (chain_due(&self->chain) == self->tick) {
        machine_record(self);
        chain_period(&self->chain);
    }
    if (machine_due(self) <= self->tick) {
        pw_device_poll(&self->life.device);
        chain_deliver(&self->chain, &self->life.device);
        poll_doors(self);
    }
}

static void step_update(struct machine *self)
{
    pw_dfu_poll(&self->life.dfu);
    if (self->usbip != NULL) {
        pw_usb_poll(&self->life.usb);
        usbip_work(self->usbip);
    }
    if (pw_dfu_leaves(&self->life.dfu)) {
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
    struct pw_device *device = self->mode == MACHINE_RUNS ? &self->life.device : NULL;
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
    pw_life_confirm(&self->life);
    const enum pw_leave how = pw_device_leaving(&self->life.device);
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
