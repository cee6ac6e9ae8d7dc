/* The reference device as a shared library: its time is the caller's, so that a test runs as fast as it can and gives
   the same answers on any computer. Whoever ports the core can judge it in this way before there is a board. */
#ifndef LIBRARY_H
#define LIBRARY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct machine;

/* A device with a fresh factory image, without power. `wiring` has 320 channels (REQ-004). NULL if there is no memory. */
struct machine *machine_new(const uint16_t *wiring, const char *serial_number, bool high_speed);
void machine_free(struct machine *self);
/* Power comes or goes; flash keeps what it has. */
void machine_power(struct machine *self, bool on);
/* Ticks of 0.5 us since it was made; what is due next; let time pass. */
uint64_t machine_now(const struct machine *self);
uint64_t machine_due(const struct machine *self);
void machine_run(struct machine *self, uint64_t tick);
/* Whether the device counts periods, and the tick at which period 0 began. */
bool machine_serves(const struct machine *self);
uint64_t machine_origin(const struct machine *self);

/* USB: whether the device is on the bus, and how often it has come. A cable that is not plugged in has no voltage. */
bool machine_attached(const struct machine *self);
uint32_t machine_generation(const struct machine *self);
void machine_plug(struct machine *self, bool in);
enum { MACHINE_RESET, MACHINE_SUSPEND, MACHINE_RESUME };
void machine_bus(struct machine *self, int what);
/* Bytes of the answer, or -2 for STALL. `data` has room for 2048 bytes: what goes out, then what comes in. */
int machine_control(struct machine *self, const uint8_t setup[8], uint8_t *data);
/* Packets: 0 or the bytes that came, -1 for NAK, -2 for STALL. */
int machine_out(struct machine *self, uint8_t endpoint, const uint8_t *packet, size_t size);
int machine_in(struct machine *self, uint8_t endpoint, uint8_t *packet);
bool machine_configured(const struct machine *self);

/* The UART: bytes that were taken, bytes that came, a break. */
size_t machine_hear(struct machine *self, const uint8_t *bytes, size_t size);
size_t machine_say(struct machine *self, uint8_t *bytes, size_t room);
void machine_break(struct machine *self);

/* What the ports played: 50 ticks x 10 words of each period from `first` on. False if it was not kept. */
bool machine_words(const struct machine *self, uint64_t first, size_t periods, uint32_t *words);
/* A fault of one processor (SAF-008) appears or goes: enum pw_fault of core/codes.h. */
void machine_fault(struct machine *self, uint8_t processor, uint16_t faults);

#endif
