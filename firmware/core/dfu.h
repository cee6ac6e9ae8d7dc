/* Chapter DFU: the upgrade over USB, by requests. */
#ifndef PW_DFU_H
#define PW_DFU_H

#include "dfu_work.h"

/* DFU-007: the answer to GETSTATUS. */
struct pw_dfu_reply {
    uint8_t status; /* enum pw_dfu_status */
    uint32_t poll_ms;
    uint8_t state;  /* enum pw_dfu_state */
    uint8_t string;
};
void pw_dfu_reply_put(uint8_t bytes[6], const struct pw_dfu_reply *reply);
/* DFU-009: the status for a block of `length` bytes, 0 for the end of the download, of an image of `total` bytes of
   which so many were received. */
enum pw_dfu_status pw_dfu_block(uint32_t number, uint32_t length, uint32_t received, uint32_t total);
/* DFU-008: how long a block takes. */
uint32_t pw_dfu_block_ms(uint32_t number);

/* DFU mode begins, with what the loader had started. Call it before the device comes back on the bus: it may read an
   image and wait for the flash. */
void pw_dfu_begin(struct pw_dfu *dfu, const struct pw_port *port, const struct pw_boot *running);
/* A class request; `out` is what came with it, `in` has room for PW_DFU_BLOCK bytes. The bytes of the answer, or -1 for
   STALL. */
int pw_dfu_request(struct pw_dfu *dfu, const struct pw_setup *setup, const uint8_t *out, uint8_t *in);
/* DFU-015: a host has configured the device in DFU mode. */
void pw_dfu_configured(struct pw_dfu *dfu);
/* True if the device boots for it, as soon as pw_dfu_leaves. */
bool pw_dfu_bus_reset(struct pw_dfu *dfu);
bool pw_dfu_leaves(const struct pw_dfu *dfu);
/* DFU-012: a string descriptor as ASCII, NULL if it has another index. */
const char *pw_dfu_string(const struct pw_dfu *dfu, uint8_t index);

#endif
