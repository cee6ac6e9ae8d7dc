/* A device as a whole: controller, chain, flash, doors and recording, and its life from power-up to power-down. Time is
   the variable `tick`, and what is due is done at its own tick in order: so a busy computer changes no result. */
#ifndef MACHINE_H
#define MACHINE_H

#include "chain.h"
#include "flash.h"
#include "life.h"
#include "outputs.h"
#include "serial.h"
#include "usbip.h"

#define MACHINE_LINES (PW_LINES - 1u) /* line 0 is that of USB */
#define MACHINE_FDS (MACHINE_LINES + USBIP_FDS)

enum machine_mode { MACHINE_OFF, MACHINE_RUNS, MACHINE_UPDATES };

struct machine {
    /* What a port fills in before power-up. */
    struct flash flash;
    struct outputs outputs;
    struct serial lines[MACHINE_LINES];
    uint32_t line_count;
    struct usbip *usbip; /* NULL: no USB */
    const char *serial_number;
    bool full_speed;
    /* Time. */
    uint64_t tick;
    bool recording;    /* since the first period 0 */
    uint64_t recorded; /* the tick up to which the outputs were */
    /* What it is doing. */
    enum machine_mode mode;
    enum pw_leave next; /* what the device asked for: how it comes back */
    uint64_t back_at;
    bool leaving;
    uint64_t leave_by; /* even if a line is not idle */
    bool dead;         /* nothing boots */
    /* The device. */
    uint16_t wiring[PW_CHANNELS];
    struct pw_port port;
    struct chain chain;
    struct pw_line usb_line;
    struct pw_life life;
};

/* Fills in the rest. Before it: flash, outputs, lines, usbip, serial_number and full_speed, all else zero. */
void machine_begin(struct machine *self);
/* The voltage comes. */
void machine_power_up(struct machine *self);
/* The voltage goes, and comes back: what is in RAM is lost. */
void machine_power_cut(struct machine *self);
/* Do all that is due up to a tick. */
void machine_advance(struct machine *self, uint64_t tick);
/* Move what has arrived, and what is to be sent, through the doors at the present tick. */
void machine_serve(struct machine *self);
/* The next tick at which something is due that the outside may see. */
uint64_t machine_due(const struct machine *self);
/* What to wait for; returns how many of MACHINE_FDS it wrote. */
uint32_t machine_poll(const struct machine *self, struct pollfd *fds);
/* Bring the recording up to the present tick. */
void machine_record(struct machine *self);

#endif
