/* Chapter USB: descriptors, at both speeds and in DFU mode. Templates, with what differs put in. */
#include "usb.h"

#include "dfu.h"

#include <string.h>

/* USB-006 */
enum descriptor_type {
    DEVICE = 1, CONFIGURATION = 2, STRING = 3, ENDPOINT = 5, DEVICE_QUALIFIER = 6, OTHER_SPEED_CONFIGURATION = 7,
    BOS = 15
};
#define ENGLISH 0x0409u /* USB-007 */
#define FIRST_REASON 17u /* strings of DFU-012 */
#define DEVICE_BYTES 18u
#define QUALIFIER_BYTES 10u
#define MOST_CHARACTERS 126u /* of a string whose length is one byte */
#define BULK 2u
#define SLOW_INTERVAL 0x20u /* USB-010 */

/* USB-008; vendor, product and firmware are put in. */
static const uint8_t DEVICE_TEMPLATE[DEVICE_BYTES] = {
    DEVICE_BYTES, DEVICE, 0x01, 0x02, 0xEF, 0x02, 0x01, 0x40, 0, 0, 0, 0, 0, 0, 1, 2, 3, 1
};

/* USB-009, at high speed. */
static const uint8_t CONFIGURATION_TEMPLATE[] = {
    0x09, 0x02, 0x74, 0x00, 0x04, 0x01, 0x00, 0xC0, 0x32, /* configuration */
    0x09, 0x04, 0x00, 0x00, 0x02, 0xFF, 0x50, 0x01, 0x04, /* interface 0 */
    0x07, 0x05, 0x01, 0x02, 0x00, 0x02, 0x01,             /* 01 OUT */
    0x07, 0x05, 0x81, 0x02, 0x00, 0x02, 0x01,             /* 81 IN */
    0x08, 0x0B, 0x01, 0x02, 0x02, 0x02, 0x00, 0x05,       /* association of interfaces 1 and 2 */
    0x09, 0x04, 0x01, 0x00, 0x01, 0x02, 0x02, 0x00, 0x05, /* interface 1 */
    0x05, 0x24, 0x00, 0x20, 0x01,                         /* header */
    0x05, 0x24, 0x01, 0x00, 0x02,                         /* call management */
    0x04, 0x24, 0x02, 0x02,                               /* abstract control */
    0x05, 0x24, 0x06, 0x01, 0x02,                         /* union */
    0x07, 0x05, 0x82, 0x03, 0x10, 0x00, 0x09,             /* 82 IN */
    0x09, 0x04, 0x02, 0x00, 0x02, 0x0A, 0x00, 0x00, 0x00, /* interface 2 */
    0x07, 0x05, 0x03, 0x02, 0x00, 0x02, 0x01,             /* 03 OUT */
    0x07, 0x05, 0x83, 0x02, 0x00, 0x02, 0x01,             /* 83 IN */
    0x09, 0x04, 0x03, 0x00, 0x00, 0xFE, 0x01, 0x01, 0x06, /* interface 3 */
    0x09, 0x21, 0x0F, 0xE8, 0x03, 0x00, 0x08, 0x10, 0x01  /* DFU functional: USB-013 */
};

/* USB-013 */
static const uint8_t DFU_CONFIGURATION[] = {
    0x09, 0x02, 0x1B, 0x00, 0x01, 0x01, 0x00, 0xC0, 0x32, /* configuration */
    0x09, 0x04, 0x00, 0x00, 0x00, 0xFE, 0x01, 0x02, 0x04, /* interface 0, setting 0 */
    0x09, 0x21, 0x0F, 0xE8, 0x03, 0x00, 0x08, 0x10, 0x01  /* DFU functional */
};

/* USB-011; the size of the Microsoft set is put in. */
static const uint8_t BOS_TEMPLATE[] = {
    0x05, 0x0F, 0x21, 0x00, 0x01,                         /* BOS */
    0x1C, 0x10, 0x05, 0x00,                               /* platform capability */
    0xDF, 0x60, 0xDD, 0xD8, 0x89, 0x45, 0xC7, 0x4C,       /* Microsoft OS 2.0 */
    0x9C, 0xD2, 0x65, 0x9D, 0x9E, 0x64, 0x8A, 0x9F,
    0x00, 0x00, 0x03, 0x06, 0x00, 0x00, 0x20, 0x00        /* Windows 8.1, size of the set, request 20h */
};
#define BOS_SET_SIZE 29u /* offset of that size */

/* USB-012 */
#define FEATURES_BYTES 152u /* compatible id and registry property */
#define RUN_TIME_SET 338u
#define DFU_SET 162u
static const uint8_t SET_HEADER[8] = {0x0A, 0x00, 0x00, 0x00, 0x00, 0x00, 0x03, 0x06};
static const uint8_t CONFIGURATION_SUBSET[8] = {0x08, 0x00, 0x01, 0x00, 0x00, 0x00, 0x48, 0x01};
static const uint8_t COMPATIBLE_ID[20] = {0x14, 0x00, 0x03, 0x00, 'W', 'I', 'N', 'U', 'S', 'B'};
static const uint8_t PROPERTY[8] = {0x84, 0x00, 0x04, 0x00, 0x07, 0x00, 0x2A, 0x00};
static const char PROPERTY_NAME[] = "DeviceInterfaceGUIDs";
static const char GUID_OF_BLOCKS[] = "{1C743641-BE8D-477D-86BE-36371610DF1E}";
static const char GUID_OF_DFU[] = "{F04B38B6-DE10-4A02-853E-17F17AEB46C8}";

static size_t put_bytes(uint8_t *to, size_t at, const uint8_t *bytes, size_t size)
{
    memcpy(to + at, bytes, size);
    return at + size;
}

/* ASCII as UTF-16. */
static size_t put_text(uint8_t *to, size_t at, const char *text, size_t characters)
{
    for (size_t i = 0; i < characters; i++) {
        pw_put16(to + at + 2u * i, (uint8_t)text[i]);
    }
    return at + 2u * characters;
}

/* Devices and configurations ----------------------------------------------------------------------------------- */

static uint16_t release(const struct pw_about *about)
{
    const uint32_t major = about->firmware[0];
    return (uint16_t)(((major / 10u) << 12) | ((major % 10u) << 8) | ((uint32_t)about->firmware[1] << 4)
                      | about->firmware[2]);
}

static size_t put_device(const struct pw_usb *usb, uint8_t *to)
{
    memcpy(to, DEVICE_TEMPLATE, DEVICE_BYTES);
    if (usb->dfu_mode) {
        memset(to + 4, 0, 3); /* no composite device: USB-013 */
    }
    pw_put16(to + 8, PW_USB_VENDOR);
    pw_put16(to + 10, usb->about->product + (usb->dfu_mode ? 1u : 0u));
    pw_put16(to + 12, release(usb->about));
    return DEVICE_BYTES;
}

static size_t put_qualifier(const struct pw_usb *usb, uint8_t *to)
{
    uint8_t device[DEVICE_BYTES];
    (void)put_device(usb, device);
    memcpy(to, device, 8);
    to[0] = QUALIFIER_BYTES;
    to[1] = DEVICE_QUALIFIER;
    to[8] = device[17];
    to[9] = 0;
    return QUALIFIER_BYTES;
}

/* What USB-010 says of the endpoints at full speed. */
static void slow_down(uint8_t *configuration, size_t size)
{
    for (size_t at = 0; at < size; at += configuration[at]) {
        if (configuration[at + 1u] == ENDPOINT) {
            if (configuration[at + 3u] == BULK) {
                pw_put16(configuration + at + 4u, PW_USB_FULL_SPEED_PACKET);
            } else {
                configuration[at + 6u] = SLOW_INTERVAL;
            }
        }
    }
}

static size_t put_configuration(const struct pw_usb *usb, uint8_t type, uint8_t *to)
{
    const bool fast = usb->high_speed == (type == CONFIGURATION);
    size_t size = sizeof DFU_CONFIGURATION;
    if (usb->dfu_mode) {
        memcpy(to, DFU_CONFIGURATION, size);
    } else {
        size = sizeof CONFIGURATION_TEMPLATE;
        memcpy(to, CONFIGURATION_TEMPLATE, size);
        if (!fast) {
            slow_down(to, size);
        }
    }
    to[1] = type;
    return size;
}

static size_t put_bos(const struct pw_usb *usb, uint8_t *to)
{
    memcpy(to, BOS_TEMPLATE, sizeof BOS_TEMPLATE);
    pw_put16(to + BOS_SET_SIZE, usb->dfu_mode ? DFU_SET : RUN_TIME_SET);
    return sizeof BOS_TEMPLATE;
}

/* Strings ------------------------------------------------------------------------------------------------------ */

/* USB-007; NULL if there is none of that index. */
static const char *string_of(const struct pw_usb *usb, uint8_t index)
{
    switch (index) {
    case 1:
        return "phasewire";
    case 2:
        return usb->about->product_name;
    case 3:
        return usb->about->serial_number;
    case 4:
        return usb->dfu_mode ? "firmware" : "phasewire array";
    case 5:
        return usb->dfu_mode ? NULL : "phasewire console";
    case 6:
        return usb->dfu_mode ? NULL : "phasewire firmware update";
    default:
        return usb->dfu_mode && index >= FIRST_REASON ? pw_dfu_string(usb->dfu, index) : NULL;
    }
}

static int put_string(const struct pw_usb *usb, uint8_t index, uint16_t language, uint8_t *to)
{
    size_t size = 4;
    if (index == 0u) {
        pw_put16(to + 2, ENGLISH);
    } else {
        const char *text = language == ENGLISH ? string_of(usb, index) : NULL;
        if (text == NULL) {
            return PW_USB_STALLED;
        }
        const size_t characters = strlen(text);
        size = put_text(to, 2, text, characters < MOST_CHARACTERS ? characters : MOST_CHARACTERS);
    }
    to[0] = (uint8_t)size;
    to[1] = STRING;
    return (int)size;
}

int pw_usb_descriptor(const struct pw_usb *usb, const struct pw_setup *setup, uint8_t *in)
{
    const uint8_t type = (uint8_t)(setup->value >> 8);
    const uint8_t index = (uint8_t)(setup->value & 0xFFu);
    if (type == STRING) {
        return put_string(usb, index, setup->index, in);
    }
    if (index != 0u || setup->index != 0u) {
        return PW_USB_STALLED;
    }
    switch (type) {
    case DEVICE:
        return (int)put_device(usb, in);
    case CONFIGURATION:
    case OTHER_SPEED_CONFIGURATION:
        return (int)put_configuration(usb, type, in);
    case DEVICE_QUALIFIER:
        return (int)put_qualifier(usb, in);
    case BOS:
        return (int)put_bos(usb, in);
    default:
        return PW_USB_STALLED;
    }
}

/* Microsoft OS 2.0 --------------------------------------------------------------------------------------------- */

/* Compatible id and registry property of a function: WinUSB, found by a GUID. */
static size_t put_features(uint8_t *to, size_t at, const char *guid)
{
    at = put_bytes(to, at, COMPATIBLE_ID, sizeof COMPATIBLE_ID);
    at = put_bytes(to, at, PROPERTY, sizeof PROPERTY);
    at = put_text(to, at, PROPERTY_NAME, sizeof PROPERTY_NAME);
    pw_put16(to + at, 2u * (sizeof GUID_OF_DFU + 1u));
    at = put_text(to, at + 2u, guid, sizeof GUID_OF_DFU);
    pw_put16(to + at, 0); /* the end of REG_MULTI_SZ */
    return at + 2u;
}

static size_t put_function(uint8_t *to, size_t at, uint8_t first_interface, const char *guid)
{
    const uint8_t subset[8] = {8, 0, 2, 0, first_interface, 0, FEATURES_BYTES + 8u, 0};
    at = put_bytes(to, at, subset, sizeof subset);
    return put_features(to, at, guid);
}

int pw_usb_microsoft(const struct pw_usb *usb, uint8_t *in)
{
    size_t at = put_bytes(in, 0, SET_HEADER, sizeof SET_HEADER);
    pw_put16(in + at, usb->dfu_mode ? DFU_SET : RUN_TIME_SET);
    at += 2u;
    if (usb->dfu_mode) {
        return (int)put_features(in, at, GUID_OF_DFU);
    }
    at = put_bytes(in, at, CONFIGURATION_SUBSET, sizeof CONFIGURATION_SUBSET);
    at = put_function(in, at, 0, GUID_OF_BLOCKS);
    return (int)put_function(in, at, 3, GUID_OF_DFU);
}
