/* Chapter REQ: control requests, the same for USB and serial lines. */
#include "device_parts.h"

#include <string.h>

#define CARRIER_HZ 40000u
#define HARDWARE_FIVE_BOARDS 1u /* FWU-005 */
#define INFO_BYTES 64u
#define CLOCK_BYTES 24u
#define REPORT_BYTES 16u
#define WATCHDOG_LEAST_MS 10u /* REQ-009 */
#define WATCHDOG_MOST_MS 60000u

static const uint8_t NO_REPORT[REPORT_BYTES] = {PW_FAULT_PROCESSOR};

static bool has(uint16_t feature)
{
    return (PW_FEATURES & feature) != 0u;
}

static void put_info(const struct pw_device *self, uint8_t *to)
{
    const struct pw_about *about = self->about;
    memset(to, 0, INFO_BYTES);
    to[0] = 1;
    to[1] = 1;
    pw_put16(to + 2, HARDWARE_FIVE_BOARDS);
    memcpy(to + 4, about->firmware, 3);
    to[7] = PW_BOARDS;
    memcpy(to + 8, about->unique_id, 8);
    pw_put32(to + 16, CARRIER_HZ);
    pw_put16(to + 20, PW_FEATURES);
    pw_put16(to + 22, PW_CHANNELS);
    to[24] = about->columns;
    to[25] = about->rows;
    pw_put16(to + 26, about->pitch_um);
    to[28] = PW_PROCESSORS / PW_BOARDS;
    to[29] = PW_TICKS;
    to[30] = PW_WIDTHS - 1u;
    to[31] = PW_TWO_WIRES ? 2u : 5u;
    to[32] = 2; /* core cycles per symbol, at best: BUD-002 */
    to[33] = PW_QUEUE_CHANGES;
    pw_put16(to + 34, PW_PERIODS_PER_UPDATE);
    pw_put16(to + 36, PW_QUEUE_RECORDS);
    pw_put16(to + 38, has(PW_HAS_SEQUENCES) ? PW_SLOTS : 0u);
    pw_put16(to + 40, has(PW_HAS_SEQUENCES) ? PW_ENTRIES : 0u);
    pw_put16(to + 42, has(PW_HAS_MODULATION) ? PW_SAMPLES : 0u);
    pw_put16(to + 44, PW_DRIVE_LIMIT);
    pw_put16(to + 46, PW_WATCHDOG_MS);
}

void pw_device_status(struct pw_device *self, struct pw_status *status)
{
    memset(status, 0, sizeof *status);
    status->state = (uint8_t)self->state;
    status->faults = self->faults;
    status->last_refusal = self->last_refusal;
    status->flags = (uint8_t)((self->watchdog_fired ? PW_WATCHDOG_FIRED : 0)
                              | (self->plays_sequence ? PW_SEQUENCE_PLAYS : 0)
                              | (self->modulates ? PW_MODULATION_PLAYS : 0));
    status->now = self->now;
    status->since_period = self->since_period;
    status->accepted = self->accepted;
    status->refused = self->refused;
    status->late = self->late;
    status->lost = self->lost;
    status->free = pw_free_places(self);
    status->temperature_c = INT8_MIN;
    status->watchdog_ms = self->watchdog_ms;
    status->drive_limit = self->drive_limit;
    status->dropped_frames = self->dropped_frames;
    bool any = false;
    for (uint32_t i = 0; i < PW_PROCESSORS; i++) {
        const struct pw_report *report = &self->processors[i].report;
        if (self->processors[i].known) {
            any = true;
            status->missed_commits += report->missed_commits;
            status->damaged_messages += report->damaged_messages;
            if (report->temperature_c > status->temperature_c) {
                status->temperature_c = report->temperature_c;
            }
        }
    }
    status->temperature_c = any ? status->temperature_c : 0;
}

static void put_clock(const struct pw_device *self, uint8_t *to)
{
    memset(to, 0, CLOCK_BYTES);
    pw_put64(to, self->now);
    pw_put64(to + 8, self->sync_period);
    pw_put32(to + 16, self->sync_pulses);
}

static void put_processors(const struct pw_device *self, uint8_t *to)
{
    for (uint32_t i = 0; i < PW_PROCESSORS; i++) {
        uint8_t *at = to + i * REPORT_BYTES;
        const struct pw_processor_state *processor = &self->processors[i];
        const struct pw_report *report = &processor->report;
        memcpy(at, NO_REPORT, REPORT_BYTES);
        if (processor->there) {
            pw_put16(at, report->faults);
            at[2] = (uint8_t)report->temperature_c;
            at[3] = self->about->bank;
            pw_put32(at + 4, report->missed_commits);
            pw_put32(at + 8, report->damaged_messages);
            memcpy(at + 12, report->firmware, 3);
        }
    }
}

/* Requests that answer ----------------------------------------------------------------------------------------- */

static enum pw_answer answer_of(struct pw_device *self, uint8_t door, const struct pw_setup *setup, uint8_t *answer,
                                uint16_t *size)
{
    struct pw_status status;
    if (setup->value != 0u) {
        return PW_STALLED;
    }
    switch (setup->request) {
    case PW_REQ_INFO:
        put_info(self, answer);
        *size = INFO_BYTES;
        break;
    case PW_REQ_STATUS:
        self->last_sign = self->now;
        pw_device_status(self, &status);
        pw_status_put(answer, &status);
        *size = PW_STATUS;
        break;
    case PW_REQ_WIRING:
        for (uint32_t i = 0; i < PW_CHANNELS; i++) {
            pw_put16(answer + 2u * (size_t)i, self->about->wiring[i]);
        }
        *size = PW_ANSWER;
        break;
    case PW_REQ_CLOCK:
        put_clock(self, answer);
        *size = CLOCK_BYTES;
        break;
    case PW_REQ_PROCESSORS:
        put_processors(self, answer);
        *size = PW_PROCESSORS * REPORT_BYTES;
        break;
    case PW_REQ_PULSES:
        if (!has(PW_HAS_READ_BACK) || self->reading) {
            return PW_STALLED;
        }
        pw_begin_reading(self, door, setup->length);
        return PW_LATER;
    default:
        return PW_STALLED;
    }
    *size = *size < setup->length ? *size : setup->length;
    return PW_ANSWERED;
}

/* Requests that are carried out -------------------------------------------------------------------------------- */

static bool enable(struct pw_device *self, uint8_t door)
{
    if (pw_state_enabled(self->state)) {
        self->last_sign = self->now; /* a sign of life and no more: REQ-005 */
        return true;
    }
    if (!pw_state_allows(self->state, PW_EVENT_ENABLE)) {
        return false;
    }
    pw_event(self, PW_EVENT_ENABLE, door);
    return true;
}

static bool set_limit(struct pw_device *self, uint16_t value)
{
    if (value > PW_DRIVE_LIMIT || pw_state_enabled(self->state)) {
        return false;
    }
    self->drive_limit = value;
    return true;
}

static bool set_watchdog(struct pw_device *self, uint16_t value)
{
    if (value < WATCHDOG_LEAST_MS || value > WATCHDOG_MOST_MS) {
        return false;
    }
    self->watchdog_ms = value;
    return true;
}

static bool identify(const struct pw_device *self, uint16_t board)
{
    if (board >= PW_BOARDS) {
        return false;
    }
    self->port->identify(self->port->self, (uint8_t)board);
    return true;
}

static bool leave(struct pw_device *self, enum pw_leave how)
{
    self->leaving = how;
    self->leave_at = self->now + PW_TICKS_PER_MS; /* the answer goes first */
    return true;
}

static bool carry_out(struct pw_device *self, uint8_t door, const struct pw_setup *setup)
{
    const bool has_value = setup->request == PW_REQ_WATCHDOG || setup->request == PW_REQ_LIMIT
        || setup->request == PW_REQ_IDENTIFY;
    if (setup->length != 0u || (setup->value != 0u && !has_value)) {
        return false;
    }
    switch (setup->request) {
    case PW_REQ_ENABLE:
        return enable(self, door);
    case PW_REQ_DISABLE:
        pw_event(self, PW_EVENT_DISABLE, door);
        return true;
    case PW_REQ_WATCHDOG:
        return set_watchdog(self, setup->value);
    case PW_REQ_LIMIT:
        return set_limit(self, setup->value);
    case PW_REQ_CLEAR_FAULTS:
        pw_clear_faults(self, door);
        return true;
    case PW_REQ_IDENTIFY:
        return identify(self, setup->value);
    case PW_REQ_RESET:
        return leave(self, PW_LEAVE_RESET);
    case PW_REQ_REVERT:
        return has(PW_HAS_REVERT) && leave(self, PW_LEAVE_REVERT);
    default:
        return false;
    }
}

enum pw_answer pw_device_request(struct pw_device *self, uint8_t door, const struct pw_setup *setup, uint8_t *answer,
                                 uint16_t *answer_size)
{
    *answer_size = 0;
    pw_device_poll(self);
    if (setup->index != 0u) {
        return PW_STALLED;
    }
    if (setup->type == PW_REQUEST_IN) {
        return answer_of(self, door, setup, answer, answer_size);
    }
    if (setup->type == PW_REQUEST_OUT) {
        return carry_out(self, door, setup) ? PW_ANSWERED : PW_STALLED;
    }
    return PW_STALLED;
}

void pw_device_dropped_frame(struct pw_device *self)
{
    self->dropped_frames++;
}
