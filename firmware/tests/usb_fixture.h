/* A device behind its USB door for the tests: a port whose time stands still until it is told, a chain that answers at
   once, a console's line, and an empty flash. */
#ifndef USB_FIXTURE_H
#define USB_FIXTURE_H

#include "check.h"
#include "dfu.h"
#include "ser.h"
#include "sums.h"
#include "usb.h"

#define ANSWERS 16u

static struct pw_device device;
static struct pw_line line;
static struct pw_dfu dfu;
static struct pw_usb usb;
static uint64_t now;                          /* tick of the port */
static uint8_t answers[ANSWERS][PW_MESSAGE];  /* of the chain */
static uint8_t answer_sizes[ANSWERS];
static uint32_t answer_count;
static uint8_t in[PW_USB_CONTROL];            /* of the last request */
static uint8_t packet[PW_USB_PACKET];         /* of the last packet in */
static uint32_t number;                       /* of the last block */
static uint16_t wiring[PW_CHANNELS];

static uint64_t port_now(void *self)
{
    (void)self;
    return now;
}

static bool port_chain(void *self, const uint8_t *message, size_t size)
{
    (void)self;
    (void)size;
    size_t length = 0;
    if (answer_count == ANSWERS) {
        return true; /* a long time has passed in one step: nobody fetches them */
    }
    uint8_t *answer = answers[answer_count];
    if (message[2] == PW_END_NUMBER) {
        struct pw_identity identity = {message[3], message[3] == PW_PROCESSORS - 1u ? 1u : 0u, {1, 2, 3}, {0}};
        length = pw_identity_put(answer, &identity);
    }
    if (message[2] == PW_END_COLLECT && message[3] == PW_END_REPORT) {
        struct pw_report report = {.processor = message[1], .temperature_c = 30, .firmware = {1, 2, 3}};
        length = pw_report_put(answer, &report);
    }
    if (message[2] == PW_END_COLLECT && message[3] == PW_END_PLAYING) {
        struct pw_playing playing = {.processor = message[1]};
        length = pw_playing_put(answer, &playing);
    }
    if (length != 0u) {
        answer_sizes[answer_count] = (uint8_t)length;
        answer_count++;
    }
    return true;
}

static void port_sync(void *self)
{
    (void)self;
}

static void port_identify(void *self, uint8_t board)
{
    (void)self;
    (void)board;
}

static bool port_flash_read(void *self, uint32_t address, uint8_t *data, size_t size)
{
    (void)self;
    (void)address;
    memset(data, 0xFF, size);
    return true;
}

static bool port_flash_erase(void *self, uint32_t address)
{
    (void)self;
    (void)address;
    return true;
}

static bool port_flash_program(void *self, uint32_t address, const uint8_t *data, size_t size)
{
    (void)self;
    (void)address;
    (void)data;
    (void)size;
    return true;
}

static bool port_flash_busy(void *self)
{
    (void)self;
    return false;
}

static const struct pw_port port = {
    .now = port_now,
    .chain = port_chain,
    .sync = port_sync,
    .identify = port_identify,
    .flash_read = port_flash_read,
    .flash_erase = port_flash_erase,
    .flash_program = port_flash_program,
    .flash_busy = port_flash_busy,
};

/* That of the vectors. */
static const struct pw_about about = {
    {0xEF, 0xCD, 0xAB, 0x89, 0x67, 0x45, 0x23, 0x01}, {1, 2, 3}, PW_BANK_A, 0, 0x0001, "phasewire vectors", "PW-0001",
    wiring, 20, 16, 10300
};

/* Work on everything that is due until the tick `until`; the watchdog's rules hold meanwhile. */
static inline void run_until(uint64_t until)
{
    bool works = true;
    while (works) {
        /* A device that wants to leave is due for ever. */
        const uint64_t due = pw_device_leaving(&device) != PW_STAY ? PW_NEVER : pw_device_due(&device);
        works = due <= until;
        now = due > now ? (due < until ? due : until) : now;
        pw_device_poll(&device);
        while (answer_count != 0u) {
            uint8_t answer[PW_MESSAGE];
            answer_count--;
            memcpy(answer, answers[answer_count], PW_MESSAGE);
            pw_device_chain(&device, answer[2], answer + 3, answer_sizes[answer_count] - 3u);
        }
        pw_line_poll(&line, &device);
        pw_usb_poll(&usb);
    }
}

static inline void run_ms(uint32_t ms)
{
    run_until(now + (uint64_t)ms * PW_TICKS_PER_MS);
}

static inline void begin(bool high_speed, bool dfu_mode)
{
    const struct pw_boot running = {0};
    now = 1000;
    answer_count = 0;
    number = 0;
    for (uint32_t i = 0; i < PW_CHANNELS; i++) {
        wiring[i] = (uint16_t)i;
    }
    memset(&usb, 0, sizeof usb); /* polled before it is begun */
    pw_device_begin(&device, &port, &about);
    pw_line_begin(&line, PW_DOOR_LINE(0), false);
    pw_dfu_begin(&dfu, &port, &running);
    run_ms(1);
    CHECK(pw_device_serving(&device));
    pw_usb_begin(&usb, &device, &line, &dfu, &about, high_speed, dfu_mode);
    pw_usb_bus_reset(&usb);
}

static inline struct pw_setup setup_of(const uint8_t bytes[8])
{
    const struct pw_setup setup = {bytes[0], bytes[1], pw_get16(bytes + 2), pw_get16(bytes + 4), pw_get16(bytes + 6)};
    return setup;
}

/* A request without data out; waits for an answer that comes later. */
static inline int request(uint8_t type, uint8_t code, uint16_t value, uint16_t index, uint16_t length)
{
    const struct pw_setup setup = {type, code, value, index, length};
    memset(in, 0xEE, sizeof in);
    int answer = pw_usb_control(&usb, &setup, NULL, in);
    for (uint32_t i = 0; i < 1000u && answer == PW_USB_NAK; i++) {
        run_until(now + PW_TICKS);
        answer = pw_usb_control_again(&usb, in);
    }
    CHECK(answer <= (int)length);
    CHECK(answer < 0 || in[answer] == 0xEEu || answer == (int)length || length > PW_ANSWER);
    return answer;
}

static inline int set_configuration(uint16_t value)
{
    return request(0x00, 9, value, 0, 0);
}

/* Configured, in state OFF. */
static inline void begin_configured(bool high_speed)
{
    begin(high_speed, false);
    CHECK_EQ(set_configuration(1), 0);
}

static inline int ask(enum pw_request_code code, uint16_t value)
{
    return request(PW_REQUEST_OUT, (uint8_t)code, value, 0, 0);
}

static inline uint8_t state(void)
{
    CHECK_EQ(request(PW_REQUEST_IN, PW_REQ_STATUS, 0, 0, 64), 64);
    return in[3];
}

/* A block with the next number. */
static inline void make_block(uint8_t block[PW_BLOCK], uint8_t kind, uint64_t period)
{
    memset(block, 0, PW_BLOCK);
    number++;
    block[0] = 'P';
    block[1] = 'W';
    block[2] = 1;
    block[3] = kind;
    pw_put32(block + 4, number);
    pw_put64(block + 8, period);
    pw_put32(block + 28, pw_crc32(0, block, PW_BLOCK));
}

/* Bytes on 01 OUT in largest packets, a short one last if need be; 0, or what stopped it. */
static inline int send_bytes(const uint8_t *bytes, size_t size)
{
    size_t at = 0;
    int answer = 0;
    while (at < size && answer == 0) {
        const size_t most = pw_usb_packet(&usb);
        const size_t length = size - at < most ? size - at : most;
        answer = pw_usb_out(&usb, PW_USB_BLOCKS, bytes + at, length);
        at += length;
    }
    return answer;
}

static inline int send_block(uint8_t kind, uint64_t period)
{
    uint8_t block[PW_BLOCK];
    make_block(block, kind, period);
    return send_bytes(block, PW_BLOCK);
}

static inline int read_packet(uint8_t endpoint)
{
    memset(packet, 0xEE, sizeof packet);
    return pw_usb_in(&usb, endpoint, packet, sizeof packet);
}

/* Reads 81 IN until it answers NAK; returns how many acknowledgements there were. `last` is the reason of the last. */
static inline uint32_t drain(uint8_t *last)
{
    uint32_t count = 0;
    for (int size = read_packet(PW_USB_RECORDS); size >= 0; size = read_packet(PW_USB_RECORDS)) {
        for (size_t at = 0; at < (size_t)size; at += packet[at + 1u] == 'A' ? PW_ACK : PW_STATUS) {
            if (packet[at + 1u] == 'A') {
                count++;
                *last = packet[at + 3u];
            }
        }
    }
    return count;
}

#endif
