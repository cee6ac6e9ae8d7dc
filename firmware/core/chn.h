/* Chapter CHN: the messages of the chain as bytes, without their END token. Pure functions.
   The route header is 3 bytes: the node, high byte first, and the channel end (CHN-002, CHN-008). */
#ifndef PW_CHN_H
#define PW_CHN_H

#include "bytes.h"
#include "codes.h"
#include "config.h"

/* Every encoder writes one whole message, route header first, and returns its size, at most PW_MESSAGE. */
size_t pw_slice_put(uint8_t *message, uint16_t node, const uint8_t pulses[PW_SLICE]);
/* `checksum` is CHN-011's: pw_commit_checksum of the slice that it commits. */
size_t pw_commit_put(uint8_t *message, uint16_t node, uint64_t period, uint32_t checksum);
uint32_t pw_commit_checksum(const uint8_t pulses[PW_SLICE], uint64_t period);

struct pw_load {
    uint8_t memory; /* enum pw_memory */
    uint16_t first;
    uint8_t count;
    uint8_t data[PW_SLICE]; /* the items, then 0 */
};
size_t pw_load_put(uint8_t *message, uint16_t node, const struct pw_load *load);

struct pw_program {
    uint8_t memory; /* PW_MEMORY_ENTRIES or PW_MEMORY_SAMPLES */
    uint16_t first;
    uint16_t count; /* 0 stops it */
    uint16_t hold;
    uint16_t repeats;
    uint64_t period;
};
size_t pw_program_put(uint8_t *message, uint16_t node, const struct pw_program *program);

size_t pw_collect_put(uint8_t *message, uint16_t node, uint8_t answer); /* PW_END_REPORT or PW_END_PLAYING */
size_t pw_number_put(uint8_t *message, uint8_t number); /* to PW_UNNUMBERED_NODE */

struct pw_report {
    uint8_t processor;
    int8_t temperature_c;
    uint16_t faults;
    uint8_t firmware[3];
    int8_t drift;
    uint32_t carried_out, missed_commits, damaged_messages;
};
size_t pw_report_put(uint8_t *message, const struct pw_report *report);

struct pw_playing {
    uint8_t processor;
    uint64_t period;
    uint8_t pulses[PW_SLICE];
};
size_t pw_playing_put(uint8_t *message, const struct pw_playing *playing);

struct pw_identity {
    uint8_t processor;
    uint8_t last;
    uint8_t firmware[3];
    uint8_t unique_id[8];
};
size_t pw_identity_put(uint8_t *message, const struct pw_identity *identity);

/* Decoders take a message without its route header and END, as a channel end receives it (the switches take the header
   off), and put in the node and channel end of the receiver for the checksum (CHN-010). They return false for a
   damaged message: its size, checksum or a field is wrong; then the value is not to be used. */
bool pw_load_get(struct pw_load *load, uint16_t node, const uint8_t *body, size_t size);
bool pw_program_get(struct pw_program *program, uint16_t node, const uint8_t *body, size_t size);
bool pw_collect_get(uint8_t *answer, uint16_t node, const uint8_t *body, size_t size);
bool pw_number_get(uint8_t *number, const uint8_t *body, size_t size);
bool pw_report_get(struct pw_report *report, const uint8_t *body, size_t size);
bool pw_playing_get(struct pw_playing *playing, const uint8_t *body, size_t size);
bool pw_identity_get(struct pw_identity *identity, const uint8_t *body, size_t size);
/* A slice has no checksum of its own: its body is its 48 bytes. A commit's body gives period and checksum. */
bool pw_commit_get(uint64_t *period, uint32_t *checksum, const uint8_t *body, size_t size);

#endif
