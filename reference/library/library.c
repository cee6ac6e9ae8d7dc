/* The machine behind library.h: power, the loader, the device with its doors, and DFU mode, event by event. */
#include "library.h"

#include <stdlib.h>
#include <string.h>

#include "../posix/chain.h"
#include "../posix/factory.h"
#include "../posix/flash.h"
#include "dfu.h"
#include "fwu.h"
#include "ser.h"
#include "usb.h"

#define UART 1u
#define AWAY_TICKS (20u * (uint64_t)PW_TICKS_PER_MS)   /* off the bus: DFU-002 */
#define PATIENCE_TICKS (10u * (uint64_t)PW_TICKS_PER_MS) /* for an answer that is LATER */
#define CONFIRM_TICKS (5u * (uint64_t)PW_TICKS_PER_MS)

static const uint8_t FIRMWARE[3] = {1, 0, 0};

/* What all ports play from a period on, until the next one that is kept. */
struct play {
    uint64_t period;
    uint32_t words[PW_PROCESSORS][PW_TICKS];
};

struct machine {
    uint64_t tick;
    bool powered, high_speed, plugged, in_dfu, confirmed, away;
    uint64_t back_at;    /* tick at which it comes to the bus */
    uint64_t confirm_at;
    uint32_t generation;
    struct pw_port port;
    struct pw_about about;
    struct pw_boot running;
    struct pw_device device;
    struct pw_usb usb;
    struct pw_line lines[PW_LINES];
    struct pw_dfu dfu;
    struct chain chain;
    struct flash flash;
    uint16_t wiring[PW_CHANNELS];
    char serial_number[65];
    struct play *plays;
    size_t play_count, play_room;
};

/* The port ----------------------------------------------------------------------------------------------------- */

static uint64_t port_now(void *self)
{
    return ((struct machine *)self)->tick;
}

static bool port_chain(void *self, const uint8_t *message, size_t size)
{
    return chain_send(&((struct machine *)self)->chain, message, size);
}

static void keep(struct machine *self)
{
    if (self->play_count == self->play_room) {
        const size_t room = self->play_room == 0u ? 256u : 2u * self->play_room;
        struct play *plays = realloc(self->plays, room * sizeof *plays);
        if (plays == NULL) {
            abort(); /* a test that has no memory has no result */
        }
        self->plays = plays;
        self->play_room = room;
    }
    struct play *play = &self->plays[self->play_count];
    self->play_count++;
    play->period = self->chain.period;
    for (uint32_t i = 0; i < PW_PROCESSORS; i++) {
        memcpy(play->words[i], self->chain.processors[i].words, sizeof play->words[i]);
    }
}

static void port_sync(void *opaque)
{
    struct machine *self = opaque;
    const bool first = !self->chain.begun;
    chain_sync(&self->chain, self->tick);
    if (first) {
        keep(self);
    }
}

static void port_identify(void *self, uint8_t board)
{
    (void)self;
    (void)board;
}

static bool port_flash_read(void *self, uint32_t address, uint8_t *data, size_t size)
{
    return flash_read(&((struct machine *)self)->flash, address, data, size);
}

static bool port_flash_erase(void *opaque, uint32_t address)
{
    struct machine *self = opaque;
    return flash_erase(&self->flash, self->tick, address);
}

static bool port_flash_program(void *opaque, uint32_t address, const uint8_t *data, size_t size)
{
    struct machine *self = opaque;
    return flash_program(&self->flash, self->tick, address, data, size);
}

static bool port_flash_busy(void *opaque)
{
    struct machine *self = opaque;
    return flash_busy(&self->flash, self->tick);
}

/* Life --------------------------------------------------------------------------------------------------------- */

struct machine *machine_new(const uint16_t *wiring, const char *serial_number, bool high_speed)
{
    struct machine *self = calloc(1, sizeof *self);
    bool blank = false;
    if (self == NULL || !flash_open(&self->flash, NULL, &blank)) {
        free(self);
        return NULL;
    }
    factory_image(self->flash.bytes, FIRMWARE);
    memcpy(self->wiring, wiring, sizeof self->wiring);
    strncpy(self->serial_number, serial_number, sizeof self->serial_number - 1u);
    self->high_speed = high_speed;
    self->plugged = true;
    const struct pw_port port = {self, port_now, port_chain, port_sync, port_identify, port_flash_read,
                                 port_flash_erase, port_flash_program, port_flash_busy, NULL};
    self->port = port;
    return self;
}

void machine_free(struct machine *self)
{
    flash_close(&self->flash);
    free(self->plays);
    free(self);
}

static void start(struct machine *self)
{
    self->flash.at_once = true;
    (void)pw_boot(&self->port, &self->running);
    self->flash.at_once = false;
    self->in_dfu = false;
    self->confirmed = false;
    self->usb.was_configured = false;
    self->confirm_at = self->tick;
    self->play_count = 0;
    memset(&self->about, 0, sizeof self->about);
    const size_t length = strlen(self->serial_number);
    for (size_t i = 0; i < length; i++) {
        self->about.unique_id[i % 8u] = (uint8_t)(self->about.unique_id[i % 8u] * 31u + (uint8_t)self->serial_number[i]);
    }
    memcpy(self->about.firmware, self->running.firmware, 3);
    self->about.bank = self->running.bank;
    self->about.faults = self->running.faults;
    self->about.product = 1;
    self->about.product_name = "phasewire reference device";
    self->about.serial_number = self->serial_number;
    self->about.wiring = self->wiring;
    self->about.columns = 20;
    self->about.rows = 16;
    self->about.pitch_um = 10300;
    chain_begin(&self->chain, self->about.firmware, self->about.unique_id);
    pw_device_begin(&self->device, &self->port, &self->about);
    pw_line_begin(&self->lines[0], PW_DOOR_LINE(0u), false);
    pw_line_begin(&self->lines[UART], PW_DOOR_LINE(UART), true);
}

/* Off the bus, to come back in some time. */
static void go_away(struct machine *self)
{
    self->away = true;
    self->usb.attached = false;
    self->back_at = self->tick + AWAY_TICKS;
}

static void come_back(struct machine *self)
{
    if (self->away && self->plugged && self->tick >= self->back_at
        && (self->in_dfu || pw_device_serving(&self->device))) {
        self->away = false;
        self->generation++;
        pw_usb_begin(&self->usb, &self->device, self->in_dfu ? NULL : &self->lines[0], &self->dfu, &self->about,
                     self->high_speed, self->in_dfu);
    }
}

void machine_power(struct machine *self, bool on)
{
    if (on && !self->powered) {
        self->powered = true;
        start(self);
        self->away = true;
        self->back_at = self->tick;
        machine_run(self, self->tick);
    } else if (!on && self->powered) {
        self->powered = false;
        self->usb.attached = false;
        flash_power_cut(&self->flash);
    } else {
        /* It is so already. */
    }
}

static void leave(struct machine *self, enum pw_leave how)
{
    go_away(self);
    if (how == PW_LEAVE_DFU) {
        self->in_dfu = true;
        self->lines[UART].deaf = true;
        self->flash.at_once = true;
        pw_dfu_begin(&self->dfu, &self->port, &self->running);
        self->flash.at_once = false;
        return;
    }
    if (how == PW_LEAVE_REVERT) {
        self->flash.at_once = true;
        pw_boot_revert(&self->port);
        self->flash.at_once = false;
    }
    start(self);
}

/* FWU-020 */
static void confirm(struct machine *self)
{
    const bool spoken = self->usb.was_configured || self->lines[0].answered || self->lines[UART].answered;
    if (!self->confirmed && spoken && self->device.numbered == PW_PROCESSORS && self->tick >= self->confirm_at) {
        self->confirmed = pw_boot_confirm(&self->port, &self->running);
        self->confirm_at = self->tick + CONFIRM_TICKS;
    }
}

/* Time --------------------------------------------------------------------------------------------------------- */

static uint64_t earlier(uint64_t a, uint64_t b)
{
    return a < b ? a : b;
}

uint64_t machine_now(const struct machine *self)
{
    return self->tick;
}

uint64_t machine_due(const struct machine *self)
{
    if (!self->powered) {
        return PW_NEVER;
    }
    uint64_t due = self->in_dfu ? pw_dfu_due(&self->dfu) : pw_device_due(&self->device);
    if (self->away && self->plugged) {
        due = earlier(due, self->back_at > self->tick ? self->back_at : self->tick + 1u);
    }
    if (self->flash.busy) {
        due = earlier(due, self->flash.busy_until);
    }
    return due;
}

/* Besides, the periods of the processors, of which nothing is seen outside. */
static uint64_t due_inside(const struct machine *self)
{
    const uint64_t due = machine_due(self);
    return self->powered && !self->in_dfu ? earlier(due, chain_due(&self->chain)) : due;
}

/* Everything that is due in this tick. */
static void work(struct machine *self)
{
    (void)flash_busy(&self->flash, self->tick);
    if (self->in_dfu) {
        pw_dfu_poll(&self->dfu);
        if (pw_dfu_leaves(&self->dfu)) {
            go_away(self);
            start(self);
        }
        come_back(self);
        return;
    }
    if (chain_due(&self->chain) == self->tick) {
        chain_period(&self->chain);
        if (self->chain.changed) {
            keep(self);
        }
    }
    pw_device_poll(&self->device);
    chain_deliver(&self->chain, &self->device);
    pw_line_poll(&self->lines[0], &self->device);
    pw_line_poll(&self->lines[UART], &self->device);
    if (self->usb.attached) {
        pw_usb_poll(&self->usb);
    }
    confirm(self);
    const enum pw_leave how = pw_device_leaving(&self->device);
    if (how != PW_STAY && pw_line_idle(&self->lines[UART])) {
        leave(self, how);
    }
    come_back(self);
}

void machine_run(struct machine *self, uint64_t tick)
{
    for (uint64_t due = due_inside(self); due <= tick; due = due_inside(self)) {
        self->tick = self->tick < due ? due : self->tick;
        work(self);
        if (!self->in_dfu && due == due_inside(self)) {
            break; /* it waits for the caller, such as a UART that is not read */
        }
    }
    self->tick = tick;
    if (self->powered) {
        work(self);
    }
}

bool machine_serves(const struct machine *self)
{
    return self->powered && !self->in_dfu && pw_device_serving(&self->device);
}

uint64_t machine_origin(const struct machine *self)
{
    return self->device.origin;
}

/* USB ---------------------------------------------------------------------------------------------------------- */

bool machine_attached(const struct machine *self)
{
    return self->powered && self->usb.attached;
}

uint32_t machine_generation(const struct machine *self)
{
    return self->generation;
}

bool machine_configured(const struct machine *self)
{
    return machine_attached(self) && self->usb.configured;
}

void machine_plug(struct machine *self, bool in)
{
    if (!in && machine_attached(self)) {
        pw_usb_unplugged(&self->usb);
    }
    if (!in) {
        self->usb.attached = false;
    } else if (!self->plugged) {
        self->away = true;
        self->back_at = self->tick;
    } else {
        /* It is in already. */
    }
    self->plugged = in;
    machine_run(self, self->tick);
}

void machine_bus(struct machine *self, int what)
{
    if (!machine_attached(self)) {
        return;
    }
    if (what == MACHINE_RESET) {
        pw_usb_bus_reset(&self->usb);
    } else if (what == MACHINE_SUSPEND) {
        pw_usb_suspend(&self->usb);
    } else {
        pw_usb_resume(&self->usb);
    }
    machine_run(self, self->tick);
}

int machine_control(struct machine *self, const uint8_t setup[8], uint8_t *data)
{
    uint8_t out[PW_USB_CONTROL];
    const struct pw_setup request = {setup[0], setup[1], pw_get16(setup + 2), pw_get16(setup + 4), pw_get16(setup + 6)};
    memcpy(out, data, sizeof out);
    const uint64_t last = self->tick + PATIENCE_TICKS;
    int size = pw_usb_control(&self->usb, &request, out, data);
    chain_deliver(&self->chain, &self->device);
    while (size == PW_USB_NAK && self->tick < last) {
        size = pw_usb_control_again(&self->usb, data);
        if (size == PW_USB_NAK) {
            machine_run(self, self->tick + 1u);
        }
    }
    return size;
}

int machine_out(struct machine *self, uint8_t endpoint, const uint8_t *packet, size_t size)
{
    const int taken = pw_usb_out(&self->usb, endpoint, packet, size);
    chain_deliver(&self->chain, &self->device);
    return taken;
}

int machine_in(struct machine *self, uint8_t endpoint, uint8_t *packet)
{
    return pw_usb_in(&self->usb, endpoint, packet, PW_USB_PACKET);
}

/* The UART ----------------------------------------------------------------------------------------------------- */

size_t machine_hear(struct machine *self, const uint8_t *bytes, size_t size)
{
    if (!machine_serves(self)) {
        return size; /* nobody listens */
    }
    const size_t taken = pw_line_receive(&self->lines[UART], &self->device, bytes, size);
    chain_deliver(&self->chain, &self->device);
    pw_line_poll(&self->lines[UART], &self->device);
    return taken;
}

size_t machine_say(struct machine *self, uint8_t *bytes, size_t room)
{
    return machine_serves(self) ? pw_line_send(&self->lines[UART], &self->device, bytes, room) : 0u;
}

void machine_break(struct machine *self)
{
    if (machine_serves(self)) {
        pw_line_hang_up(&self->lines[UART], &self->device);
    }
}

/* For the bench ------------------------------------------------------------------------------------------------ */

bool machine_words(const struct machine *self, uint64_t first, size_t periods, uint32_t *words)
{
    if (!machine_serves(self) || first + periods > self->chain.period + 1u || self->play_count == 0u) {
        return false;
    }
    size_t at = 0;
    size_t beyond = self->play_count;
    while (beyond - at > 1u) { /* the last play that began by `first` */
        const size_t middle = (at + beyond) / 2u;
        if (self->plays[middle].period <= first) {
            at = middle;
        } else {
            beyond = middle;
        }
    }
    for (uint64_t period = first; period < first + periods; period++) {
        while (at + 1u < self->play_count && self->plays[at + 1u].period <= period) {
            at++;
        }
        for (uint32_t tick = 0; tick < PW_TICKS; tick++) {
            for (uint32_t i = 0; i < PW_PROCESSORS; i++) {
                *words = self->plays[at].words[i][tick];
                words++;
            }
        }
    }
    return true;
}

void machine_fault(struct machine *self, uint8_t processor, uint16_t faults)
{
    self->chain.processors[processor].lasting_faults = faults;
}
