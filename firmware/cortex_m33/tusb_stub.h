/* The part of TinyUSB's interface that tinyusb.c uses, so that it compiles here without TinyUSB. On a board include
   "tusb.h" and "device/usbd_pvt.h" instead (-DPW_TINYUSB). The names and types are TinyUSB's. */
#ifndef TUSB_STUB_H
#define TUSB_STUB_H

#include <stdbool.h>
#include <stdint.h>

typedef struct {
    uint8_t bmRequestType;
    uint8_t bRequest;
    uint16_t wValue;
    uint16_t wIndex;
    uint16_t wLength;
} tusb_control_request_t;

typedef struct {
    uint8_t bLength;
    uint8_t bDescriptorType;
    uint8_t bInterfaceNumber;
} tusb_desc_interface_t;

typedef struct {
    uint8_t bLength;
    uint8_t bDescriptorType;
    uint8_t bEndpointAddress;
} tusb_desc_endpoint_t;

typedef enum { XFER_RESULT_SUCCESS, XFER_RESULT_FAILED, XFER_RESULT_STALLED } xfer_result_t;
enum { CONTROL_STAGE_IDLE, CONTROL_STAGE_SETUP, CONTROL_STAGE_DATA, CONTROL_STAGE_ACK };

typedef struct {
    const char *name;
    void (*init)(void);
    bool (*deinit)(void);
    void (*reset)(uint8_t port);
    uint16_t (*open)(uint8_t port, const tusb_desc_interface_t *interface, uint16_t most);
    bool (*control_xfer_cb)(uint8_t port, uint8_t stage, const tusb_control_request_t *request);
    bool (*xfer_cb)(uint8_t port, uint8_t endpoint, xfer_result_t result, uint32_t bytes);
    void (*sof)(uint8_t port, uint32_t frame);
} usbd_class_driver_t;

bool tud_control_xfer(uint8_t port, const tusb_control_request_t *request, void *buffer, uint16_t size);
bool usbd_edpt_open(uint8_t port, const tusb_desc_endpoint_t *endpoint);
bool usbd_edpt_xfer(uint8_t port, uint8_t endpoint, uint8_t *buffer, uint16_t bytes);
bool usbd_edpt_busy(uint8_t port, uint8_t endpoint);
void tud_task(void);

#endif
