/* What the files of the device ask of each other; doors and ports use device.h. */
#ifndef PW_DEVICE_PARTS_H
#define PW_DEVICE_PARTS_H

#include "device.h"

/* tim.c */
/* The period that it is. */
static inline uint64_t pw_period_now(const struct pw_device *self) { return self->now / PW_TICKS; }

/* saf.c: state, silence, faults */
#define PW_NO_DOOR 0xFFu
/* An event of STA-002, caused through a door or by the device itself; the other doors are told as ACK-006 says. */
void pw_event(struct pw_device *self, enum pw_event event, uint8_t door);
/* Tell all doors but one that something has changed. */
void pw_tell(struct pw_device *self, uint8_t door);
/* Drop what is queued, and order silence for the first period that can have it (SAF-004) if something plays or is on its
   way, or `again`: a processor may have missed it. */
void pw_silence(struct pw_device *self, bool again);
/* Faults have appeared; self->persisting are those whose cause lasts. */
void pw_raise_faults(struct pw_device *self, uint16_t faults);
void pw_clear_faults(struct pw_device *self, uint8_t door);
/* The tick at which the watchdog fires, PW_NEVER while it rests. */
uint64_t pw_watchdog_due(const struct pw_device *self);

/* blk_plan.c: the queue of changes, and what goes onto the chain when */
/* Whether a change travels as slices and commits; the others are programs (CHN-029). */
bool pw_has_slices(uint8_t kind, uint8_t action);
/* The first period at which a change that is judged now can take effect; it waits for the stores if it uses them. */
uint64_t pw_first_period(const struct pw_device *self, uint8_t kind, uint8_t action);
struct pw_change *pw_change_at(struct pw_device *self, uint32_t index);
/* A place behind the last change; there is room. */
struct pw_change *pw_change_add(struct pw_device *self);
/* Changes that can still be queued (BLK-024). */
uint8_t pw_free_places(const struct pw_device *self);
/* The next period with work for `pw_work_on_period`, PW_NEVER if there is none. */
uint64_t pw_period_due(const struct pw_device *self);
/* The beginning of a period: what takes effect, then what goes onto the chain. */
void pw_work_on_period(struct pw_device *self, uint64_t period);

/* blk_stores.c: slots, entries, samples, and what uses them */
enum pw_reason pw_judge_stores(const struct pw_device *self, const struct pw_block *block);
void pw_add_store(struct pw_device *self, const struct pw_block *block);
/* Note what a change uses, and what it ends. */
void pw_note_uses(struct pw_device *self, const struct pw_block *block, uint64_t period, uint64_t ends);
void pw_end_uses(struct pw_device *self, bool sequences, bool modulations, uint64_t period);
/* The first period after the last repeat of a sequence that begins at `period`; PW_NEVER without end. */
uint64_t pw_sequence_end(const struct pw_device *self, const struct pw_block *block, uint64_t period);
/* Loads that have not left. */
uint32_t pw_loads_left(const struct pw_device *self);
#define PW_LOAD_TOKENS 60u /* BUD-002 */
/* Send as many loads as `tokens` allow; returns the tokens that they take. */
uint32_t pw_send_loads(struct pw_device *self, uint32_t tokens);

/* chn_controller.c: numbering, questions, answers */
void pw_number_chain(struct pw_device *self);
/* Send a message, or find the chain broken (CHN-021). The faults of that are raised later, by pw_note_broken, for they
   change the queue that is being sent. */
void pw_send(struct pw_device *self, const uint8_t *message, size_t size);
void pw_note_broken(struct pw_device *self);
uint64_t pw_chain_due(const struct pw_device *self);
void pw_work_on_chain(struct pw_device *self);
/* Read what plays from all processors (REQ-007). */
void pw_begin_reading(struct pw_device *self, uint8_t door, uint16_t length);
#define PW_COLLECT_TOKENS 9u /* BUD-002 */
/* Whether a question of that is still to be sent. */
bool pw_asks_for_playing(const struct pw_device *self);
/* Send as many of them as `tokens` allow; returns the tokens that they take. */
uint32_t pw_ask_for_playing(struct pw_device *self, uint32_t tokens);
bool pw_all_there(const struct pw_device *self);

#endif
