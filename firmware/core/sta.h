/* Chapter STA: the states of a device and what leads from one to another. Pure. */
#ifndef PW_STA_H
#define PW_STA_H

#include <stdbool.h>

#include "codes.h"

/* The state that follows (STA-003); the same one if the event has no transition there. */
enum pw_state pw_state_after(enum pw_state state, enum pw_event event);
/* Whether the event has a transition in this state. */
bool pw_state_allows(enum pw_state state, enum pw_event event);
/* Whether the outputs are enabled (STA-001). */
bool pw_state_enabled(enum pw_state state);

#endif
