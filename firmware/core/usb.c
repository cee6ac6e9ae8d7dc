/* Chapter USB: what happens to the bus, and the requests of the control endpoint. */
#include "usb.h"

#include "dfu.h"
#include "ser.h"

#include <string.h>

/* Request types: direction, kind and recipient. */
enum request_type {
    TO_DEVICE = 0x00, TO_INTERFACE = 0x01, TO_ENDPOINT = 0x02, CLASS_OUT = 0x21,
    OF_DEVICE = 0x80, OF_INTERFACE = 0x81, OF_ENDPOINT = 0x82, CLASS_IN = 0xA1, MICROSOFT = 0xC0
};
/* USB-014 */
enum standard_request {
    GET_STATUS = 0, CLEAR_FEATURE = 1, SET_FEATURE = 3, SET_ADDRESS = 5, GET_DESCRIPTOR = 6, GET_CONFIGURATION = 8,
    SET_CONFIGURATION = 9, GET_INTERFACE = 10, SET_INTERFACE = 11
};
enum feature { ENDPOINT_HALT = 0, TEST_MODE = 2 };
#define LAST_TEST 5u /* Test_Force_Enable; the others are for hubs or vendors */
#define LAST_ADDRESS 127u
/* USB-012 */
#define MICROSOFT_REQUEST 0x20u
#define MICROSOFT_INDEX 7u
/* USB-023 */
enum console_request { SET_LINE_CODING = 0x20, GET_LINE_CODING = 0x21, SET_CONTROL_LINE_STATE = 0x22 };
#define DTR 1u
/* USB-005 */
enum interface { BLOCKS = 0, CONSOLE = 1, TEXT = 2, UPDATE = 3, INTERFACES = 4 };
#define DFU_INTERFACES 1u
#define DFU_STATUS_BYTES 6u /* DFU-007 */

static const uint8_t FIRST_CODING[PW_USB_LINE_CODING] = {0x00, 0xC2, 0x01, 0x00, 0, 0, 8}; /* 115 200 baud, 8N1 */

/* Resets ------------------------------------------------------------------------------------------------------- */

static void hang_up(struct pw_usb *usb)
{
    if (usb->line != NULL) {
        usb->line->may_text = false;
        pw_line_finish(usb->line, usb->device, usb->text + usb->text_at, usb->text_size);
    }
    usb->text_size = 0;
    usb->text_owes_empty = false;
    usb->dtr = false;
}

/* Drop the records that wait here, and the one that the device keeps for this door. */
static void drop_records(struct pw_usb *usb)
{
    pw_usb_drop_records(usb);
    pw_device_listen(usb->device, PW_DOOR_USB, false);
    pw_device_listen(usb->device, PW_DOOR_USB, usb->configured);
}

/* What no configuration outlives (USB-026). */
static void forget(struct pw_usb *usb)
{
    usb->halts = 0;
    usb->toggles = UINT8_MAX;
    usb->waits = false;
    if (!usb->dfu_mode) {
        drop_records(usb);
        hang_up(usb);
        memcpy(usb->coding, FIRST_CODING, PW_USB_LINE_CODING);
    }
}

void pw_usb_begin(struct pw_usb *usb, struct pw_device *device, struct pw_line *line, struct pw_dfu *dfu,
                  const struct pw_about *about, bool high_speed, bool dfu_mode)
{
    memset(usb, 0, sizeof *usb);
    usb->device = device;
    usb->line = dfu_mode ? NULL : line;
    usb->dfu = dfu;
    usb->about = about;
    usb->high_speed = high_speed;
    usb->dfu_mode = dfu_mode;
    usb->attached = true;
    forget(usb);
}

void pw_usb_bus_reset(struct pw_usb *usb)
{
    usb->address = 0;
    usb->configured = false;
    usb->suspended = false;
    if (usb->dfu_mode) {
        (void)pw_dfu_bus_reset(usb->dfu);
    } else {
        pw_device_bus(usb->device, PW_EVENT_BUS_RESET);
    }
    forget(usb);
}

void pw_usb_suspend(struct pw_usb *usb)
{
    if (usb->configured && !usb->suspended && !usb->dfu_mode) {
        usb->suspended = true;
        pw_device_bus(usb->device, PW_EVENT_SUSPEND);
    }
}

void pw_usb_resume(struct pw_usb *usb)
{
    if (usb->suspended) {
        usb->suspended = false;
        pw_device_bus(usb->device, PW_EVENT_RESUME);
    }
}

void pw_usb_unplugged(struct pw_usb *usb)
{
    /* STA-006: the events follow each other, and the configuration is gone. */
    pw_usb_suspend(usb);
    pw_usb_resume(usb);
    usb->address = 0;
    usb->configured = false;
    forget(usb);
}

/* Standard requests -------------------------------------------------------------------------------------------- */

static int set_configuration(struct pw_usb *usb, uint8_t value)
{
    usb->configured = value == 1u;
    usb->suspended = false;
    usb->was_configured = usb->was_configured || usb->configured;
    if (!usb->dfu_mode) {
        pw_device_bus(usb->device, PW_EVENT_BUS_RESET);
    } else if (usb->configured) {
        pw_dfu_configured(usb->dfu);
    } else {
        /* In DFU mode nothing depends on it. */
    }
    forget(usb);
    return 0;
}

static int put1(uint8_t *in, bool value)
{
    in[0] = value ? 1u : 0u;
    return 1;
}

static int put_status(uint8_t *in, bool first_bit)
{
    (void)put1(in, first_bit);
    in[1] = 0;
    return 2;
}

/* A request of a device that answers something. */
static int get_of_device(const struct pw_usb *usb, const struct pw_setup *setup, uint8_t *in)
{
    if (setup->request == GET_DESCRIPTOR) {
        return pw_usb_descriptor(usb, setup, in);
    }
    if (setup->value != 0u || setup->index != 0u) {
        return PW_USB_STALLED;
    }
    switch (setup->request) {
    case GET_STATUS:
        return put_status(in, true); /* self-powered */
    case GET_CONFIGURATION:
        return put1(in, usb->configured);
    default:
        return PW_USB_STALLED;
    }
}

/* A request to a device; none of them has data. */
static int set_of_device(struct pw_usb *usb, const struct pw_setup *setup)
{
    const uint8_t test = (uint8_t)(setup->index >> 8);
    if (setup->length != 0u) {
        return PW_USB_STALLED;
    }
    const bool tests = usb->high_speed && setup->request == SET_FEATURE && setup->value == TEST_MODE;
    if (tests && (setup->index & 0xFFu) == 0u && test != 0u && test <= LAST_TEST) {
        usb->test_mode = test;
        return 0;
    }
    if (setup->index != 0u) {
        return PW_USB_STALLED;
    }
    if (setup->request == SET_ADDRESS && setup->value <= LAST_ADDRESS) {
        usb->address = (uint8_t)setup->value;
        return 0;
    }
    if (setup->request == SET_CONFIGURATION && setup->value <= 1u) {
        return set_configuration(usb, (uint8_t)setup->value);
    }
    return PW_USB_STALLED;
}

static uint8_t endpoints_of(uint16_t interface)
{
    switch (interface) {
    case BLOCKS:
        return PW_USB_BIT_BLOCKS | PW_USB_BIT_RECORDS;
    case CONSOLE:
        return PW_USB_BIT_NOTICES;
    case TEXT:
        return PW_USB_BIT_TEXT_OUT | PW_USB_BIT_TEXT_IN;
    default:
        return 0;
    }
}

static int set_interface(struct pw_usb *usb, uint16_t interface)
{
    const uint8_t endpoints = usb->dfu_mode ? 0u : endpoints_of(interface);
    usb->halts &= (uint8_t)~endpoints;
    usb->toggles |= endpoints;
    if (interface == BLOCKS && !usb->dfu_mode) {
        pw_device_bus(usb->device, PW_EVENT_BUS_RESET); /* USB-016 */
        drop_records(usb);
    }
    return 0;
}

static int of_interface(struct pw_usb *usb, const struct pw_setup *setup, uint8_t *in)
{
    const uint16_t interfaces = usb->dfu_mode ? DFU_INTERFACES : INTERFACES;
    if (!usb->configured || setup->index >= interfaces || setup->value != 0u) {
        return PW_USB_STALLED;
    }
    if (setup->type == TO_INTERFACE) {
        const bool known = setup->request == SET_INTERFACE && setup->length == 0u;
        return known ? set_interface(usb, setup->index) : PW_USB_STALLED;
    }
    switch (setup->request) {
    case GET_STATUS:
        return put_status(in, false);
    case GET_INTERFACE:
        return put1(in, false); /* alternate setting 0 */
    default:
        return PW_USB_STALLED;
    }
}

/* The control endpoint is never halted: there is nothing to clear, and it cannot be set. */
static int of_control_endpoint(const struct pw_setup *setup, uint8_t *in)
{
    if (setup->type == OF_ENDPOINT && setup->request == GET_STATUS) {
        return put_status(in, false);
    }
    const bool clears = setup->type == TO_ENDPOINT && setup->request == CLEAR_FEATURE && setup->length == 0u;
    return clears ? 0 : PW_USB_STALLED;
}

static int of_endpoint(struct pw_usb *usb, const struct pw_setup *setup, uint8_t *in)
{
    if (setup->value != ENDPOINT_HALT) { /* 0, which GET_STATUS has too */
        return PW_USB_STALLED;
    }
    if (setup->index == 0u || setup->index == 0x80u) {
        return of_control_endpoint(setup, in);
    }
    const uint8_t bit = setup->index <= UINT8_MAX ? pw_usb_bit(usb, (uint8_t)setup->index) : 0u;
    if (!usb->configured || bit == 0u) {
        return PW_USB_STALLED;
    }
    if (setup->type == OF_ENDPOINT) {
        return setup->request == GET_STATUS ? put_status(in, (usb->halts & bit) != 0u) : PW_USB_STALLED;
    }
    if (setup->request == SET_FEATURE && setup->length == 0u) {
        usb->halts |= bit;
        return 0;
    }
    if (setup->request == CLEAR_FEATURE && setup->length == 0u) {
        usb->halts &= (uint8_t)~bit;
        usb->toggles |= bit;
        if (bit == PW_USB_BIT_BLOCKS) {
            usb->arrived = 0; /* USB-015 */
        }
        return 0;
    }
    return PW_USB_STALLED;
}

/* Class requests ----------------------------------------------------------------------------------------------- */

static int of_console(struct pw_usb *usb, const struct pw_setup *setup, const uint8_t *out, uint8_t *in)
{
    const bool to = setup->type == CLASS_OUT;
    if (to && setup->request == SET_CONTROL_LINE_STATE && setup->length == 0u) {
        const bool dtr = (setup->value & DTR) != 0u;
        if (usb->dtr && !dtr) {
            hang_up(usb);
        }
        usb->dtr = dtr;
        if (usb->line != NULL) {
            usb->line->may_text = dtr;
        }
        return 0;
    }
    if (setup->value != 0u) {
        return PW_USB_STALLED;
    }
    if (to && setup->request == SET_LINE_CODING && setup->length == PW_USB_LINE_CODING) {
        memcpy(usb->coding, out, PW_USB_LINE_CODING);
        return 0;
    }
    if (!to && setup->request == GET_LINE_CODING) {
        memcpy(in, usb->coding, PW_USB_LINE_CODING);
        return (int)PW_USB_LINE_CODING;
    }
    return PW_USB_STALLED;
}

/* DFU at run time (USB-024, DFU-006). */
static int of_update(struct pw_usb *usb, const struct pw_setup *setup, uint8_t *in)
{
    const uint8_t state = usb->detaching ? PW_DFU_APP_DETACH : PW_DFU_APP_IDLE;
    if (setup->type == CLASS_IN && setup->value == 0u && setup->request == PW_DFU_GETSTATE) {
        in[0] = state;
        return 1;
    }
    if (setup->type == CLASS_IN && setup->value == 0u && setup->request == PW_DFU_GETSTATUS) {
        memset(in, 0, DFU_STATUS_BYTES);
        in[4] = state;
        return (int)DFU_STATUS_BYTES;
    }
    const bool detach = setup->type == CLASS_OUT && setup->request == PW_DFU_DETACH && setup->length == 0u;
    if (detach && pw_device_detach(usb->device, PW_DOOR_USB)) {
        usb->detaching = true;
        return 0;
    }
    usb->detaching = false; /* appIDLE: what is not known leads there, but calls nothing off */
    return PW_USB_STALLED;
}

static int class_request(struct pw_usb *usb, const struct pw_setup *setup, const uint8_t *out, uint8_t *in)
{
    if (!usb->configured) {
        return PW_USB_STALLED;
    }
    if (usb->dfu_mode) {
        const int answered = setup->index == 0u ? pw_dfu_request(usb->dfu, setup, out, in) : -1;
        return answered < 0 ? PW_USB_STALLED : answered;
    }
    switch (setup->index) {
    case CONSOLE:
        return of_console(usb, setup, out, in);
    case UPDATE:
        return of_update(usb, setup, in);
    default:
        return PW_USB_STALLED;
    }
}

/* Vendor requests ---------------------------------------------------------------------------------------------- */

static int outcome(struct pw_usb *usb, enum pw_answer answer, uint16_t size)
{
    usb->waits = answer == PW_LATER;
    usb->asked = usb->waits;
    if (usb->waits) {
        return PW_USB_NAK;
    }
    return answer == PW_ANSWERED ? (int)size : PW_USB_STALLED;
}

/* Ask the device. It reads what plays for one door at a time: others wait, rather than be stalled. */
static int ask(struct pw_usb *usb, uint8_t *in)
{
    uint16_t size = 0;
    if (usb->device->reading && usb->waiting.type == PW_REQUEST_IN && usb->waiting.request == PW_REQ_PULSES) {
        usb->waits = true;
        usb->asked = false;
        return PW_USB_NAK;
    }
    const struct pw_setup setup = usb->waiting;
    const enum pw_answer answer = pw_device_request(usb->device, PW_DOOR_USB, &setup, in, &size);
    return outcome(usb, answer, size);
}

static int vendor_request(struct pw_usb *usb, const struct pw_setup *setup, uint8_t *in)
{
    if (!usb->configured || usb->dfu_mode) {
        return PW_USB_STALLED;
    }
    usb->waiting = *setup;
    return ask(usb, in);
}

/* All requests ------------------------------------------------------------------------------------------------- */

static int dispatch(struct pw_usb *usb, const struct pw_setup *setup, const uint8_t *out, uint8_t *in)
{
    switch (setup->type) {
    case OF_DEVICE:
        return get_of_device(usb, setup, in);
    case TO_DEVICE:
        return set_of_device(usb, setup);
    case OF_INTERFACE:
    case TO_INTERFACE:
        return of_interface(usb, setup, in);
    case OF_ENDPOINT:
    case TO_ENDPOINT:
        return of_endpoint(usb, setup, in);
    case CLASS_IN:
    case CLASS_OUT:
        return class_request(usb, setup, out, in);
    case PW_REQUEST_IN:
    case PW_REQUEST_OUT:
        return vendor_request(usb, setup, in);
    case MICROSOFT:
        if (setup->request == MICROSOFT_REQUEST && setup->value == 0u && setup->index == MICROSOFT_INDEX) {
            return pw_usb_microsoft(usb, in);
        }
        return PW_USB_STALLED;
    default:
        return PW_USB_STALLED;
    }
}

/* Of an answer the device sends as much as was asked for. */
static int at_most(int answered, uint16_t length)
{
    return answered > (int)length ? (int)length : answered;
}

int pw_usb_control(struct pw_usb *usb, const struct pw_setup *setup, const uint8_t *out, uint8_t *in)
{
    usb->waits = false;
    return at_most(dispatch(usb, setup, out, in), setup->length);
}

int pw_usb_control_again(struct pw_usb *usb, uint8_t *in)
{
    uint16_t size = 0;
    if (!usb->waits) {
        return PW_USB_STALLED;
    }
    if (!usb->asked) {
        return at_most(ask(usb, in), usb->waiting.length);
    }
    const enum pw_answer answer = pw_device_answer(usb->device, PW_DOOR_USB, in, &size);
    return at_most(outcome(usb, answer, size), usb->waiting.length);
}

void pw_usb_give_up(struct pw_usb *usb)
{
    usb->waits = false;
}

void pw_usb_poll(struct pw_usb *usb)
{
    if (usb->dfu_mode || !usb->attached) {
        return;
    }
    pw_usb_push_text(usb);
    /* The answer to a request that the host has given up is fetched, so that the next one can be asked. */
    if (usb->device->reading && usb->device->reading_door == PW_DOOR_USB && !(usb->waits && usb->asked)) {
        uint8_t answer[PW_ANSWER];
        uint16_t size = 0;
        (void)pw_device_answer(usb->device, PW_DOOR_USB, answer, &size);
    }
}
