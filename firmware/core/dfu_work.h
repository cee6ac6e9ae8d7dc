/* Chapter DFU: an upgrade, and what the flash does for it. The flash works by itself: pw_dfu_poll begins the next piece
   of work when it has finished the one before. */
#ifndef PW_DFU_WORK_H
#define PW_DFU_WORK_H

#include "device.h"
#include "dfu_states.h"
#include "fwu.h"

#define PW_DFU_BLOCK PW_FIRST_BLOCK /* bytes: DFU-009, wTransferSize */
#define PW_BANK_BIT(bank) ((uint8_t)(1u << (bank)))

/* What is done next when the flash has nothing to do and everything is read back. */
enum pw_dfu_step {
    PW_STEP_NONE, PW_STEP_OVERWRITE, PW_STEP_ERASE_RECORD, PW_STEP_ERASE, PW_STEP_PROGRAM, /* of a block */
    PW_STEP_MANIFEST, PW_STEP_CHECK, PW_STEP_RECORD, PW_STEP_END                           /* of the end */
};

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

void pw_dfu_happens(struct pw_dfu *dfu, enum pw_dfu_event event); /* one that is no request */
void pw_dfu_fail(struct pw_dfu *dfu, enum pw_dfu_status status, enum pw_image_reason reason);
void pw_dfu_fail_image(struct pw_dfu *dfu, enum pw_image_reason reason);
/* Begins work that takes so many ms, as GETSTATUS says it. */
void pw_dfu_work(struct pw_dfu *dfu, enum pw_dfu_step first, uint32_t ms);
/* What time alone does: the poll time-out is over, and work that takes too long fails (DFU-008). */
void pw_dfu_time(struct pw_dfu *dfu);
/* Goes on with the work. Each call is short. */
void pw_dfu_poll(struct pw_dfu *dfu);
/* The tick of the port at which something is due; PW_NEVER if nothing is. */
uint64_t pw_dfu_due(const struct pw_dfu *dfu);

#endif
