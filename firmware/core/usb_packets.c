/* Chapter USB: packets of blocks and records, and of the console's text. */
#include "usb.h"

#include "ser.h"

#include <string.h>

size_t pw_usb_packet(const struct pw_usb *usb)
{
    return usb->high_speed ? PW_USB_PACKET : PW_USB_FULL_SPEED_PACKET;
}

uint8_t pw_usb_bit(const struct pw_usb *usb, uint8_t endpoint)
{
    if (usb->dfu_mode) {
        return 0;
    }
    switch (endpoint) {
    case PW_USB_BLOCKS:
        return PW_USB_BIT_BLOCKS;
    case PW_USB_RECORDS:
        return PW_USB_BIT_RECORDS;
    case PW_USB_NOTICES:
        return PW_USB_BIT_NOTICES;
    case PW_USB_TEXT_OUT:
        return PW_USB_BIT_TEXT_OUT;
    case PW_USB_TEXT_IN:
        return PW_USB_BIT_TEXT_IN;
    default:
        return 0;
    }
}

void pw_usb_drop_records(struct pw_usb *usb)
{
    usb->arrived = 0;
    usb->first_ack = 0;
    usb->ack_count = 0;
    usb->status_waits = false;
    usb->owes_empty = false;
}

/* Blocks ------------------------------------------------------------------------------------------------------- */

/* A status record of the device's own accord goes behind the acknowledgements that wait now; it replaces the one
   before (ACK-006). */
static void fetch_status(struct pw_usb *usb)
{
    if (pw_device_tells(usb->device, PW_DOOR_USB, usb->status)) {
        usb->status_waits = true;
        usb->before_status = usb->ack_count;
    }
}

static void judge(struct pw_usb *usb, uint64_t tick)
{
    struct pw_ack ack;
    fetch_status(usb);
    pw_device_block(usb->device, PW_DOOR_USB, usb->block, usb->arrived, tick, &ack);
    pw_ack_put(usb->acks[(usb->first_ack + usb->ack_count) % PW_QUEUE_RECORDS], &ack);
    usb->ack_count++;
    usb->arrived = 0;
}

static int take_block(struct pw_usb *usb, const uint8_t *packet, size_t size)
{
    if (usb->ack_count == PW_QUEUE_RECORDS) {
        return PW_USB_NAK; /* ACK-001 */
    }
    if (size == 0u && usb->arrived == 0u) {
        return 0; /* USB-018 */
    }
    const uint64_t tick = pw_device_tick(usb->device);
    if (!pw_device_has_room(usb->device)) {
        return PW_USB_NAK; /* BLK-009 */
    }
    if (size != 0u) {
        memcpy(usb->block + usb->arrived, packet, size);
        usb->arrived = (uint16_t)(usb->arrived + size);
    }
    if (usb->arrived == PW_BLOCK || size < pw_usb_packet(usb)) {
        judge(usb, tick);
    }
    return 0;
}

/* Records ------------------------------------------------------------------------------------------------------ */

/* As many whole records as fit (ACK-005). */
static size_t put_records(struct pw_usb *usb, uint8_t *packet, size_t room)
{
    size_t size = 0;
    bool fits = true;
    while (fits) {
        if (usb->status_waits && usb->before_status == 0u) {
            fits = size + PW_STATUS <= room;
            if (fits) {
                memcpy(packet + size, usb->status, PW_STATUS);
                size += PW_STATUS;
                usb->status_waits = false;
            }
        } else {
            fits = usb->ack_count != 0u && size + PW_ACK <= room;
            if (fits) {
                memcpy(packet + size, usb->acks[usb->first_ack], PW_ACK);
                size += PW_ACK;
                usb->first_ack = (usb->first_ack + 1u) % PW_QUEUE_RECORDS;
                usb->ack_count--;
                usb->before_status -= usb->status_waits ? 1u : 0u;
            }
        }
    }
    return size;
}

/* What a packet of so many bytes is answered with; after a full one, an empty one ends what was sent (USB-019). */
static int in_packet(const struct pw_usb *usb, size_t size, bool *owes_empty)
{
    if (size != 0u) {
        *owes_empty = size == pw_usb_packet(usb);
        return (int)size;
    }
    if (*owes_empty) {
        *owes_empty = false;
        return 0;
    }
    return PW_USB_NAK;
}

static int give_records(struct pw_usb *usb, uint8_t *packet, size_t room)
{
    (void)pw_device_tick(usb->device); /* what is due by now has happened */
    fetch_status(usb);
    return in_packet(usb, put_records(usb, packet, room), &usb->owes_empty);
}

/* Text --------------------------------------------------------------------------------------------------------- */

void pw_usb_push_text(struct pw_usb *usb)
{
    if (usb->text_size != 0u && usb->line != NULL) {
        const size_t taken = pw_line_receive(usb->line, usb->device, usb->text + usb->text_at, usb->text_size);
        usb->text_at = (uint16_t)(usb->text_at + taken);
        usb->text_size = (uint16_t)(usb->text_size - taken);
    }
}

static int take_text(struct pw_usb *usb, const uint8_t *packet, size_t size)
{
    pw_usb_push_text(usb);
    if (usb->text_size != 0u || usb->line == NULL) {
        return PW_USB_NAK;
    }
    if (size != 0u) {
        memcpy(usb->text, packet, size);
    }
    usb->text_at = 0;
    usb->text_size = (uint16_t)size;
    pw_usb_push_text(usb);
    return 0;
}

static int give_text(struct pw_usb *usb, uint8_t *packet, size_t room)
{
    if (usb->line == NULL) {
        return PW_USB_NAK;
    }
    return in_packet(usb, pw_line_send(usb->line, usb->device, packet, room), &usb->text_owes_empty);
}

/* All endpoints ------------------------------------------------------------------------------------------------ */

/* Whether the endpoint is there and not halted. */
static bool works(const struct pw_usb *usb, uint8_t endpoint)
{
    const uint8_t bit = pw_usb_bit(usb, endpoint);
    return usb->configured && bit != 0u && (usb->halts & bit) == 0u;
}

int pw_usb_out(struct pw_usb *usb, uint8_t endpoint, const uint8_t *packet, size_t size)
{
    if (!works(usb, endpoint) || size > pw_usb_packet(usb)) {
        return PW_USB_STALLED;
    }
    switch (endpoint) {
    case PW_USB_BLOCKS:
        return take_block(usb, packet, size);
    case PW_USB_TEXT_OUT:
        return take_text(usb, packet, size);
    default:
        return PW_USB_STALLED;
    }
}

int pw_usb_in(struct pw_usb *usb, uint8_t endpoint, uint8_t *packet, size_t room)
{
    const size_t most = room < pw_usb_packet(usb) ? room : pw_usb_packet(usb);
    if (!works(usb, endpoint)) {
        return PW_USB_STALLED;
    }
    switch (endpoint) {
    case PW_USB_RECORDS:
        return give_records(usb, packet, most);
    case PW_USB_TEXT_IN:
        return give_text(usb, packet, most);
    case PW_USB_NOTICES:
        return PW_USB_NAK; /* version 1 has nothing to tell there */
    default:
        return PW_USB_STALLED;
    }
}
