/* Chapters SER and CON: what is sent on a line, and what it asks of the device. */
#include "line.h"

uint32_t pw_ring_room(const struct pw_ring *ring)
{
    return PW_LINE_BYTES - ring->used;
}

void pw_ring_put(struct pw_ring *ring, const uint8_t *bytes, size_t size)
{
    if (size > (size_t)pw_ring_room(ring)) {
        return;
    }
    for (size_t i = 0; i < size; i++) {
        ring->bytes[(ring->first + ring->used) % PW_LINE_BYTES] = bytes[i];
        ring->used++;
    }
}

enum pw_answer pw_line_ask(struct pw_line *line, struct pw_device *device, const struct pw_setup *setup,
                           uint16_t *size)
{
    const bool pulses = (setup->type == PW_REQUEST_IN) && (setup->request == (uint8_t)PW_REQ_PULSES);
    if (pulses && line->muted) {
        return PW_STALLED; /* it does nothing but answer */
    }
    line->pending_setup = *setup;
    line->pending_asked = !pulses || !device->reading;
    return line->pending_asked ? pw_device_request(device, line->door, setup, &line->answer[2], size) : PW_LATER;
}
