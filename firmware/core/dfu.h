/* Chapter DFU: the upgrade over USB. pw_dfu_after holds for run-time mode too; the rest is of DFU mode alone.
   The flash works by itself: pw_dfu_poll begins the next piece of work when it has finished the one before. */
#ifndef PW_DFU_H
#define PW_DFU_H

#include "device.h"
#include "fwu.h"

#define PW_DFU_BLOCK PW_FIRST_BLOCK /* bytes: DFU-009, wTransferSize */

/* DFU-006 */
enum pw_dfu_event {
    PW_DFU_ON_DETACH, PW_DFU_ON_DNLOAD, PW_DFU_ON_DNLOAD_END, PW_DFU_ON_UPLOAD, PW_DFU_ON_UPLOAD_END,
    PW_DFU_ON_GETSTATUS, PW_DFU_ON_GETSTATUS_BUSY, PW_DFU_ON_CLRSTATUS, PW_DFU_ON_GETSTATE, PW_DFU_ON_ABORT,
    PW_DFU_ON_REFUSED, /* any other request, and those that are refused */
    PW_DFU_ON_REATTACHED, PW_DFU_ON_POLL_TIMEOUT, PW_DFU_ON_FAILURE, PW_DFU_ON_BUS_RESET
};
/* The state that follows (enum pw_dfu_state), and whether the request is answered with STALL. */
uint8_t pw_dfu_after(uint8_t state, enum pw_dfu_event event, bool *stalls);

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

struct pw_dfu {
    const struct pw_port *port;
    uint8_t bank;   /* that a download goes to: FWU-018 */
    uint8_t intact; /* banks whose image has the SHA-256 of its record, as bits */
    bool configured, leaving;
    uint64_t leave_by; /* tick at which it leaves even if the flash is busy */
    uint8_t state;  /* enum pw_dfu_state */
    uint8_t status; /* enum pw_dfu_status */
    uint8_t reason; /* enum pw_image_reason: DFU-012 */
    /* A download. */
    uint32_t received, total;
    uint8_t block[PW_DFU_BLOCK];
    uint32_t block_at, block_size; /* within the image */
    /* An upload. */
    uint16_t upload_number; /* of the next block */
    uint32_t upload_address, upload_size;
    /* Work: one step after the other. */
    uint8_t step;
    uint64_t work_since; /* tick */
    uint64_t busy_until; /* tick at which the poll time-out is over */
    uint32_t busy_ms;    /* that GETSTATUS names */
    uint32_t written;    /* bytes of the block whose programming has begun */
    /* What the flash was told to do, and how much of that was read back: an erasure if there is no data. */
    bool flashing;
    uint32_t flash_address, flash_size, flash_checked;
    const uint8_t *flash_data;
    struct pw_image image;
    uint8_t record[PW_RECORD_WRITTEN];
};

/* DFU mode begins, with what the loader had started. Call it before the device comes back on the bus: it may read an
   image and wait for the flash. */
void pw_dfu_begin(struct pw_dfu *dfu, const struct pw_port *port, const struct pw_boot *running);
/* A class request; `out` is what came with it, `in` has room for PW_DFU_BLOCK bytes. The bytes of the answer, or -1 for
   STALL. */
int pw_dfu_request(struct pw_dfu *dfu, const struct pw_setup *setup, const uint8_t *out, uint8_t *in);
/* Goes on with the work. Each call is short. */
void pw_dfu_poll(struct pw_dfu *dfu);
/* The tick of the port at which something is due; PW_NEVER if nothing is. */
uint64_t pw_dfu_due(const struct pw_dfu *dfu);
/* DFU-015: a host has configured the device in DFU mode. */
void pw_dfu_configured(struct pw_dfu *dfu);
/* True if the device boots for it, as soon as pw_dfu_leaves. */
bool pw_dfu_bus_reset(struct pw_dfu *dfu);
bool pw_dfu_leaves(const struct pw_dfu *dfu);
/* DFU-012: a string descriptor as ASCII, NULL if it has another index. */
const char *pw_dfu_string(const struct pw_dfu *dfu, uint8_t index);

#endif
