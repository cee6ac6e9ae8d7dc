/* The device's record in USB/IP: put together from its descriptors, so that it holds in DFU mode too. */
#include "usbip_device.h"

#include <string.h>

#include "dfu.h"
#include "usbip_urbs.h"

enum { FULL_SPEED = 2, HIGH_SPEED = 3 };
#define INTERFACE 4u

static size_t descriptor(const struct pw_usb *usb, uint16_t value, uint8_t *bytes)
{
    const struct pw_setup setup = {0x80, 6, value, 0, 0xFFFF};
    const int size = pw_usb_descriptor(usb, &setup, bytes);
    return size < 0 ? 0u : (size_t)size;
}

void usbip_put_device(const struct pw_usb *usb, const char *bus_id, uint8_t *to)
{
    uint8_t device[PW_USB_CONTROL];
    uint8_t configuration[PW_USB_CONTROL];
    static const char path[] = "/sys/devices/phasewire/";
    (void)descriptor(usb, 0x0100, device);
    (void)descriptor(usb, 0x0200, configuration);
    memset(to, 0, USBIP_DEVICE);
    memcpy(to, path, sizeof path - 1u);
    memcpy(to + sizeof path - 1u, bus_id, strlen(bus_id));
    memcpy(to + 256, bus_id, strlen(bus_id));
    usbip_put32(to + 288, 1); /* bus */
    usbip_put32(to + 292, 2); /* device */
    usbip_put32(to + 296, usb->high_speed ? HIGH_SPEED : FULL_SPEED);
    usbip_put16(to + 300, pw_get16(device + 8));
    usbip_put16(to + 302, pw_get16(device + 10));
    usbip_put16(to + 304, pw_get16(device + 12));
    memcpy(to + 306, device + 4, 3);
    to[309] = usb->configured ? 1u : 0u;
    to[310] = device[17];
    to[311] = configuration[4];
}

/* Class, subclass and protocol of each interface. */
size_t usbip_put_interfaces(const struct pw_usb *usb, uint8_t *to)
{
    uint8_t bytes[PW_USB_CONTROL];
    const size_t size = descriptor(usb, 0x0200, bytes);
    size_t count = 0;
    for (size_t at = 0; at < size && count < USBIP_INTERFACES; at += bytes[at]) {
        if (bytes[at + 1u] == INTERFACE) {
            memcpy(to + 4u * count, bytes + at + 5u, 3);
            to[4u * count + 3u] = 0;
            count++;
        }
    }
    return 4u * count;
}

enum pw_leave usbip_leaves(const struct pw_usb *usb)
{
    if (usb->dfu_mode) {
        return usb->dfu->leaving ? PW_LEAVE_RESET : PW_STAY; /* it boots: DFU-015 */
    }
    return usb->device->leaving;
}
