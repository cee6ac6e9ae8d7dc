/* What a board has to provide: the registers behind struct pw_port, and the bytes of its UART. board_stub.c answers for
   a board that is not there, so that this port links; replace it with your own. */
#ifndef BOARD_H
#define BOARD_H

#include "port.h"

/* Ticks of 0.5 us: a 2 MHz timer, extended to 64 bits by its overflow interrupt. */
uint64_t board_ticks(void);
/* Send tokens and END on the first link. False if it has not taken them within 1 ms (CHN-021). */
bool board_link_send(const uint8_t *message, size_t size);
/* A message from the chain, its route header taken off: its channel end and its size, 0 if none has come. */
size_t board_link_receive(uint8_t *channel_end, uint8_t *body, size_t room);
void board_sync_pulse(void);
/* Start all processors of the chain anew (CHN-021), as their reset line does. */
void board_restart_processors(void);
/* Bytes to the boot program of the next processor, which has no number yet (FWU-021). False if it does not take them. */
bool board_boot_send(const uint8_t *bytes, size_t size);
/* Whether it has started what it received: its CRC-32 was right. */
bool board_boot_starts(void);
void board_blink(uint8_t board);
bool board_flash_read(uint32_t address, uint8_t *data, size_t size);
bool board_flash_erase(uint32_t address);
bool board_flash_program(uint32_t address, const uint8_t *data, size_t size);
bool board_flash_busy(void);
/* Bytes of the UART: how many came, how many were taken. */
size_t board_uart_read(uint8_t *bytes, size_t room);
size_t board_uart_write(const uint8_t *bytes, size_t size);
/* What the loader's part of the flash says of this board (FWU-016). */
void board_unique_id(uint8_t unique_id[8]);
void board_wiring(uint16_t wiring[320]);
const char *board_serial_number(void);
bool board_high_speed(void);
/* Off the bus for 10 ms, and back in DFU mode if asked. */
void board_reattach(void);

#endif
