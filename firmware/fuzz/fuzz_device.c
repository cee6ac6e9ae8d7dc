/* Any bytes as a program for a whole device: blocks, packets, requests, bytes of the UART, events of the bus, and time.
   The sanitizers find what is broken inside; `check` looks at what a device may never do. */
#include <stdlib.h>
#include <string.h>

#include "../library/library.h"
#include "bytes.h"
#include "codes.h"
#include "config.h"
#include "ser.h"
#include "sums.h"
#include "usb.h"

#define MOST_STEPS 300u
#define MOST_TICKS 4000u       /* of one step that lets time pass */
#define BOOT_TICKS 200u
#define SILENT_PERIODS 7u      /* six of SAF-004, and the one in which it happened */

struct input {
    const uint8_t *bytes;
    size_t size;
};

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static uint8_t next(struct input *input)
{
    if (input->size == 0u) {
        return 0;
    }
    input->size--;
    return *input->bytes++;
}

static size_t fill(struct input *input, uint8_t *to, size_t most)
{
    const size_t size = most < input->size ? most : input->size;
    memcpy(to, input->bytes, size);
    input->bytes += size;
    input->size -= size;
    return size;
}

static void require(bool good)
{
    if (!good) {
        abort();
    }
}

/* A block whose magic, version and checksum are right, so that what is behind them is reached. */
static void send_block(struct machine *machine, struct input *input)
{
    static uint32_t number;
    uint8_t block[PW_BLOCK] = {'P', 'W', 1};
    block[3] = next(input) % 10u;
    number += next(input) % 8u == 0u ? 2u : 1u;
    pw_put32(block + 4, number);
    pw_put64(block + 8, next(input) % 4u == 0u ? next(input) : machine_now(machine) / PW_TICKS + next(input) % 16u);
    for (size_t i = 16; i < 24u; i += 2u) {
        block[i] = next(input);
        block[i + 1u] = next(input) % 8u == 0u ? next(input) : 0u;
    }
    block[26] = next(input) & 3u;
    block[27] = next(input) % 4u;
    (void)fill(input, block + 32, next(input));
    pw_put32(block + 28, pw_crc32(0, block, PW_BLOCK));
    (void)machine_out(machine, PW_USB_BLOCKS, block, sizeof block);
}

static void send_packet(struct machine *machine, struct input *input)
{
    uint8_t packet[PW_USB_PACKET];
    const uint8_t endpoint = next(input);
    (void)machine_out(machine, endpoint, packet, fill(input, packet, next(input) * 2u));
}

static void request(struct machine *machine, struct input *input)
{
    uint8_t setup[8] = {0};
    uint8_t answer[PW_USB_CONTROL] = {0};
    const uint8_t how = next(input);
    (void)fill(input, setup, sizeof setup);
    if (how < 128u) { /* one of the vendor's */
        setup[0] = (how & 1u) != 0u ? PW_REQUEST_IN : PW_REQUEST_OUT;
        setup[1] = (uint8_t)(how % 16u);
        pw_put16(setup + 4, 0);
        pw_put16(setup + 6, (how & 1u) != 0u ? PW_ANSWER : 0u);
    }
    if (pw_get16(setup + 6) > PW_USB_CONTROL) {
        pw_put16(setup + 6, PW_USB_CONTROL);
    }
    if ((setup[0] & 0x80u) == 0u) {
        (void)fill(input, answer, pw_get16(setup + 6));
    }
    const int size = machine_control(machine, setup, answer);
    require(size <= (int)pw_get16(setup + 6));
}

static void hear(struct machine *machine, const uint8_t *bytes, size_t size)
{
    uint8_t said[PW_USB_PACKET];
    require(machine_hear(machine, bytes, size) <= size);
    (void)machine_say(machine, said, sizeof said);
}

static void send_bytes(struct machine *machine, struct input *input)
{
    uint8_t bytes[256];
    hear(machine, bytes, fill(input, bytes, next(input)));
}

static void send_frame(struct machine *machine, struct input *input)
{
    uint8_t body[PW_BODY_MOST];
    uint8_t frame[PW_FRAME_MOST];
    const uint8_t kind = next(input) % 6u;
    const size_t size = fill(input, body, next(input) * 3u < PW_BODY_MOST ? next(input) * 2u : PW_BODY_MOST);
    hear(machine, frame, pw_frame_encode(frame, kind, body, size));
}

/* The outputs are low if they have not been enabled for long enough (STA-001). */
static void check(struct machine *machine)
{
    static const uint8_t status[8] = {PW_REQUEST_IN, PW_REQ_STATUS, 0, 0, 0, 0, PW_STATUS, 0};
    uint8_t answer[PW_USB_CONTROL] = {0};
    if (!machine_configured(machine) || machine_control(machine, status, answer) != (int)PW_STATUS) {
        return;
    }
    const uint8_t state = answer[3];
    require(state <= PW_STATE_DFU);
    require(pw_crc32(0, answer, 60) == pw_get32(answer + 60));
    if (state == PW_STATE_READY || state == PW_STATE_PLAYING || state == PW_STATE_UNATTENDED) {
        return;
    }
    machine_run(machine, machine_now(machine) + SILENT_PERIODS * PW_TICKS);
    uint32_t words[PW_TICKS * PW_PROCESSORS];
    const uint64_t period = (machine_now(machine) - machine_origin(machine)) / PW_TICKS;
    if (period > 0u && machine_words(machine, period - 1u, 1, words)) {
        for (size_t i = 0; i < PW_TICKS * PW_PROCESSORS; i++) {
            require(words[i] == 0u);
        }
    }
}

static void step(struct machine *machine, struct input *input)
{
    uint8_t packet[PW_USB_PACKET];
    switch (next(input) % 12u) {
    case 0:
    case 1:
    case 2:
        send_block(machine, input);
        break;
    case 3:
        send_packet(machine, input);
        break;
    case 4:
    case 5:
        request(machine, input);
        break;
    case 6:
        send_bytes(machine, input);
        break;
    case 7:
        send_frame(machine, input);
        break;
    case 8:
        machine_bus(machine, next(input) % 3u);
        break;
    case 9:
        check(machine);
        break;
    case 10:
        require(machine_in(machine, next(input), packet) <= (int)sizeof packet);
        break;
    default:
        machine_run(machine, machine_now(machine) + next(input) * 256u % MOST_TICKS);
        break;
    }
    while (machine_attached(machine) && machine_in(machine, PW_USB_RECORDS, packet) > 0) {
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static const uint8_t configure[8] = {0, 9, 1, 0, 0, 0, 0, 0};
    uint8_t answer[PW_USB_CONTROL] = {0};
    uint16_t wiring[PW_CHANNELS];
    struct input input = {data, size};
    for (uint16_t i = 0; i < PW_CHANNELS; i++) {
        wiring[i] = (uint16_t)((i * 7u) % PW_CHANNELS);
    }
    struct machine *machine = machine_new(wiring, "FUZZ-1", (size & 1u) == 0u);
    require(machine != NULL);
    machine_power(machine, true);
    machine_run(machine, BOOT_TICKS);
    if (machine_attached(machine)) {
        (void)machine_control(machine, configure, answer);
    }
    for (uint32_t i = 0; i < MOST_STEPS && input.size != 0u; i++) {
        if (machine_attached(machine)) {
            step(machine, &input);
        } else {
            machine_run(machine, machine_now(machine) + 1000u + next(&input));
        }
    }
    machine_free(machine);
    return 0;
}
