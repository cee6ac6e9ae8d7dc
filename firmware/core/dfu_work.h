/* Chapter DFU: what dfu.c and dfu_work.c have in common. */
#ifndef PW_DFU_WORK_H
#define PW_DFU_WORK_H

#include "dfu.h"

#define PW_BANK_BIT(bank) ((uint8_t)(1u << (bank)))

/* What is done next when the flash has nothing to do and everything is read back. */
enum pw_dfu_step {
    PW_STEP_NONE, PW_STEP_OVERWRITE, PW_STEP_ERASE_RECORD, PW_STEP_ERASE, PW_STEP_PROGRAM, /* of a block */
    PW_STEP_MANIFEST, PW_STEP_CHECK, PW_STEP_RECORD, PW_STEP_END                           /* of the end */
};

/* dfu.c */
bool pw_dfu_is_busy(uint8_t state);
void pw_dfu_happens(struct pw_dfu *dfu, enum pw_dfu_event event); /* one that is no request */

/* dfu_work.c */
void pw_dfu_fail(struct pw_dfu *dfu, enum pw_dfu_status status, enum pw_image_reason reason);
void pw_dfu_fail_image(struct pw_dfu *dfu, enum pw_image_reason reason);
/* Begins work that takes so many ms, as GETSTATUS says it. */
void pw_dfu_work(struct pw_dfu *dfu, enum pw_dfu_step first, uint32_t ms);
/* What time alone does: the poll time-out is over, and work that takes too long fails (DFU-008). */
void pw_dfu_time(struct pw_dfu *dfu);

#endif
