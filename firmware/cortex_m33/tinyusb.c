/* TinyUSB as the USB door. It answers the standard requests itself from the descriptors of the core; vendor, class and
   Microsoft requests, and every packet, go to core/usb.h. One transfer is one packet, so that NAK means what BLK-009
   says: the endpoint is armed again when the core has taken the packet before. */
#include "tinyusb.h"

#ifdef PW_TINYUSB
#include "device/usbd_pvt.h"
#include "tusb.h"
#else
#include "tusb_stub.h"
#endif

#include <string.h>

#define PORT 0u
#define DIRECTION_IN 0x80u
#define DESCRIPTOR_ENDPOINT 5u
#define GET_DESCRIPTOR 6u

/* What TinyUSB asks for by name. */
const uint8_t *tud_descriptor_device_cb(void);
const uint8_t *tud_descriptor_configuration_cb(uint8_t index);
const uint8_t *tud_descriptor_bos_cb(void);
const uint8_t *tud_descriptor_device_qualifier_cb(void);
const uint8_t *tud_descriptor_other_speed_configuration_cb(uint8_t index);
const uint16_t *tud_descriptor_string_cb(uint8_t index, uint16_t language);
const usbd_class_driver_t *usbd_app_driver_get_cb(uint8_t *count);
bool tud_vendor_control_xfer_cb(uint8_t port, uint8_t stage, const tusb_control_request_t *request);
void tud_mount_cb(void);
void tud_umount_cb(void);
void tud_suspend_cb(bool remote_wakeup);
void tud_resume_cb(void);

struct endpoint {
    uint8_t address;
    uint16_t waits; /* bytes of a packet out that the core has not taken */
    bool has_packet;
    uint8_t packet[PW_USB_PACKET];
};

static struct pw_usb *core;
static void (*step_device)(void);
static uint8_t data[PW_USB_CONTROL];
static struct endpoint outs[] = {{.address = PW_USB_BLOCKS}, {.address = PW_USB_TEXT_OUT}};
static struct endpoint ins[] = {{.address = PW_USB_RECORDS}, {.address = PW_USB_TEXT_IN}, {.address = PW_USB_NOTICES}};
#define COUNT(list) (sizeof(list) / sizeof((list)[0]))

void tinyusb_begin(struct pw_usb *usb, void (*step)(void))
{
    core = usb;
    step_device = step;
}

/* Descriptors -------------------------------------------------------------------------------------------------- */

static const uint8_t *descriptor(uint8_t type, uint8_t index, uint16_t language)
{
    const struct pw_setup setup = {DIRECTION_IN, GET_DESCRIPTOR, (uint16_t)((type << 8) | index), language,
                                   PW_USB_CONTROL};
    return pw_usb_descriptor(core, &setup, data) > 0 ? data : NULL;
}

const uint8_t *tud_descriptor_device_cb(void)
{
    return descriptor(0x01, 0, 0);
}

const uint8_t *tud_descriptor_configuration_cb(uint8_t index)
{
    return descriptor(0x02, index, 0);
}

const uint8_t *tud_descriptor_device_qualifier_cb(void)
{
    return descriptor(0x06, 0, 0);
}

const uint8_t *tud_descriptor_other_speed_configuration_cb(uint8_t index)
{
    return descriptor(0x07, index, 0);
}

const uint8_t *tud_descriptor_bos_cb(void)
{
    return descriptor(0x0F, 0, 0);
}

const uint16_t *tud_descriptor_string_cb(uint8_t index, uint16_t language)
{
    static uint16_t string[128]; /* aligned, as TinyUSB wants it */
    const uint8_t *bytes = descriptor(0x03, index, language);
    if (bytes == NULL) {
        return NULL;
    }
    memcpy(string, bytes, bytes[0]);
    return string;
}

/* Requests ----------------------------------------------------------------------------------------------------- */

static bool carry_out(uint8_t port, const tusb_control_request_t *request)
{
    const struct pw_setup setup = {request->bmRequestType, request->bRequest, request->wValue, request->wIndex,
                                   request->wLength};
    int size = pw_usb_control(core, &setup, data, data);
    while (size == PW_USB_NAK) { /* PULSES waits for the chain, some milliseconds at most */
        step_device();
        size = pw_usb_control_again(core, data);
    }
    if (size < 0) {
        return false; /* TinyUSB answers STALL */
    }
    const bool in = (request->bmRequestType & DIRECTION_IN) != 0u;
    return in || request->wLength == 0u ? tud_control_xfer(port, request, data, (uint16_t)size) : true;
}

static bool control(uint8_t port, uint8_t stage, const tusb_control_request_t *request)
{
    const bool data_out = (request->bmRequestType & DIRECTION_IN) == 0u && request->wLength != 0u;
    if (stage == CONTROL_STAGE_SETUP) {
        if (!data_out) {
            return carry_out(port, request);
        }
        return request->wLength <= sizeof data && tud_control_xfer(port, request, data, request->wLength);
    }
    return stage == CONTROL_STAGE_DATA && data_out ? carry_out(port, request) : true;
}

bool tud_vendor_control_xfer_cb(uint8_t port, uint8_t stage, const tusb_control_request_t *request)
{
    return control(port, stage, request);
}

/* The bus ------------------------------------------------------------------------------------------------------ */

static void reset(uint8_t port)
{
    (void)port;
    for (size_t i = 0; i < COUNT(outs); i++) {
        outs[i].has_packet = false;
    }
    pw_usb_bus_reset(core);
}

void tud_mount_cb(void)
{
    const struct pw_setup set_configuration = {0, 9, 1, 0, 0};
    (void)pw_usb_control(core, &set_configuration, data, data);
}

void tud_umount_cb(void)
{
    pw_usb_unplugged(core);
}

void tud_suspend_cb(bool remote_wakeup)
{
    (void)remote_wakeup; /* never offered: USB-021 */
    pw_usb_suspend(core);
}

void tud_resume_cb(void)
{
    pw_usb_resume(core);
}

/* Packets ------------------------------------------------------------------------------------------------------ */

static struct endpoint *endpoint_at(uint8_t address)
{
    for (size_t i = 0; i < COUNT(outs); i++) {
        if (outs[i].address == address) {
            return &outs[i];
        }
    }
    return NULL;
}

static bool listen(struct endpoint *out)
{
    return usbd_edpt_xfer(PORT, out->address, out->packet, (uint16_t)pw_usb_packet(core));
}

static void offer(struct endpoint *out)
{
    if (out->has_packet && pw_usb_out(core, out->address, out->packet, out->waits) != PW_USB_NAK) {
        out->has_packet = false;
        (void)listen(out);
    }
}

static void fetch(struct endpoint *in)
{
    if (usbd_edpt_busy(PORT, in->address)) {
        return;
    }
    const int size = pw_usb_in(core, in->address, in->packet, sizeof in->packet);
    if (size >= 0) {
        (void)usbd_edpt_xfer(PORT, in->address, in->packet, (uint16_t)size);
    }
}

void tinyusb_poll(void)
{
    pw_usb_poll(core);
    for (size_t i = 0; i < COUNT(outs); i++) {
        offer(&outs[i]);
    }
    for (size_t i = 0; i < COUNT(ins); i++) {
        fetch(&ins[i]);
    }
    tud_task();
}

static bool transferred(uint8_t port, uint8_t address, xfer_result_t result, uint32_t bytes)
{
    (void)port;
    struct endpoint *out = endpoint_at(address);
    if (out != NULL && result == XFER_RESULT_SUCCESS) {
        out->waits = (uint16_t)bytes;
        out->has_packet = true;
        offer(out);
    }
    return true;
}

static uint16_t open_interface(uint8_t port, const tusb_desc_interface_t *interface, uint16_t most)
{
    const uint8_t *at = (const uint8_t *)interface;
    uint16_t used = at[0];
    while (used < most && at[used + 1u] != interface->bDescriptorType) {
        if (at[used + 1u] == DESCRIPTOR_ENDPOINT) {
            const uint8_t address = at[used + 2u];
            (void)usbd_edpt_open(port, (const tusb_desc_endpoint_t *)(at + used));
            if ((address & DIRECTION_IN) == 0u && endpoint_at(address) != NULL) {
                (void)listen(endpoint_at(address));
            }
        }
        used = (uint16_t)(used + at[used]);
    }
    return used;
}

static void nothing(void)
{
}

const usbd_class_driver_t *usbd_app_driver_get_cb(uint8_t *count)
{
    static const usbd_class_driver_t driver = {
        .name = "phasewire",
        .init = nothing,
        .reset = reset,
        .open = open_interface,
        .control_xfer_cb = control,
        .xfer_cb = transferred,
    };
    *count = 1;
    return &driver;
}
