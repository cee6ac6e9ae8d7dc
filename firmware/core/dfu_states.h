/* Chapter DFU: states and events. Pure; they hold for run-time mode too. */
#ifndef PW_DFU_STATES_H
#define PW_DFU_STATES_H

#include "bytes.h"
#include "codes.h"

/* DFU-006 */
enum pw_dfu_event {
    PW_DFU_ON_DETACH, PW_DFU_ON_DNLOAD, PW_DFU_ON_DNLOAD_END, PW_DFU_ON_UPLOAD, PW_DFU_ON_UPLOAD_END,
    PW_DFU_ON_GETSTATUS, PW_DFU_ON_GETSTATUS_BUSY, PW_DFU_ON_CLRSTATUS, PW_DFU_ON_GETSTATE, PW_DFU_ON_ABORT,
    PW_DFU_ON_REFUSED, /* any other request, and those that are refused */
    PW_DFU_ON_REATTACHED, PW_DFU_ON_POLL_TIMEOUT, PW_DFU_ON_FAILURE, PW_DFU_ON_BUS_RESET
};
/* The state that follows (enum pw_dfu_state), and whether the request is answered with STALL. */
uint8_t pw_dfu_after(uint8_t state, enum pw_dfu_event event, bool *stalls);
/* Whether the device works, and answers nothing before the poll time-out. */
bool pw_dfu_is_busy(uint8_t state);

#endif
