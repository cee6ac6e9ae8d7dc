/* Chapter DFU: states and events (DFU-006). */
#include "dfu_states.h"

struct drawn {
    uint8_t state, event, next;
};

static const struct drawn drawn[] = {
    { PW_DFU_APP_IDLE, PW_DFU_ON_DETACH, PW_DFU_APP_DETACH },
    { PW_DFU_APP_DETACH, PW_DFU_ON_REATTACHED, PW_DFU_IDLE },
    { PW_DFU_APP_DETACH, PW_DFU_ON_BUS_RESET, PW_DFU_IDLE },
    { PW_DFU_IDLE, PW_DFU_ON_ABORT, PW_DFU_IDLE },
    { PW_DFU_IDLE, PW_DFU_ON_DNLOAD, PW_DFU_DNLOAD_SYNC },
    { PW_DFU_IDLE, PW_DFU_ON_UPLOAD, PW_DFU_UPLOAD_IDLE },
    { PW_DFU_IDLE, PW_DFU_ON_UPLOAD_END, PW_DFU_UPLOAD_IDLE },
    { PW_DFU_DNLOAD_SYNC, PW_DFU_ON_GETSTATUS_BUSY, PW_DFU_DNBUSY },
    { PW_DFU_DNLOAD_SYNC, PW_DFU_ON_GETSTATUS, PW_DFU_DNLOAD_IDLE },
    { PW_DFU_DNBUSY, PW_DFU_ON_POLL_TIMEOUT, PW_DFU_DNLOAD_SYNC },
    { PW_DFU_DNLOAD_IDLE, PW_DFU_ON_DNLOAD, PW_DFU_DNLOAD_SYNC },
    { PW_DFU_DNLOAD_IDLE, PW_DFU_ON_DNLOAD_END, PW_DFU_MANIFEST_SYNC },
    { PW_DFU_DNLOAD_IDLE, PW_DFU_ON_ABORT, PW_DFU_IDLE },
    { PW_DFU_MANIFEST_SYNC, PW_DFU_ON_GETSTATUS_BUSY, PW_DFU_MANIFEST },
    { PW_DFU_MANIFEST_SYNC, PW_DFU_ON_GETSTATUS, PW_DFU_IDLE },
    { PW_DFU_MANIFEST, PW_DFU_ON_POLL_TIMEOUT, PW_DFU_MANIFEST_SYNC },
    { PW_DFU_UPLOAD_IDLE, PW_DFU_ON_UPLOAD, PW_DFU_UPLOAD_IDLE },
    { PW_DFU_UPLOAD_IDLE, PW_DFU_ON_UPLOAD_END, PW_DFU_IDLE },
    { PW_DFU_UPLOAD_IDLE, PW_DFU_ON_ABORT, PW_DFU_IDLE },
    { PW_DFU_ERROR, PW_DFU_ON_CLRSTATUS, PW_DFU_IDLE }
};

bool pw_dfu_is_busy(uint8_t state)
{
    return (state == (uint8_t)PW_DFU_DNBUSY) || (state == (uint8_t)PW_DFU_MANIFEST);
}

static bool is_question(enum pw_dfu_event event)
{
    return (event == PW_DFU_ON_GETSTATUS) || (event == PW_DFU_ON_GETSTATUS_BUSY) || (event == PW_DFU_ON_GETSTATE);
}

/* The arrows that are not drawn state by state. */
static uint8_t not_drawn(uint8_t state, enum pw_dfu_event event, bool *stalls)
{
    const bool dfu_mode = state >= (uint8_t)PW_DFU_IDLE;
    const bool waits = pw_dfu_is_busy(state) || (state == (uint8_t)PW_DFU_MANIFEST_WAIT_RESET);
    uint8_t next = state;
    if (event == PW_DFU_ON_FAILURE) {
        next = dfu_mode ? (uint8_t)PW_DFU_ERROR : state;
    } else if (event == PW_DFU_ON_BUS_RESET) {
        next = (uint8_t)PW_DFU_APP_IDLE;
    } else if ((event > PW_DFU_ON_REFUSED) || (is_question(event) && !waits)) {
        next = state;
    } else {
        *stalls = true;
        next = dfu_mode ? (uint8_t)PW_DFU_ERROR : (uint8_t)PW_DFU_APP_IDLE;
    }
    return next;
}

uint8_t pw_dfu_after(uint8_t state, enum pw_dfu_event event, bool *stalls)
{
    const struct drawn *arrow = NULL;
    *stalls = false;
    for (size_t i = 0; i < (sizeof drawn / sizeof drawn[0]); i++) {
        if ((drawn[i].state == state) && (drawn[i].event == (uint8_t)event)) {
            arrow = &drawn[i];
        }
    }
    return (arrow != NULL) ? arrow->next : not_drawn(state, event, stalls);
}
