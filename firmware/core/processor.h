/* One processor of the chain: messages in, the words of its port out (chapter CHN). It drives 32 outputs.
   A board's interrupt calls pw_processor_period at each period boundary. Calls for messages come from the same
   priority, or keep that interrupt out meanwhile: nothing guards against two calls at once. */
#ifndef PW_PROCESSOR_H
#define PW_PROCESSOR_H

#include "chn.h"
#include "pul.h"

#define PW_NO_NUMBER 0xFFu

/* What plays. */
struct pw_play {
    uint64_t since; /* the period from which these pulses play */
    uint8_t slice[PW_SLICE];
    bool sequence; /* whether it is a sequence */
    struct pw_program sequence_program;
    uint32_t sequence_item, sequence_repeat, sequence_left;
    bool modulation;
    struct pw_program modulation_program;
    uint32_t modulation_item, modulation_left;
    uint8_t sample;
};

struct pw_processor {
    /* What it is. */
    uint8_t firmware[3];
    uint8_t unique_id[8];
    uint8_t number; /* PW_NO_NUMBER before NUMBER */
    int8_t temperature_c;
    /* The mailbox, and the slice that waits for its period (CHN-004, CHN-007). */
    bool has_mail;
    uint8_t mail[PW_SLICE];
    bool waits;
    uint64_t waits_period;
    uint8_t waits_slice[PW_SLICE];
    /* Programs that wait: of the sequence, and of the modulation (CHN-014). Each has the order in which it came. */
    bool program_waits[2];
    struct pw_program program[2];
    bool commit_came_last;
    /* What plays in the period that has begun, and what would without the changes that began with it. */
    uint64_t period;
    uint8_t began;        /* changes that began with it */
    bool commit_began;    /* one of them was a commit */
    struct pw_play plays, before;
    /* Stores. */
    uint8_t slots[PW_SLOTS][PW_SLICE];
    uint8_t entries[PW_ENTRIES][4];
    uint8_t samples[PW_SAMPLES];
    /* Reports. */
    uint16_t lasting_faults; /* enum pw_fault, whose cause lasts */
    uint16_t event_faults;   /* CHAIN and OVERRUN since the report before, and what may have come and gone since */
    int8_t drift;
    uint32_t carried_out, missed_commits, damaged_messages;
    /* Time. */
    uint64_t last_collect; /* period */
    bool synced;
    uint64_t last_sync; /* tick at which the last pulse of the sync line was due */
    /* Words of the port, and whether they differ from those of the period before. */
    bool stale;
    bool again; /* they were not ready: make them anew in the next period */
    uint32_t words[PW_TICKS];
};

void pw_processor_begin(struct pw_processor *self, const uint8_t firmware[3], const uint8_t unique_id[8]);
/* A message without its route header and END. Writes an answer to the controller, route header first, and returns its
   size, or 0. `last` says whether nothing is linked behind this processor (CHN-022). */
size_t pw_processor_message(struct pw_processor *self, uint8_t channel_end, const uint8_t *body, size_t size, bool last,
                            uint8_t answer[PW_MESSAGE]);
/* A period begins. Returns whether its words differ from those of the period before. */
bool pw_processor_period(struct pw_processor *self, uint64_t period);
/* The words of the period that has begun could not be ready: the port plays those of the period before (SAF-008). Not
   for words that are all 0, which a port needs not wait for. Call it before the next message and the next period. */
void pw_processor_overrun(struct pw_processor *self);
/* What the board measures: its temperature, and the supply of its output amplifiers (SAF-008). */
void pw_processor_sensors(struct pw_processor *self, int8_t temperature_c, uint16_t supply_mv);
/* A pulse on the sync line, at a tick of this processor's own count; the first one is at tick 0 (CHN-027). */
void pw_processor_sync(struct pw_processor *self, uint64_t tick);

#endif
