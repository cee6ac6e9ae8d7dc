/* A USB/IP server for one device and one client at a time, by the Linux kernel's
   Documentation/usb/usbip_protocol.rst: `usbip attach -r 127.0.0.1 -b 1-1` makes the device a local one.

   The client's attachment is the cable: it brings a bus reset, and its end takes the voltage away (STA-006). */
#ifndef USBIP_H
#define USBIP_H

#include <poll.h>

#include "usb.h"

#define USBIP_FDS 3

struct usbip;

/* Listens; port 0 picks one, and a bus_id of NULL is "1-1". NULL with errno if it cannot. The device is offered while
   usb->attached: from pw_usb_begin until usbip_leave. So usb has to be begun, or all zero. */
struct usbip *usbip_open(const char *address, uint16_t port, struct pw_usb *usb, const char *bus_id);
int usbip_port(const struct usbip *server);
/* Let packets of blocks take their time on the bus, by the tick that it is. */
void usbip_clock(struct usbip *server, const uint64_t *tick);
/* The tick at which the bus can carry the next of them; PW_NEVER if none waits for that. */
uint64_t usbip_due(const struct usbip *server);
/* What to wait for; returns how many of the USBIP_FDS it wrote. */
int usbip_fds(const struct usbip *server, struct pollfd *fds);
/* Accept, read commands, carry out what can be carried out now, write answers. Call it after poll(). */
void usbip_serve(struct usbip *server);
/* The same without looking for new commands: cheaper. Call it after each step of the device. */
void usbip_work(struct usbip *server);
/* Whether more could be done at once, without waiting for the device or for the client. */
bool usbip_wants_step(const struct usbip *server);
/* The device leaves the bus: the client's connection ends. Call it before pw_usb_begin begins another life. */
void usbip_leave(struct usbip *server);
void usbip_close(struct usbip *server);

#endif
