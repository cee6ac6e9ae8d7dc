/* The machine behind library.h: power, the loader, the device with its doors, and DFU mode, event by event. */
#include "library.h"

#include <stdlib.h>
#include <string.h>

#include "../posix/booting.h"
#include "../posix/factory.h"
#include "idle.h"
#include "life.h"
#include "memory.h"
#include "plays.h"

#define UART 1u
#define AWAY_TICKS (20u * (uint64_t)PW_TICKS_PER_MS)   /* off the bus: DFU-002 */
#define PATIENCE_TICKS (10u * (uint64_t)PW_TICKS_PER_MS) /* for an answer that is LATER */

static const uint8_t FIRMWARE[3] = {1, 0, 0};
static const struct pw_about ABOUT = {.product = 1, .product_name = "phasewire reference device", .columns = 20,
                                      .rows = 16, .pitch_um = 10300};

struct machine {
    uint64_t tick;
    bool powered, high_speed, plugged, away;
    uint64_t back_at;    /* tick at which it comes to the bus */
    uint64_t power_at;   /* tick at which power comes by itself */
    uint32_t generation;
    struct pw_port port;
    struct pw_line lines[PW_LINES];
    struct pw_life life;
    struct faults faults;
    struct boards boards;
    struct memory memory;
    uint16_t wiring[PW_CHANNELS];
    char serial_number[65];
    struct plays plays;
};

/* The port ----------------------------------------------------------------------------------------------------- */

static uint64_t port_now(void *self)
{
    return ((struct machine *)self)->tick;
}

static bool port_chain(void *self, const uint8_t *message, size_t size)
{
    struct machine *machine = self;
    return boards_send(&machine->boards, machine->tick, message, size);
}

static void keep(struct machine *self)
{
    plays_keep(&self->plays, self->boards.period, self->boards.words);
}

static void port_sync(void *opaque)
{
    struct machine *self = opaque;
    const bool first = !self->boards.begun;
    boards_sync(&self->boards, self->tick);
    if (first) {
        keep(self);
    }
}

static void port_identify(void *self, uint8_t board)
{
    (void)self;
    (void)board;
}

static bool port_flash_read(void *opaque, uint32_t address, uint8_t *data, size_t size)
{
    struct machine *self = opaque;
    return memory_read(&self->memory, self->tick, address, data, size);
}

static bool port_flash_erase(void *opaque, uint32_t address)
{
    struct machine *self = opaque;
    return memory_erase(&self->memory, self->tick, address);
}

static bool port_flash_program(void *opaque, uint32_t address, const uint8_t *data, size_t size)
{
    struct machine *self = opaque;
    return memory_program(&self->memory, self->tick, address, data, size);
}

static bool port_flash_busy(void *opaque)
{
    struct machine *self = opaque;
    return memory_busy(&self->memory, self->tick);
}

static bool port_flash_failed(void *self)
{
    return ((struct machine *)self)->memory.failed;
}

static void port_restart_processors(void *opaque)
{
    struct machine *self = opaque;
    boards_begin(&self->boards, &self->faults, self->tick, self->life.about.firmware, self->life.about.unique_id);
}

static bool port_program(void *opaque, uint8_t processor)
{
    struct machine *self = opaque;
    struct booting booting = {0};
    return pw_boot_program(&self->port, &self->life.boot, processor, booting_take, &booting) && booting_starts(&booting)
        && boards_start_next(&self->boards, self->tick);
}

/* Life --------------------------------------------------------------------------------------------------------- */

struct machine *machine_new(const uint16_t *wiring, const char *serial_number, bool high_speed)
{
    struct machine *self = calloc(1, sizeof *self);
    if (self == NULL || !memory_open(&self->memory, &self->faults)) {
        free(self);
        return NULL;
    }
    factory_image(self->memory.flash.bytes, FIRMWARE);
    self->power_at = PW_NEVER;
    memcpy(self->wiring, wiring, sizeof self->wiring);
    strncpy(self->serial_number, serial_number, sizeof self->serial_number - 1u);
    self->high_speed = high_speed;
    self->plugged = true;
    const struct pw_port port = {self, port_now, port_chain, port_sync, port_identify, port_flash_read,
                                 port_flash_erase, port_flash_program, port_flash_busy, NULL,
                                 port_flash_failed, port_restart_processors, port_program};
    self->port = port;
    self->life.port = &self->port;
    self->life.about = ABOUT;
    self->life.about.serial_number = self->serial_number;
    self->life.about.wiring = self->wiring;
    pw_unique_id(self->life.about.unique_id, self->serial_number);
    self->life.lines[0] = &self->lines[0];
    self->life.lines[UART] = &self->lines[UART];
    self->life.line_count = 2;
    return self;
}

void machine_free(struct machine *self)
{
    memory_close(&self->memory);
    free(self->plays.list);
    free(self);
}

/* The loader waits for the flash, so that its work takes no time here. */
static void start(struct machine *self, enum pw_leave how)
{
    self->memory.flash.at_once = true;
    (void)pw_life_begin(&self->life, how);
    self->memory.flash.at_once = false;
    if (!self->life.in_dfu) {
        self->plays.count = 0;
    }
}

/* Off the bus, to come back in some time. */
static void leave(struct machine *self, enum pw_leave how)
{
    self->away = true;
    self->back_at = self->tick + AWAY_TICKS;
    start(self, how);
}

/* Whether it answers a host. If it does not yet, what makes it ready is due by itself. */
static bool is_ready(const struct machine *self)
{
    return self->life.in_dfu || pw_device_serving(&self->life.device);
}

static void come_back(struct machine *self)
{
    if (self->away && self->plugged && self->tick >= self->back_at && is_ready(self)) {
        self->away = false;
        self->generation++;
        pw_life_attach(&self->life, self->high_speed);
    }
}

static void power(struct machine *self, bool on)
{
    if (on == self->powered) {
        return;
    }
    self->powered = on;
    self->power_at = PW_NEVER;
    memory_power(&self->memory, on);
    if (on) {
        start(self, PW_STAY);
        self->away = true;
        self->back_at = self->tick;
    } else {
        self->life.usb.attached = false;
    }
}

void machine_power(struct machine *self, bool on)
{
    power(self, on);
    machine_run(self, self->tick);
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

bool machine_serves(const struct machine *self)
{
    return self->powered && !self->life.in_dfu && pw_device_serving(&self->life.device);
}

/* Whether nothing happens that is seen outside, unless somebody outside does something. */
static bool is_idle(const struct machine *self)
{
    return machine_serves(self) && !self->away && !self->lines[0].waits && !self->lines[UART].waits
        && idle_is(&self->life.device, &self->boards);
}

/* What happens next, but for the periods of the processors. */
static uint64_t next_due(const struct machine *self)
{
    if (!self->powered) {
        return self->power_at;
    }
    uint64_t due = self->life.in_dfu ? pw_dfu_due(&self->life.dfu) : pw_device_due(&self->life.device);
    if (self->away && self->plugged && (self->tick < self->back_at || is_ready(self))) {
        due = earlier(due, self->back_at > self->tick ? self->back_at : self->tick + 1u);
    }
    if (self->memory.flash.busy) {
        due = earlier(due, self->memory.flash.busy_until);
    }
    due = earlier(due, memory_due(&self->memory));
    return self->life.in_dfu ? due : earlier(due, boards_message_due(&self->boards));
}

uint64_t machine_due(const struct machine *self)
{
    return is_idle(self) ? PW_NEVER : next_due(self);
}

/* Besides, the periods of the processors, of which nothing is seen outside. */
static uint64_t due_inside(const struct machine *self)
{
    const uint64_t due = next_due(self);
    return self->powered && !self->life.in_dfu ? earlier(due, boards_period_due(&self->boards)) : due;
}

/* Power goes and comes by itself. Returns whether it is there. */
static bool has_power(struct machine *self)
{
    if (self->powered && self->tick >= memory_due(&self->memory)) {
        const int32_t periods = self->memory.off_periods;
        power(self, false);
        self->power_at = periods < 0 ? PW_NEVER : self->tick + (uint64_t)periods * PW_TICKS;
    }
    if (self->tick >= self->power_at) {
        power(self, true);
    }
    return self->powered;
}

/* What the processors and the controller have to do in this tick. */
static void run_device(struct machine *self)
{
    if (boards_period_due(&self->boards) == self->tick) {
        boards_period(&self->boards, self->tick);
        if (self->boards.changed) {
            keep(self);
        }
    }
    do {
        pw_device_poll(&self->life.device);
    } while (boards_deliver(&self->boards, self->tick, &self->life.device));
}

/* Everything that is due in this tick. */
static void work(struct machine *self)
{
    if (!has_power(self)) {
        return;
    }
    (void)memory_busy(&self->memory, self->tick);
    if (self->life.in_dfu) {
        pw_dfu_poll(&self->life.dfu);
        if (pw_dfu_leaves(&self->life.dfu)) {
            leave(self, PW_STAY);
        }
        come_back(self);
        return;
    }
    run_device(self);
    pw_line_poll(&self->lines[0], &self->life.device);
    pw_line_poll(&self->lines[UART], &self->life.device);
    if (self->life.usb.attached) {
        pw_usb_poll(&self->life.usb);
    }
    pw_life_confirm(&self->life);
    const enum pw_leave how = pw_device_leaving(&self->life.device);
    if (how != PW_STAY && pw_line_idle(&self->lines[UART])) {
        leave(self, how);
    }
    come_back(self);
}

/* Leave out what comes again and again while the device rests. */
static void skip_idle(struct machine *self, uint64_t tick)
{
    if (tick > self->tick && is_idle(self)) {
        self->tick += idle_skip(&self->life.device, &self->boards, tick - self->tick);
    }
}

void machine_run(struct machine *self, uint64_t tick)
{
    skip_idle(self, tick);
    for (uint64_t due = due_inside(self); due <= tick; due = due_inside(self)) {
        self->tick = self->tick < due ? due : self->tick;
        work(self);
        if (!self->life.in_dfu && due == due_inside(self)) {
            break; /* it waits for the caller, such as a UART that is not read */
        }
    }
    self->tick = tick;
    work(self);
}

uint64_t machine_origin(const struct machine *self)
{
    return self->life.device.origin;
}

/* What the controller has just sent arrives, and is answered. */
static void deliver(struct machine *self)
{
    if (!self->life.in_dfu) {
        (void)boards_deliver(&self->boards, self->tick, &self->life.device);
    }
}

/* USB ---------------------------------------------------------------------------------------------------------- */

bool machine_attached(const struct machine *self)
{
    return self->powered && self->life.usb.attached;
}

uint32_t machine_generation(const struct machine *self)
{
    return self->generation;
}

bool machine_configured(const struct machine *self)
{
    return machine_attached(self) && self->life.usb.configured;
}

void machine_plug(struct machine *self, bool in)
{
    if (!in && machine_attached(self)) {
        pw_usb_unplugged(&self->life.usb);
    }
    if (!in) {
        self->life.usb.attached = false;
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
        pw_usb_bus_reset(&self->life.usb);
    } else if (what == MACHINE_SUSPEND) {
        pw_usb_suspend(&self->life.usb);
    } else {
        pw_usb_resume(&self->life.usb);
    }
    machine_run(self, self->tick);
}

int machine_control(struct machine *self, const uint8_t setup[8], uint8_t *data)
{
    uint8_t out[PW_USB_CONTROL];
    const struct pw_setup request = {setup[0], setup[1], pw_get16(setup + 2), pw_get16(setup + 4), pw_get16(setup + 6)};
    memcpy(out, data, sizeof out);
    const uint64_t last = self->tick + PATIENCE_TICKS;
    int size = pw_usb_control(&self->life.usb, &request, out, data);
    deliver(self);
    while (size == PW_USB_NAK && self->tick < last) {
        size = pw_usb_control_again(&self->life.usb, data);
        if (size == PW_USB_NAK) {
            machine_run(self, self->tick + 1u);
        }
    }
    return size;
}

int machine_out(struct machine *self, uint8_t endpoint, const uint8_t *packet, size_t size)
{
    const int taken = pw_usb_out(&self->life.usb, endpoint, packet, size);
    deliver(self);
    return taken;
}

int machine_in(struct machine *self, uint8_t endpoint, uint8_t *packet)
{
    return pw_usb_in(&self->life.usb, endpoint, packet, PW_USB_PACKET);
}

/* The UART ----------------------------------------------------------------------------------------------------- */

size_t machine_hear(struct machine *self, const uint8_t *bytes, size_t size)
{
    if (!machine_serves(self)) {
        return size; /* nobody listens */
    }
    const size_t taken = pw_line_receive(&self->lines[UART], &self->life.device, bytes, size);
    deliver(self);
    pw_line_poll(&self->lines[UART], &self->life.device);
    return taken;
}

size_t machine_say(struct machine *self, uint8_t *bytes, size_t room)
{
    return machine_serves(self) ? pw_line_send(&self->lines[UART], &self->life.device, bytes, room) : 0u;
}

void machine_break(struct machine *self)
{
    if (machine_serves(self)) {
        pw_line_hang_up(&self->lines[UART], &self->life.device);
    }
}

/* For the bench ------------------------------------------------------------------------------------------------ */

bool machine_words(const struct machine *self, uint64_t first, size_t periods, uint32_t *words)
{
    const bool played = machine_serves(self) && first + periods <= self->boards.period + 1u;
    return played && plays_read(&self->plays, first, periods, words);
}

bool machine_fault(struct machine *self, const struct machine_fault *fault)
{
    return faults_add(&self->faults, fault, self->tick);
}
