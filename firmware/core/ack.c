/* Chapter ACK: the layouts of ACK-002 and REQ-003. */
#include "ack.h"

#include "sums.h"

void pw_ack_put(uint8_t bytes[PW_ACK], const struct pw_ack *ack)
{
    bytes[0] = 0x50;
    bytes[1] = 0x41;
    bytes[2] = 1; /* the version */
    bytes[3] = ack->reason;
    pw_put32(&bytes[4], ack->sequence);
    pw_put64(&bytes[8], ack->commit_period);
    pw_put64(&bytes[16], ack->now);
    bytes[24] = ack->flags;
    bytes[25] = ack->free;
    bytes[26] = ack->state;
    bytes[27] = 0;
    pw_put32(&bytes[28], pw_crc32(0, bytes, 28));
}

void pw_status_put(uint8_t bytes[PW_STATUS], const struct pw_status *status)
{
    bytes[0] = 0x50;
    bytes[1] = 0x53;
    bytes[2] = 1; /* the version */
    bytes[3] = status->state;
    pw_put16(&bytes[4], status->faults);
    bytes[6] = status->last_refusal;
    bytes[7] = status->flags;
    pw_put64(&bytes[8], status->now);
    pw_put64(&bytes[16], status->since_period);
    pw_put32(&bytes[24], status->accepted);
    pw_put32(&bytes[28], status->refused);
    pw_put32(&bytes[32], status->late);
    pw_put32(&bytes[36], status->lost);
    pw_put32(&bytes[40], status->missed_commits);
    pw_put32(&bytes[44], status->damaged_messages);
    bytes[48] = status->free;
    bytes[49] = (uint8_t)status->temperature_c;
    pw_put16(&bytes[50], status->watchdog_ms);
    pw_put16(&bytes[52], status->drive_limit);
    pw_put32(&bytes[54], status->dropped_frames);
    pw_put16(&bytes[58], 0);
    pw_put32(&bytes[60], pw_crc32(0, bytes, 60));
}
