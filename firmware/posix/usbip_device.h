/* What USB/IP says of the device before a client attaches it, and whether there is one. */
#ifndef USBIP_DEVICE_H
#define USBIP_DEVICE_H

#include "usb.h"

#define USBIP_BUS_ID 32u
#define USBIP_DEVICE 312u
#define USBIP_INTERFACES 8u /* at most */

/* The record of a device, USBIP_DEVICE bytes. */
void usbip_put_device(const struct pw_usb *usb, const char *bus_id, uint8_t *to);
/* The classes of its interfaces; returns how many bytes. */
size_t usbip_put_interfaces(const struct pw_usb *usb, uint8_t *to);
/* How an attached device is about to leave the bus; PW_STAY if it is not. */
enum pw_leave usbip_leaves(const struct pw_usb *usb);

#endif
