/* Chapter ACK: records, as bytes. Pure functions. */
#ifndef PW_ACK_H
#define PW_ACK_H

#include "bytes.h"
#include "codes.h"
#include "config.h"

struct pw_ack {
    uint8_t reason; /* enum pw_reason */
    uint32_t sequence;
    uint64_t commit_period;
    uint64_t now;
    uint8_t flags; /* enum pw_ack_flag */
    uint8_t free;
    uint8_t state; /* enum pw_state */
};
void pw_ack_put(uint8_t bytes[PW_ACK], const struct pw_ack *ack);

/* REQ-003 */
struct pw_status {
    uint8_t state; /* enum pw_state */
    uint16_t faults; /* enum pw_fault */
    uint8_t last_refusal; /* enum pw_reason */
    uint8_t flags; /* enum pw_status_flag */
    uint64_t now;
    uint64_t since_period;
    uint32_t accepted, refused, late, lost, missed_commits, damaged_messages;
    uint8_t free;
    int8_t temperature_c;
    uint16_t watchdog_ms;
    uint16_t drive_limit;
    uint32_t dropped_frames;
};
void pw_status_put(uint8_t bytes[PW_STATUS], const struct pw_status *status);

#endif
