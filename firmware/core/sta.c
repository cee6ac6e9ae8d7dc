/* Chapter STA: the table of STA-003, by state and event. */
#include "sta.h"

#include <stdint.h>

#define STATES 7u
#define EVENTS 13u

/* The state that follows plus 1, so that 0, what is not named, means no transition. */
#define TO(state) ((uint8_t)((unsigned)(state) + 1u))

static const uint8_t followers[STATES][EVENTS] = {
    [PW_STATE_OFF] = {
        [PW_EVENT_ENABLE] = TO(PW_STATE_READY),
        [PW_EVENT_SUSPEND] = TO(PW_STATE_SUSPENDED),
        [PW_EVENT_FAULT] = TO(PW_STATE_FAULT),
        [PW_EVENT_DETACH] = TO(PW_STATE_DFU),
        [PW_EVENT_RESTART] = TO(PW_STATE_OFF),
    },
    [PW_STATE_READY] = {
        [PW_EVENT_PLAY] = TO(PW_STATE_PLAYING),
        [PW_EVENT_PLAY_UNATTENDED] = TO(PW_STATE_UNATTENDED),
        [PW_EVENT_DISABLE] = TO(PW_STATE_OFF),
        [PW_EVENT_WATCHDOG] = TO(PW_STATE_OFF),
        [PW_EVENT_BUS_RESET] = TO(PW_STATE_OFF),
        [PW_EVENT_SUSPEND] = TO(PW_STATE_SUSPENDED),
        [PW_EVENT_FAULT] = TO(PW_STATE_FAULT),
        [PW_EVENT_DETACH] = TO(PW_STATE_DFU),
        [PW_EVENT_RESTART] = TO(PW_STATE_OFF),
    },
    [PW_STATE_PLAYING] = {
        [PW_EVENT_PLAY_UNATTENDED] = TO(PW_STATE_UNATTENDED),
        [PW_EVENT_END] = TO(PW_STATE_READY),
        [PW_EVENT_DISABLE] = TO(PW_STATE_OFF),
        [PW_EVENT_WATCHDOG] = TO(PW_STATE_OFF),
        [PW_EVENT_BUS_RESET] = TO(PW_STATE_OFF),
        [PW_EVENT_SUSPEND] = TO(PW_STATE_SUSPENDED),
        [PW_EVENT_FAULT] = TO(PW_STATE_FAULT),
        [PW_EVENT_DETACH] = TO(PW_STATE_DFU),
        [PW_EVENT_RESTART] = TO(PW_STATE_OFF),
    },
    [PW_STATE_UNATTENDED] = { /* neither the watchdog nor suspend ends it: SAF-005 */
        [PW_EVENT_PLAY] = TO(PW_STATE_PLAYING),
        [PW_EVENT_END] = TO(PW_STATE_READY),
        [PW_EVENT_DISABLE] = TO(PW_STATE_OFF),
        [PW_EVENT_BUS_RESET] = TO(PW_STATE_OFF),
        [PW_EVENT_FAULT] = TO(PW_STATE_FAULT),
        [PW_EVENT_DETACH] = TO(PW_STATE_DFU),
        [PW_EVENT_RESTART] = TO(PW_STATE_OFF),
    },
    [PW_STATE_FAULT] = {
        [PW_EVENT_CLEAR] = TO(PW_STATE_OFF),
        [PW_EVENT_DETACH] = TO(PW_STATE_DFU),
        [PW_EVENT_RESTART] = TO(PW_STATE_OFF),
    },
    [PW_STATE_SUSPENDED] = {
        [PW_EVENT_RESUME] = TO(PW_STATE_OFF),
        [PW_EVENT_BUS_RESET] = TO(PW_STATE_OFF),
        [PW_EVENT_FAULT] = TO(PW_STATE_FAULT),
        [PW_EVENT_RESTART] = TO(PW_STATE_OFF),
    },
    [PW_STATE_DFU] = {
        [PW_EVENT_RESTART] = TO(PW_STATE_OFF),
    },
};

bool pw_state_allows(enum pw_state state, enum pw_event event)
{
    return ((unsigned)state < STATES) && ((unsigned)event < EVENTS) && (followers[state][event] != 0u);
}

enum pw_state pw_state_after(enum pw_state state, enum pw_event event)
{
    enum pw_state next = state;
    if (pw_state_allows(state, event)) {
        next = (enum pw_state)(followers[state][event] - 1u);
    }
    return next;
}

bool pw_state_enabled(enum pw_state state)
{
    return (state == PW_STATE_READY) || (state == PW_STATE_PLAYING) || (state == PW_STATE_UNATTENDED);
}
