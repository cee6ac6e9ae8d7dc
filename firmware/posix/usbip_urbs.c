/* URBs: queues, packets, answers. */
#include "usbip_urbs.h"

#include <stdlib.h>
#include <string.h>

enum { RET_SUBMIT = 3, RET_UNLINK = 4 };
#define NO_ISO 0xFFFFFFFFu
#define MOST_OF_URB (64u << 20)     /* bytes; Linux has 16 MB by default */
#define MOST_ANSWERS (8u << 20)     /* bytes that wait for a client that does not read */
#define FIRST_ROOM 512u
#define PACKETS_AT_ONCE 64u         /* before the other endpoints have their turn */
#define ROUNDS_AT_ONCE 64u          /* before the caller has its turn */
#define GET_DESCRIPTOR 6u
#define DEVICE 0x0100u
/* 13 packets of 512 bytes fit a microframe of 250 ticks, and 19 of 64 a frame of 2000 (USB-010, BUD-003). */
#define BUS_PARTS (13u * 19u)
#define HIGH_SPEED_PACKET (250u * 19u)
#define FULL_SPEED_PACKET (2000u * 13u)
#define BLOCKS_QUEUE 1u

/* Answers ------------------------------------------------------------------------------------------------------ */

/* Room for so many bytes more behind the answers; NULL if memory has run out. */
static uint8_t *add_answer(struct urbs *urbs, size_t size)
{
    if (urbs->out_first != 0u && urbs->out_first + urbs->out_used + size > urbs->out_room) {
        memmove(urbs->out, urbs->out + urbs->out_first, urbs->out_used);
        urbs->out_first = 0;
    }
    const size_t needed = urbs->out_first + urbs->out_used + size;
    if (needed > urbs->out_room) {
        const size_t room = needed < 65536u ? 65536u : 2u * needed;
        uint8_t *bytes = realloc(urbs->out, room);
        if (bytes == NULL) {
            urbs->failed = true;
            return NULL;
        }
        urbs->out = bytes;
        urbs->out_room = room;
    }
    uint8_t *at = urbs->out + urbs->out_first + urbs->out_used;
    urbs->out_used += size;
    return at;
}

static uint8_t *add_header(struct urbs *urbs, uint32_t code, uint32_t number, int status, size_t data)
{
    uint8_t *at = add_answer(urbs, USBIP_HEADER + data);
    if (at != NULL) {
        memset(at, 0, USBIP_HEADER);
        usbip_put32(at, code);
        usbip_put32(at + 4, number);
        usbip_put32(at + 20, (uint32_t)status);
    }
    return at;
}

static void answer_submit(struct urbs *urbs, const struct urb *urb, int status)
{
    const bool in = (urb->endpoint & 0x80u) != 0u;
    uint8_t *at = add_header(urbs, RET_SUBMIT, urb->number, status, in ? urb->done : 0u);
    if (at != NULL) {
        usbip_put32(at + 24, urb->done);
        usbip_put32(at + 32, urb->iso);
        if (in && urb->done != 0u) {
            memcpy(at + USBIP_HEADER, urb->data, urb->done);
        }
    }
}

static void answer_unlink(struct urbs *urbs, uint32_t number, int status)
{
    (void)add_header(urbs, RET_UNLINK, number, status, 0);
}

/* Queues ------------------------------------------------------------------------------------------------------- */

void urbs_begin(struct urbs *urbs, struct pw_usb *usb)
{
    const uint64_t *tick = urbs->tick;
    memset(urbs, 0, sizeof *urbs);
    urbs->usb = usb;
    urbs->tick = tick;
}

void urbs_free(struct urb *urb)
{
    if (urb != NULL) {
        free(urb->data);
        free(urb);
    }
}

/* The queue of an endpoint's address; endpoints that no device of this kind has share the last one. */
static uint32_t queue_of(uint8_t endpoint)
{
    const uint32_t number = endpoint & 0x0Fu;
    if (number == 0u) {
        return 0;
    }
    return number > 3u ? USBIP_QUEUES - 1u : 2u * number - ((endpoint & 0x80u) != 0u ? 0u : 1u);
}

struct urb *urbs_new(struct urbs *urbs, const uint8_t header[USBIP_HEADER])
{
    const uint32_t size = usbip_get32(header + 24);
    const uint32_t iso = usbip_get32(header + 32);
    if (size > MOST_OF_URB || (iso != 0u && iso != NO_ISO)) {
        return NULL;
    }
    struct urb *urb = calloc(1, sizeof *urb);
    if (urb == NULL) {
        return NULL;
    }
    const bool in = usbip_get32(header + 12) == 1u;
    urb->number = usbip_get32(header + 4);
    urb->endpoint = (uint8_t)((usbip_get32(header + 16) & 0x0Fu) | (in ? 0x80u : 0u));
    urb->flags = usbip_get32(header + 20);
    urb->iso = iso;
    urb->size = size;
    memcpy(urb->setup, header + 40, 8);
    urbs->any = true;
    urbs->newest = urb->number;
    if (!in && size != 0u) {
        urb->data = malloc(size);
        urb->room = size;
        if (urb->data == NULL) {
            urbs_free(urb);
            return NULL;
        }
    }
    return urb;
}

/* Takes an URB out of its queue. */
static void take_out(struct urbs *urbs, struct urb *urb)
{
    const uint32_t queue = queue_of(urb->endpoint);
    struct urb *before = NULL;
    struct urb *at = urbs->first[queue];
    while (at != urb) {
        before = at;
        at = at->next;
    }
    if (before == NULL) {
        urbs->first[queue] = urb->next;
    } else {
        before->next = urb->next;
    }
    if (urbs->last[queue] == urb) {
        urbs->last[queue] = before;
    }
    urbs->waiting--;
    urbs->held -= urb->room;
}

static void complete(struct urbs *urbs, struct urb *urb, int status)
{
    answer_submit(urbs, urb, status);
    take_out(urbs, urb);
    urbs_free(urb);
}

/* The number of the UNLINK that waits for this SUBMIT; false if none does. */
static bool take_early(struct urbs *urbs, uint32_t unlinked, uint32_t *number)
{
    struct early **link = &urbs->early;
    while (*link != NULL) {
        struct early *early = *link;
        if (early->unlinked == unlinked) {
            *number = early->number;
            *link = early->next;
            free(early);
            return true;
        }
        link = &early->next;
    }
    return false;
}

static uint32_t packets_of(const struct urbs *urbs, const struct urb *urb)
{
    const uint32_t packet = (uint32_t)pw_usb_packet(urbs->usb);
    const uint32_t whole = urb->size / packet;
    const bool ends = urb->size % packet != 0u || urb->size == 0u || (urb->flags & USBIP_ZERO_PACKET) != 0u;
    return whole + (ends ? 1u : 0u);
}

void urbs_submit(struct urbs *urbs, struct urb *urb)
{
    const uint32_t queue = queue_of(urb->endpoint);
    uint32_t unlink = 0;
    if (take_early(urbs, urb->number, &unlink)) {
        answer_unlink(urbs, unlink, USBIP_ECONNRESET);
        urbs_free(urb);
        return;
    }
    urb->packets = packets_of(urbs, urb);
    if (urbs->last[queue] == NULL) {
        urbs->first[queue] = urb;
    } else {
        urbs->last[queue]->next = urb;
    }
    urbs->last[queue] = urb;
    urbs->waiting++;
    urbs->held += urb->room;
    urbs->asked_64 = urbs->asked_64 && queue == 0u;
}

static struct urb *find(const struct urbs *urbs, uint32_t number)
{
    for (uint32_t queue = 0; queue < USBIP_QUEUES; queue++) {
        for (struct urb *urb = urbs->first[queue]; urb != NULL; urb = urb->next) {
            if (urb->number == number) {
                return urb;
            }
        }
    }
    return NULL;
}

/* The client sends UNLINK from another queue than SUBMIT, so it may come first: then it waits. */
static void keep_early(struct urbs *urbs, uint32_t number, uint32_t unlinked)
{
    struct early *early = malloc(sizeof *early);
    if (early == NULL) {
        urbs->failed = true;
        return;
    }
    early->number = number;
    early->unlinked = unlinked;
    early->next = urbs->early;
    urbs->early = early;
}

static void cancel(struct urbs *urbs, struct urb *urb, uint32_t number)
{
    if (urb->begun) {
        pw_usb_give_up(urbs->usb);
    }
    if (urb->done != 0u) {
        /* RET_UNLINK has no count, so what was transferred is said by RET_SUBMIT. */
        complete(urbs, urb, USBIP_ECONNRESET);
        answer_unlink(urbs, number, 0);
    } else {
        take_out(urbs, urb);
        urbs_free(urb);
        answer_unlink(urbs, number, USBIP_ECONNRESET);
    }
}

void urbs_unlink(struct urbs *urbs, const uint8_t header[USBIP_HEADER])
{
    const uint32_t number = usbip_get32(header + 4);
    const uint32_t unlinked = usbip_get32(header + 20);
    struct urb *urb = find(urbs, unlinked);
    if (urb != NULL) {
        cancel(urbs, urb, number);
    } else if (!urbs->any) {
        answer_unlink(urbs, number, USBIP_ECONNRESET); /* of the connection before this one */
    } else if (unlinked - urbs->newest != 0u && unlinked - urbs->newest < 0x80000000u) {
        keep_early(urbs, number, unlinked);
    } else {
        answer_unlink(urbs, number, 0); /* answered already */
    }
}

void urbs_clear(struct urbs *urbs)
{
    uint32_t number = 0;
    for (uint32_t queue = 0; queue < USBIP_QUEUES; queue++) {
        while (urbs->first[queue] != NULL) {
            struct urb *urb = urbs->first[queue];
            take_out(urbs, urb);
            urbs_free(urb);
        }
    }
    while (urbs->early != NULL) {
        (void)take_early(urbs, urbs->early->unlinked, &number);
    }
    free(urbs->out);
    urbs_begin(urbs, urbs->usb);
}

/* Work --------------------------------------------------------------------------------------------------------- */

/* Room in an IN URB for so many bytes; it grows with what comes, as most URBs are answered short. */
static bool make_room(struct urbs *urbs, struct urb *urb, uint32_t size)
{
    if (size <= urb->room) {
        return true;
    }
    const uint32_t room = size < FIRST_ROOM ? FIRST_ROOM : size + size / 2u;
    uint8_t *data = realloc(urb->data, room);
    if (data == NULL) {
        urbs->failed = true;
        return false;
    }
    urbs->held += room - urb->room;
    urb->data = data;
    urb->room = room;
    return true;
}

static bool bus_is_busy(const struct urbs *urbs)
{
    return urbs->tick != NULL && urbs->bus_free > *urbs->tick * BUS_PARTS;
}

/* A packet has gone over the bus. */
static void use_bus(struct urbs *urbs)
{
    if (urbs->tick != NULL) {
        const uint64_t now = *urbs->tick * BUS_PARTS;
        urbs->bus_free = urbs->bus_free < now ? now : urbs->bus_free;
        urbs->bus_free += urbs->usb->high_speed ? HIGH_SPEED_PACKET : FULL_SPEED_PACKET;
    }
}

uint64_t urbs_due(const struct urbs *urbs)
{
    const bool waits = urbs->first[BLOCKS_QUEUE] != NULL && bus_is_busy(urbs);
    return waits ? (urbs->bus_free + BUS_PARTS - 1u) / BUS_PARTS : PW_NEVER;
}

static bool work_out(struct urbs *urbs, struct urb *urb)
{
    const bool blocks = urb->endpoint == PW_USB_BLOCKS;
    if (blocks && bus_is_busy(urbs)) {
        return false;
    }
    const uint32_t packet = (uint32_t)pw_usb_packet(urbs->usb);
    const uint32_t left = urb->size - urb->done;
    const uint32_t size = left < packet ? left : packet;
    const uint8_t *data = urb->data == NULL ? urb->setup : urb->data + urb->done; /* never read if size is 0 */
    const int answer = pw_usb_out(urbs->usb, urb->endpoint, data, size);
    if (answer == PW_USB_NAK) {
        return false;
    }
    if (answer == PW_USB_STALLED) {
        complete(urbs, urb, USBIP_EPIPE);
        return true;
    }
    if (blocks) {
        use_bus(urbs);
    }
    urb->done += size;
    urb->packets--;
    if (urb->packets == 0u) {
        complete(urbs, urb, 0);
    }
    return true;
}

/* Ends an IN URB after a packet that was short, or one after which nothing more fits. */
static void end_in(struct urbs *urbs, struct urb *urb, bool overflows)
{
    int status = 0;
    if (overflows) {
        status = USBIP_EOVERFLOW;
    } else if (urb->done < urb->size && (urb->flags & USBIP_SHORT_NOT_OK) != 0u) {
        status = USBIP_EREMOTEIO;
    } else {
        status = 0;
    }
    complete(urbs, urb, status);
}

static bool work_in(struct urbs *urbs, struct urb *urb)
{
    const uint32_t packet = (uint32_t)pw_usb_packet(urbs->usb);
    if (!make_room(urbs, urb, urb->done + packet)) {
        return false;
    }
    /* The device knows nothing of the URB's size: a packet that does not fit is an overflow, as on any bus. */
    const int answer = pw_usb_in(urbs->usb, urb->endpoint, urb->data + urb->done, packet);
    if (answer == PW_USB_NAK) {
        return false;
    }
    if (answer == PW_USB_STALLED) {
        complete(urbs, urb, USBIP_EPIPE);
        return true;
    }
    const uint32_t size = (uint32_t)answer;
    const bool overflows = size > urb->size - urb->done;
    urb->done = overflows ? urb->size : urb->done + size;
    if (size < packet || urb->done == urb->size) {
        end_in(urbs, urb, overflows);
    }
    return true;
}

static struct pw_setup setup_of(const struct urb *urb)
{
    struct pw_setup setup;
    setup.type = urb->setup[0];
    setup.request = urb->setup[1];
    setup.value = pw_get16(urb->setup + 2);
    setup.index = pw_get16(urb->setup + 4);
    setup.length = pw_get16(urb->setup + 6);
    return setup;
}

/* vhci keeps port resets to itself. What Linux does after one is seen: it asks for the device descriptor with length
   64, then with 18, and nothing else is in flight. */
static void infer_reset(struct urbs *urbs, const struct pw_setup *setup)
{
    const bool device = setup->type == 0x80u && setup->request == GET_DESCRIPTOR && setup->value == DEVICE;
    if (device && setup->length == 18u && urbs->asked_64) {
        pw_usb_bus_reset(urbs->usb);
    }
    urbs->asked_64 = device && setup->length == 64u && urbs->waiting == 1u;
}

static int control(struct urbs *urbs, struct urb *urb, uint8_t *in)
{
    const struct pw_setup setup = setup_of(urb);
    if (urb->begun) {
        return pw_usb_control_again(urbs->usb, in);
    }
    infer_reset(urbs, &setup);
    return pw_usb_control(urbs->usb, &setup, urb->data, in);
}

static bool work_control(struct urbs *urbs, struct urb *urb)
{
    uint8_t in[PW_USB_CONTROL];
    const bool out = (urb->setup[0] & 0x80u) == 0u;
    const bool sent = urb->data != NULL || urb->size == 0u; /* what the host sends is there */
    if (out && (!sent || urb->size < pw_get16(urb->setup + 6))) {
        urb->done = 0;
        complete(urbs, urb, USBIP_EPROTO);
        return true;
    }
    const int answer = control(urbs, urb, in);
    urb->begun = answer == PW_USB_NAK;
    if (answer == PW_USB_NAK) {
        return false;
    }
    if (answer == PW_USB_STALLED) {
        complete(urbs, urb, USBIP_EPIPE);
        return true;
    }
    const uint32_t size = (uint32_t)answer;
    if (out) {
        urb->done = urb->size;
        complete(urbs, urb, 0);
    } else if (make_room(urbs, urb, size)) {
        urb->done = size < urb->size ? size : urb->size;
        if (urb->done != 0u) {
            memcpy(urb->data, in, urb->done);
        }
        end_in(urbs, urb, size > urb->size);
    } else {
        return false;
    }
    return true;
}

/* One packet or request of a queue. Returns whether anything has moved. */
static bool work(struct urbs *urbs, uint32_t queue)
{
    struct urb *urb = urbs->first[queue];
    if (urb == NULL || urbs->failed || urbs->out_used > MOST_ANSWERS) {
        return false;
    }
    if (queue == 0u) {
        return work_control(urbs, urb);
    }
    return (urb->endpoint & 0x80u) != 0u ? work_in(urbs, urb) : work_out(urbs, urb);
}

void urbs_carry_out(struct urbs *urbs)
{
    bool moved = true;
    for (uint32_t round = 0; moved && round < ROUNDS_AT_ONCE; round++) {
        moved = false;
        for (uint32_t queue = 0; queue < USBIP_QUEUES; queue++) {
            uint32_t packets = 0;
            while (packets < PACKETS_AT_ONCE && work(urbs, queue)) {
                packets++;
                moved = true;
            }
        }
    }
    urbs->more = moved;
}
