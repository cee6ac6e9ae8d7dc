/* A TinyUSB that is not there: no bus, no transfers. */
#include "tusb_stub.h"

bool tud_control_xfer(uint8_t port, const tusb_control_request_t *request, void *buffer, uint16_t size)
{
    (void)port;
    (void)request;
    (void)buffer;
    return size == 0u;
}

bool usbd_edpt_open(uint8_t port, const tusb_desc_endpoint_t *endpoint)
{
    (void)port;
    return endpoint->bLength == 7u;
}

bool usbd_edpt_xfer(uint8_t port, uint8_t endpoint, uint8_t *buffer, uint16_t bytes)
{
    (void)port;
    (void)endpoint;
    (void)buffer;
    return bytes == 0u;
}

bool usbd_edpt_busy(uint8_t port, uint8_t endpoint)
{
    (void)port;
    return endpoint == 0u;
}

void tud_task(void)
{
}
