/* The life of a device, from power-up over restarts and upgrades to the next one. A port moves time and bytes, and says
   how long the device stays off the bus. */
#ifndef PW_LIFE_H
#define PW_LIFE_H

#include "dfu.h"
#include "ser.h"
#include "usb.h"

struct pw_life {
    /* What a port fills in before power-up. */
    const struct pw_port *port;
    struct pw_about about; /* but for firmware, bank and faults, which the loader knows */
    struct pw_line *lines[PW_LINES]; /* line 0 is that of USB, the others are UARTs */
    uint32_t line_count;
    /* The rest. */
    bool in_dfu;
    bool confirmed;
    uint64_t confirm_at; /* tick */
    struct pw_boot boot;
    struct pw_device device;
    struct pw_usb usb;
    struct pw_dfu dfu;
};

/* The unique number of a device, from its serial number, which no other device has (USB-001). */
void pw_unique_id(uint8_t unique_id[8], const char *serial_number);
/* Power-up (PW_STAY), or what follows when the device has left: off the bus, it begins anew or in DFU mode. The loader
   may wait for the flash. False: the flash holds nothing that boots; the device then begins as the program that runs. */
bool pw_life_begin(struct pw_life *self, enum pw_leave how);
/* It comes to the bus. In run-time mode not before the chain is complete (TIM-002). */
void pw_life_attach(struct pw_life *self, bool high_speed);
/* Confirms the image once it has come up and somebody has spoken with it (FWU-020). Call it now and then. */
void pw_life_confirm(struct pw_life *self);

#endif
