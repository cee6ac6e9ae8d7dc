/* The USB door of this port: TinyUSB moves packets, core/usb.h says what they mean. */
#ifndef TINYUSB_PORT_H
#define TINYUSB_PORT_H

#include "usb.h"

/* `usb` has been begun; `step` lets the device go on while a request waits for the chain. */
void tinyusb_begin(struct pw_usb *usb, void (*step)(void));
/* Offer again what was answered with NAK; after each step of the device. */
void tinyusb_poll(void);

#endif
