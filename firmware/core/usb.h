/* Chapter USB: control requests, and packets of the endpoints. It knows no registers: a board's driver, or
   posix/usbip.c, calls it with SETUP packets and with the packets of endpoints, and does what it answers.

   Order of calls: pw_usb_begin when the device is to attach (in run-time mode not before pw_device_serving: TIM-002),
   pw_usb_bus_reset when the bus resets, then requests and packets as they come; pw_usb_poll after each pw_device_poll.
   A driver offers what was answered with NAK again after each poll. */
#ifndef PW_USB_H
#define PW_USB_H

#include "device.h"

struct pw_line; /* ser.h */
struct pw_dfu;  /* dfu.h */

#ifndef PW_USB_VENDOR
#define PW_USB_VENDOR 0x1209u /* USB-001 */
#endif
#define PW_USB_PACKET 512u           /* bytes of the largest bulk packet at high speed: USB-005 */
#define PW_USB_FULL_SPEED_PACKET 64u /* and at full speed */
#define PW_USB_CONTROL 2048u         /* most data of a request, either way: wTransferSize of USB-013 */
#define PW_USB_LINE_CODING 7u        /* USB-023 */

/* What a call answers besides a number of bytes. */
enum { PW_USB_NAK = -1, PW_USB_STALLED = -2 };

/* Addresses of the endpoints (USB-005). */
enum pw_usb_endpoint {
    PW_USB_BLOCKS = 0x01, PW_USB_RECORDS = 0x81, PW_USB_NOTICES = 0x82, PW_USB_TEXT_OUT = 0x03, PW_USB_TEXT_IN = 0x83
};

/* The same as bits of `halts` and `toggles`. */
#define PW_USB_BIT_BLOCKS 1u
#define PW_USB_BIT_RECORDS 2u
#define PW_USB_BIT_NOTICES 4u
#define PW_USB_BIT_TEXT_OUT 8u
#define PW_USB_BIT_TEXT_IN 16u

struct pw_usb {
    /* What it belongs to. */
    struct pw_device *device; /* not used in DFU mode */
    struct pw_line *line;     /* of CDC-ACM; NULL without the feature CONSOLE and in DFU mode: endpoints answer NAK */
    struct pw_dfu *dfu;       /* of DFU mode; not used at run time */
    const struct pw_about *about;
    bool dfu_mode;
    bool high_speed;
    /* What a driver looks at. */
    bool attached;            /* from pw_usb_begin until the driver takes the device off the bus */
    bool was_configured;      /* a host has configured the device since pw_usb_begin: FWU-020 */
    uint8_t address;          /* to be used after the status stage of SET_ADDRESS */
    uint8_t test_mode;        /* not 0: test selector to enter after the status stage of SET_FEATURE(TEST_MODE) */
    uint8_t toggles;          /* endpoints to be set to DATA0, as bits; the driver clears them */
    /* State of the bus. */
    bool configured;
    bool suspended;           /* while configured */
    uint8_t halts;            /* endpoints, as bits */
    /* A request that was answered with NAK. */
    bool waits;
    bool asked;               /* the device has it; otherwise it waits for another reader */
    struct pw_setup waiting;
    /* DFU at run time: appDETACH (USB-024). */
    bool detaching;
    /* The console's line (USB-023), and text that has arrived and that the line had no room for. */
    uint8_t coding[PW_USB_LINE_CODING];
    bool dtr;
    bool text_owes_empty;
    uint16_t text_at, text_size;
    uint8_t text[PW_USB_PACKET];
    /* A block of which a part has arrived (USB-017). */
    uint16_t arrived;
    uint8_t block[PW_BLOCK];
    /* What waits for 81 IN: acknowledgements in a ring, and a status record behind some of them (ACK-006). */
    uint32_t first_ack, ack_count;
    uint32_t before_status; /* acknowledgements that go before it */
    bool status_waits;
    bool owes_empty; /* USB-019 */
    uint8_t status[PW_STATUS];
    uint8_t acks[PW_QUEUE_RECORDS][PW_ACK];
};

/* usb.c: what happens to the bus ------------------------------------------------------------------------------- */

/* The device attaches. `line` has been begun as line 0, `dfu` too in DFU mode. */
void pw_usb_begin(struct pw_usb *usb, struct pw_device *device, struct pw_line *line, struct pw_dfu *dfu,
                  const struct pw_about *about, bool high_speed, bool dfu_mode);
void pw_usb_bus_reset(struct pw_usb *usb);
void pw_usb_suspend(struct pw_usb *usb);
void pw_usb_resume(struct pw_usb *usb);
/* The voltage of the bus is gone (STA-006). */
void pw_usb_unplugged(struct pw_usb *usb);
/* Go on with what waits for time to pass. */
void pw_usb_poll(struct pw_usb *usb);

/* usb.c: the control endpoint ---------------------------------------------------------------------------------- */

/* A request, with the data that came with it (setup->length bytes of a request out; not read beyond PW_USB_CONTROL).
   `in` has room for PW_USB_CONTROL bytes. Answers the bytes of the data stage, 0 if there is none; PW_USB_STALLED; or
   PW_USB_NAK: then ask pw_usb_control_again after the next poll, until it answers something else. A new request gives
   up the one before. */
int pw_usb_control(struct pw_usb *usb, const struct pw_setup *setup, const uint8_t *out, uint8_t *in);
int pw_usb_control_again(struct pw_usb *usb, uint8_t *in);
/* The host has given up the request that was answered with NAK. */
void pw_usb_give_up(struct pw_usb *usb);

/* usb_packets.c: the other endpoints --------------------------------------------------------------------------- */

/* The largest packet of a bulk endpoint at the present speed. */
size_t pw_usb_packet(const struct pw_usb *usb);
/* A packet out: 0 if it was taken, PW_USB_NAK or PW_USB_STALLED. */
int pw_usb_out(struct pw_usb *usb, uint8_t endpoint, const uint8_t *packet, size_t size);
/* A packet in: its bytes, PW_USB_NAK or PW_USB_STALLED. `room` is that of a largest packet. */
int pw_usb_in(struct pw_usb *usb, uint8_t endpoint, uint8_t *packet, size_t room);
/* The bit of an endpoint in `halts` and `toggles`; 0 if the device has none of that address. */
uint8_t pw_usb_bit(const struct pw_usb *usb, uint8_t endpoint);
/* Drop the records that wait, and the part of a block (USB-003, USB-026). */
void pw_usb_drop_records(struct pw_usb *usb);
/* Take text of a packet that the line had no room for. */
void pw_usb_push_text(struct pw_usb *usb);

/* usb_descriptors.c -------------------------------------------------------------------------------------------- */

/* The whole descriptor for a GET_DESCRIPTOR, or PW_USB_STALLED. */
int pw_usb_descriptor(const struct pw_usb *usb, const struct pw_setup *setup, uint8_t *in);
/* The Microsoft OS 2.0 descriptor set (USB-012). */
int pw_usb_microsoft(const struct pw_usb *usb, uint8_t *in);

#endif
