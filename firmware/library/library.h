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

/* What can go wrong: the faults of docs/reference/faults.md, but for those of transducers, outputs and USB. */
enum machine_trouble {
    MACHINE_LOST_TOKEN, MACHINE_DOUBLED_TOKEN, MACHINE_FLIPPED_BIT, /* what: channel end; where: token; value: bit */
    MACHINE_SLOW_LINK,       /* to a processor and back; value: core cycles of a token */
    MACHINE_DEAD,
    MACHINE_SLOW,            /* value: how many times as long it rasterises */
    MACHINE_CLOCK,           /* value: billionths by which it runs fast. The wave does not move, only the count. */
    MACHINE_NO_SYNC,
    MACHINE_CELSIUS,         /* value */
    MACHINE_MILLIVOLTS,      /* value */
    MACHINE_STUCK_BIT,       /* where: address; what: bit; value: 0 or 1 */
    MACHINE_FAILING_SECTOR,  /* where: an address in it */
    MACHINE_FAILING_PAGE,
    MACHINE_WRITE_PROTECTED,
    MACHINE_CUT_IN_WRITE     /* where: bytes that are still written; value: periods without power, -1 for good */
};
struct machine_fault {
    uint32_t kind;       /* enum machine_trouble */
    uint32_t places;     /* processors at which it is, as bits */
    uint64_t begin, end; /* ticks of machine_now */
    uint32_t times;      /* that it strikes: of messages and power cuts; 1 for others */
    int32_t what, where, value;
};
/* False if there are too many at once. What is wrong stays so over RESET and power-up. */
bool machine_fault(struct machine *self, const struct machine_fault *fault);

#endif
