/* The controller's firmware on a Cortex-M33: one loop, no operating system. */
#include "board.h"
#include "life.h"
#include "tinyusb.h"

#include <string.h>

#define UART 1u /* line 0 is CDC-ACM */
#define CHUNK 64u

static struct pw_line lines[2];
static uint16_t wiring[PW_CHANNELS];
static struct pw_life life;

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
    return pw_boot_program(&port, &life.boot, processor, send_program, NULL) && board_boot_starts();
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

/* In code, not as an initializer, so that the device takes no room among the data in flash. */
static void prepare(void)
{
    static const struct pw_about about = {.product = 1, .product_name = "phasewire reference", .wiring = wiring,
                                          .columns = 20, .rows = 16, .pitch_um = 10300};
    board_wiring(wiring);
    life.port = &port;
    life.about = about;
    board_unique_id(life.about.unique_id);
    life.about.serial_number = board_serial_number();
    life.lines[0] = &lines[0];
    life.lines[UART] = &lines[UART];
    life.line_count = 2;
}

static void attach(void)
{
    board_reattach();
    pw_life_attach(&life, board_high_speed());
}

static void hear_the_chain(void)
{
    uint8_t body[PW_MESSAGE];
    uint8_t channel_end;
    const size_t size = board_link_receive(&channel_end, body, sizeof body);
    if (size != 0u) {
        pw_device_chain(&life.device, channel_end, body, size);
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
    came_at += pw_line_receive(&lines[UART], &life.device, came + came_at, came_size - came_at);
    if (going_at == going_size) {
        going_size = pw_line_send(&lines[UART], &life.device, going, sizeof going);
        going_at = 0;
    }
    going_at += board_uart_write(going + going_at, going_size - going_at);
}

static void step(void)
{
    pw_device_poll(&life.device);
    hear_the_chain();
    pw_line_poll(&lines[0], &life.device);
    pw_line_poll(&lines[1], &life.device);
    move_the_uart();
}

int main(void)
{
    prepare();
    (void)pw_life_begin(&life, PW_STAY);
    tinyusb_begin(&life.usb, step);
    for (;;) {
        if (!life.usb.attached && (life.in_dfu || pw_device_serving(&life.device))) {
            attach(); /* not before the chain is complete: TIM-002 */
        }
        if (life.usb.attached) {
            tinyusb_poll();
        }
        if (life.in_dfu) {
            pw_dfu_poll(&life.dfu);
            if (pw_dfu_leaves(&life.dfu)) {
                (void)pw_life_begin(&life, PW_STAY);
            }
            continue;
        }
        step();
        pw_life_confirm(&life);
        const enum pw_leave how = pw_device_leaving(&life.device);
        if (how != PW_STAY && pw_line_idle(&lines[0]) && pw_line_idle(&lines[1])) {
            (void)pw_life_begin(&life, how);
        }
    }
}
