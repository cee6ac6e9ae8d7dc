/* The rest of a block's way through the reference device (firmware/core/num.c), with the work that the sorting threads do
   taken out: it is judged against the device's state, planned, and acknowledged. */
#include <string.h>

#include "ack.h"
#include "device.h"
#include "pul.h"

extern const uint8_t block[PW_BLOCK];
extern const uint16_t wiring[PW_CHANNELS];
extern uint8_t record[PW_ACK];

struct pw_device device;
static struct pw_about about;

/* A device that plays, at a time of some hours. */
void plan_prepare(void)
{
    about.wiring = wiring;
    device.about = &about;
    device.now = 0x123456789Au;
    device.worked = device.now / PW_TICKS;
    device.last_period = device.worked + 2u;
    device.state = PW_STATE_PLAYING;
    device.drive_limit = PW_DRIVE_LIMIT;
    device.sequence_ends = UINT64_MAX;
    device.any_number = true;
}

void plan(void)
{
    struct pw_ack ack;
    pw_device_block(&device, 0, block, PW_BLOCK, device.now, &ack);
    pw_ack_put(record, &ack);
}
