/* A board that is not there: it links, keeps time by its calls, and has an empty flash. Replace it with your own. */
#include "board.h"

#include <string.h>

#define CALL_TICKS 1u

uint64_t board_ticks(void)
{
    static uint64_t ticks;
    ticks += CALL_TICKS;
    return ticks;
}

bool board_link_send(const uint8_t *message, size_t size)
{
    (void)message;
    return size == 0u; /* no link takes anything */
}

size_t board_link_receive(uint8_t *channel_end, uint8_t *body, size_t room)
{
    (void)channel_end;
    (void)body;
    (void)room;
    return 0;
}

void board_sync_pulse(void)
{
}

void board_restart_processors(void)
{
}

bool board_boot_send(const uint8_t *bytes, size_t size)
{
    (void)bytes;
    return size == 0u; /* there is no processor */
}

bool board_boot_starts(void)
{
    return false;
}

void board_blink(uint8_t board)
{
    (void)board;
}

bool board_flash_read(uint32_t address, uint8_t *data, size_t size)
{
    (void)address;
    memset(data, 0xFF, size);
    return true;
}

bool board_flash_erase(uint32_t address)
{
    (void)address;
    return false;
}

bool board_flash_program(uint32_t address, const uint8_t *data, size_t size)
{
    (void)address;
    (void)data;
    return size == 0u;
}

bool board_flash_busy(void)
{
    return false;
}

size_t board_uart_read(uint8_t *bytes, size_t room)
{
    (void)bytes;
    (void)room;
    return 0;
}

size_t board_uart_write(const uint8_t *bytes, size_t size)
{
    (void)bytes;
    return size;
}

void board_unique_id(uint8_t unique_id[8])
{
    memset(unique_id, 0, 8);
}

void board_wiring(uint16_t wiring[320])
{
    for (uint16_t i = 0; i < 320u; i++) {
        wiring[i] = i;
    }
}

const char *board_serial_number(void)
{
    return "M33-0001";
}

bool board_high_speed(void)
{
    return true;
}

void board_reattach(void)
{
}
