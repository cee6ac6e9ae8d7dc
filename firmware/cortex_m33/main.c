/* The controller's firmware on a Cortex-M33: one loop, no operating system. */
#include "board.h"
#include "dfu.h"
#include "fwu.h"
#include "ser.h"
#include "tinyusb.h"

#include <string.h>

#define UART 1u /* line 0 is CDC-ACM */
#define CHUNK 64u

static struct pw_device device;
static struct pw_usb usb;
static struct pw_line lines[2];
static struct pw_dfu dfu;
static struct pw_boot running;
static struct pw_about about;
static uint16_t wiring[PW_CHANNELS];
static bool in_dfu, confirmed;

static uint64_t now(void *self)
{
    (void)self;
    return board_ticks();
}

static bool chain(void *self, const uint8_t *message, size_t size)
{
    (void)self;
    return board_link_send(message, size);
}

static void sync_line(void *self)
{
    (void)self;
    board_sync_pulse();
}

static void identify(void *self, uint8_t which)
{
    (void)self;
    board_blink(which);
}

static bool flash_read(void *self, uint32_t address, uint8_t *bytes, size_t size)
{
    (void)self;
    return board_flash_read(address, bytes, size);
}

static bool flash_erase(void *self, uint32_t address)
{
    (void)self;
    return board_flash_erase(address);
}

static bool flash_program(void *self, uint32_t address, const uint8_t *bytes, size_t size)
{
    (void)self;
    return board_flash_program(address, bytes, size);
}

static bool flash_busy(void *self)
{
    (void)self;
    return board_flash_busy();
}

static void restart_processors(void *self)
{
    (void)self;
    board_restart_processors();
}

static bool send_program(void *context, const uint8_t *bytes, size_t size)
{
    (void)context;
    return board_boot_send(bytes, size);
}

static const struct pw_port port;

static bool program(void *self, uint8_t processor)
{
    (void)self;
    return pw_boot_program(&port, &running, processor, send_program, NULL) && board_boot_starts();
}

static const struct pw_port port = {
    .now = now,
    .chain = chain,
    .sync = sync_line,
    .identify = identify,
    .flash_read = flash_read,
    .flash_erase = flash_erase,
    .flash_program = flash_program,
    .flash_busy = flash_busy,
    .restart_processors = restart_processors,
    .program = program,
};

/* Power-up, RESET and the way out of DFU mode. */
static void start(void)
{
    (void)pw_boot(&port, &running);
    board_wiring(wiring);
    board_unique_id(about.unique_id);
    memcpy(about.firmware, running.firmware, sizeof about.firmware);
    about.bank = running.bank;
    about.faults = running.faults;
    about.product = 1;
    about.product_name = "phasewire reference";
    about.serial_number = board_serial_number();
    about.wiring = wiring;
    about.columns = 20;
    about.rows = 16;
    about.pitch_um = 10300;
    confirmed = false;
    usb.was_configured = false; /* by a host of the life before */
    pw_device_begin(&device, &port, &about);
    pw_line_begin(&lines[0], PW_DOOR_LINE(0u), false);
    pw_line_begin(&lines[1], PW_DOOR_LINE(1u), true);
}

static void attach(void)
{
    board_reattach();
    pw_usb_begin(&usb, &device, in_dfu ? NULL : &lines[0], in_dfu ? &dfu : NULL, &about, board_high_speed(), in_dfu);
}

static void hear_the_chain(void)
{
    uint8_t body[PW_MESSAGE];
    uint8_t channel_end;
    const size_t size = board_link_receive(&channel_end, body, sizeof body);
    if (size != 0u) {
        pw_device_chain(&device, channel_end, body, size);
    }
}

static void move_the_uart(void)
{
    static uint8_t came[CHUNK], going[CHUNK];
    static size_t came_size, came_at, going_size, going_at;
    if (came_at == came_size) {
        came_size = board_uart_read(came, sizeof came);
        came_at = 0;
    }
    came_at += pw_line_receive(&lines[UART], &device, came + came_at, came_size - came_at);
    if (going_at == going_size) {
        going_size = pw_line_send(&lines[UART], &device, going, sizeof going);
        going_at = 0;
    }
    going_at += board_uart_write(going + going_at, going_size - going_at);
}

static void step(void)
{
    pw_device_poll(&device);
    hear_the_chain();
    pw_line_poll(&lines[0], &device);
    pw_line_poll(&lines[1], &device);
    move_the_uart();
}

/* FWU-020: an image is good once it has come up and somebody has spoken with it. */
static void confirm(void)
{
    const bool spoken = usb.was_configured || lines[0].answered || lines[1].answered;
    if (!confirmed && spoken && device.numbered == PW_PROCESSORS) {
        confirmed = pw_boot_confirm(&port, &running);
    }
}

static void leave(enum pw_leave how)
{
    if (how == PW_LEAVE_DFU) {
        in_dfu = true;
        pw_dfu_begin(&dfu, &port, &running);
    } else {
        if (how == PW_LEAVE_REVERT) {
            pw_boot_revert(&port);
        }
        start();
    }
    usb.attached = false;
}

int main(void)
{
    start();
    tinyusb_begin(&usb, step);
    for (;;) {
        if (!usb.attached && (in_dfu || pw_device_serving(&device))) {
            attach(); /* not before the chain is complete: TIM-002 */
        }
        if (usb.attached) {
            tinyusb_poll();
        }
        if (in_dfu) {
            pw_dfu_poll(&dfu);
            if (pw_dfu_leaves(&dfu)) {
                in_dfu = false;
                start();
                usb.attached = false;
            }
            continue;
        }
        step();
        confirm();
        const enum pw_leave how = pw_device_leaving(&device);
        if (how != PW_STAY && pw_line_idle(&lines[0]) && pw_line_idle(&lines[1])) {
            leave(how);
        }
    }
}
