#include "idle.h"

#include "device_parts.h"

#define SYNC_PULSES 25u /* in IDLE_TICKS */

static bool processor_rests(const struct pw_processor *processor)
{
    const struct pw_play *plays = &processor->plays;
    return !processor->waits && !processor->program_waits[0] && !processor->program_waits[1] && !plays->sequence
        && !plays->modulation && pw_all_zero(plays->slice, PW_SLICE);
}

static bool device_rests(const struct pw_device *device)
{
    const bool asks = device->serving && !device->broken && pw_all_there(device);
    const bool plans = device->change_count != 0u || device->store_count != 0u || device->reading;
    return asks && !plans && !device->plays && !device->modulates && !pw_state_enabled(device->state)
        && device->leaving == PW_STAY;
}

bool idle_is(const struct pw_device *device, const struct boards *boards)
{
    bool rests = device_rests(device) && boards->begun && boards->faults->count == 0u
        && boards_message_due(boards) == PW_NEVER && !boards->down.route.open && !boards->up.route.open;
    for (uint32_t i = 0; i < PW_PROCESSORS; i++) {
        rests = rests && processor_rests(&boards->processors[i]) && device->processors[i].asked_again <= device->now;
    }
    return rests;
}

uint64_t idle_skip(struct pw_device *device, struct boards *boards, uint64_t most)
{
    const uint64_t times = most / IDLE_TICKS;
    const uint64_t ticks = times * IDLE_TICKS;
    const uint64_t periods = ticks / PW_TICKS;
    device->now += ticks;
    device->worked += periods;
    device->collect_at += ticks;
    device->sync_period += periods;
    device->sync_pulses += (uint32_t)(times * SYNC_PULSES);
    boards->period += periods;
    for (uint32_t i = 0; i < PW_PROCESSORS; i++) {
        boards->processors[i].period += periods;
        boards->processors[i].last_collect += periods;
        boards->processors[i].last_sync += ticks;
    }
    return ticks;
}
