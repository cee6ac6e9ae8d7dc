/* Messages that may take their time: loads, questions and their answers, the number; and the switch and the link behind
   (CHN-012, CHN-016, CHN-022, CHN-023, CHN-025). An answer may have to wait for links, and with it all that is here. */
#include "processor.h"

#include "hardware.h"

/* Of the switch. */
#define SWITCH_CONFIGURATION 0xC30Cu
#define NODE_ID 0x05u
#define DIMENSION_DIRECTION 0x0Cu
#define LINK_STATUS 0x20u
#define LINK_SETUP 0x80u
#define LINK_SETTINGS 0x403FFFFFu /* wide, and both delays */
#define LINK_HELLO (1u << 24)
#define LINK_CREDIT (1u << 25)
#define LINK_ENABLE (1u << 31)
#define DOWN_DIRECTION (1u << 8) /* of a link, in its status */
#define DOWN_FROM_8_TO_15 0x11111111u
enum { TOKEN_END = 1, TOKEN_ACK = 3, TOKEN_WRITEC = 0xC0, TOKEN_READC = 0xC1 };

#define LINK_MS 1000u            /* CHN-023 */
#define CRC_BEGIN 0x9226F562u    /* becomes FFFFFFFF, the begin of a CRC-32, in the 32 steps before the data comes in */
#define ANSWER_WORDS 17u

uint32_t number = UNNUMBERED_NODE;
uint32_t load_crc, program_crc, collect_crc;

static uint32_t damaged;
static uint32_t told_chain, told_overruns; /* what the last report told of */
static uint32_t link_setup;                /* of the link to the controller */
static uint32_t ms;                        /* since the start */
static bool linked;                        /* the link behind has credit */
static bool waits_for_link;                /* an identity does */
static bool identified;

/* The switch --------------------------------------------------------------------------------------------------- */

static void switch_request(uint32_t control, uint32_t node, uint32_t place)
{
    end_control(config_end, control);
    end_token(config_end, node >> 8);
    end_token(config_end, node & 0xFFu);
    end_token(config_end, config_end >> 8 & 0xFFu);
    end_token(config_end, place >> 8);
    end_token(config_end, place & 0xFFu);
}

static uint32_t switch_read(uint32_t place)
{
    switch_request(TOKEN_READC, number, place);
    end_control(config_end, TOKEN_END);
    const bool good = end_take_control(config_end) == TOKEN_ACK;
    const uint32_t value = good ? end_take_word(config_end) : 0u;
    (void)end_take_control(config_end);
    return value;
}

/* The answer goes to a node, which is the new one if the node is written. */
static void switch_write(uint32_t node, uint32_t place, uint32_t value)
{
    switch_request(TOKEN_WRITEC, node, place);
    end_word(config_end, value);
    end_control(config_end, TOKEN_END);
    (void)end_take_control(config_end);
    (void)end_take_control(config_end);
}

static void aim_at_switch(uint32_t node)
{
    end_aim(config_end, node << 16 | SWITCH_CONFIGURATION);
}

/* Channel ends of this processor send to each other: their node is part of their names. */
static void aim_at_each_other(uint32_t node)
{
    const uint32_t high = node << 16;
    end_aim(receive_play, high | (play_inbox & 0xFFFFu));
    end_aim(play_ready, high | (receive_play_ready & 0xFFFFu));
    end_aim(receive_handle, high | (handle_inbox & 0xFFFFu));
    end_aim(handle_ready, high | (receive_handle_ready & 0xFFFFu));
    end_aim(started_from, high | (started_to & 0xFFFFu));
}

/* CHN-025: the two words of directions of a node. Everything goes up before there is a number. */
static uint32_t directions(uint32_t node)
{
    uint32_t low = 0;
    for (uint32_t bit = 0; bit < 4u; bit++) {
        low |= (node >> bit & 1u) == 0u ? 1u << (4u * bit) : 0u;
    }
    return low;
}

static void take_number(uint32_t node)
{
    switch_write(number, DIMENSION_DIRECTION, directions(node));
    switch_write(number, DIMENSION_DIRECTION + 1u, DOWN_FROM_8_TO_15);
    switch_write(node, NODE_ID, node);
    aim_at_switch(node);
    aim_at_each_other(node);
    const uint32_t header = node << 8; /* its high byte, which comes first, is 0 */
    uint32_t crc = crc_byte(crc_byte(crc_byte(CRC_BEGIN, 0), node), LOAD);
    load_crc = crc;
    program_crc = ~(header | PROGRAM << 16);
    collect_crc = ~(header | COLLECT << 16);
    MEMORY_FENCE();
    number = node;
}

/* Says HELLO on the link behind, set up as that to the controller is; whether it has been answered. */
static bool say_hello(void)
{
    switch_write(number, LINK_SETUP + 1u, (link_setup & LINK_SETTINGS) | LINK_ENABLE | LINK_HELLO);
    return (switch_read(LINK_SETUP + 1u) & LINK_CREDIT) != 0u;
}

/* Answers ------------------------------------------------------------------------------------------------------ */

/* A byte that is not sent, the route header's three, and the payload, which begins with a word. */
#define HEADER 1u
#define PAYLOAD 4u

static union {
    uint32_t words[ANSWER_WORDS];
    uint8_t bytes[4u * ANSWER_WORDS];
} answer;

static void put(uint32_t at, uint32_t value)
{
    answer.bytes[PAYLOAD + at] = (uint8_t)value;
}

static void put32(uint32_t at, uint32_t value)
{
    put(at, value);
    put(at + 1u, value >> 8);
    put(at + 2u, value >> 16);
    put(at + 3u, value >> 24);
}

/* Sends a payload of some bytes, with its CRC-32 and END (CHN-010). The switch makes the header of the destination.
   Words keep up with the fastest links. */
static void send(uint32_t end, uint32_t size)
{
    answer.words[0] = CONTROLLER_NODE << 16 | end << 24; /* 00 00FF, end */
    uint32_t crc = CRC_BEGIN;
    for (uint32_t at = HEADER; at < PAYLOAD + size; at++) {
        crc = crc_byte(crc, answer.bytes[at]);
    }
    put32(size, ~crc_word(crc, 0));
    size += 4u;
    end_aim(answer_end, CONTROLLER_NODE << 16 | end << 8 | 2u);
    const uint32_t words = size / 4u;
    for (uint32_t at = 1; at <= words; at++) {
        end_word(answer_end, byte_reversed(answer.words[at]));
    }
    for (uint32_t at = words * 4u; at < size; at++) {
        end_token(answer_end, answer.bytes[PAYLOAD + at]);
    }
    end_control(answer_end, TOKEN_END);
}

static void send_report(void)
{
    lock_take(state_lock);
    const bool has_begun = (int32_t)(timer_now(handle_clock) - told.at) >= 0; /* or before and after are alike */
    const uint32_t carried_out = has_begun ? told.after.carried_out : told.before.carried_out;
    const uint32_t missed = told.missed;
    const uint32_t damaged_messages = damaged + damaged_received + told.damaged;
    const uint32_t events = told.events;
    const uint32_t overruns = told.overruns;
    uint32_t faults = told.faults;
    const uint32_t temperature = told.temperature;
    const int32_t drift = told.drift;
    lock_give(state_lock);
    /* CHAIN and OVERRUN are told once: whenever there were more of what raises them (CHN-016). */
    const uint32_t chain = missed + damaged_messages + events;
    faults |= chain != told_chain ? FAULT_CHAIN : 0u;
    faults |= overruns != told_overruns ? FAULT_OVERRUN : 0u;
    faults |= unsynced ? FAULT_SYNC : 0u;
    told_chain = chain;
    told_overruns = overruns;
    put(0, number);
    put(1, temperature);
    put(2, faults);
    put(3, 0);
    for (uint32_t at = 0; at < 3u; at++) {
        put(4u + at, firmware_version[at]);
    }
    put(7, (uint32_t)drift);
    put32(8, carried_out);
    put32(12, missed);
    put32(16, damaged_messages);
    send(REPORT, 20);
}

static void send_playing(void)
{
    lock_take(state_lock);
    const bool has_begun = (int32_t)(timer_now(handle_clock) - told.at) >= 0;
    const struct plays *plays = has_begun ? &told.after : &told.before;
    const uint64_t since = plays->since;
    const uint32_t *slice = plays->slice;
    lock_give(state_lock);
    put(0, number);
    put32(1, (uint32_t)since);
    put32(5, (uint32_t)(since >> 32));
    for (uint32_t at = 0; at < SLICE_WORDS; at++) {
        put32(9u + 4u * at, slice[at]);
    }
    send(PLAYING, 57);
}

static void send_identity(void)
{
    waits_for_link = false;
    identified = true;
    put(0, number);
    put(1, linked && number != PROCESSORS - 1u ? 0 : 1);
    for (uint32_t at = 0; at < 3u; at++) {
        put(2u + at, firmware_version[at]);
    }
    put32(5, unique_id[0]);
    put32(9, unique_id[1]);
    send(IDENTITY, 13);
}

/* Messages ----------------------------------------------------------------------------------------------------- */

static void copy_words(uint32_t *to, const uint32_t *from, uint32_t count)
{
    for (uint32_t at = 0; at < count; at++) {
        to[at] = from[at];
    }
}

static void copy_bytes(uint8_t *to, const uint8_t *from, uint32_t count)
{
    for (uint32_t at = 0; at < count; at++) {
        to[at] = from[at];
    }
}

/* Whether the rest of the 48 bytes, from one of them on, is 0 (CHN-012). */
static bool rest_is_zero(const uint32_t *data, uint32_t used)
{
    uint32_t bits = 0;
    uint32_t word = used / 4u;
    if (used % 4u != 0u) {
        bits = data[word] >> (8u * (used % 4u));
        word++;
    }
    for (; word < SLICE_WORDS; word++) {
        bits |= data[word];
    }
    return bits == 0u;
}

static bool take_load(const uint32_t *body)
{
    const uint32_t memory = body[0] & 0xFFu;
    const uint32_t first = body[0] >> 8 & 0xFFFFu;
    const uint32_t count = body[0] >> 24;
    const uint32_t *data = &body[1];
    if (count == 0u) {
        return false;
    }
    switch (memory) {
    case MEMORY_SLOTS:
        if (count > 1u || first >= SLOTS) {
            return false;
        }
        slice_copy(slots[first], data);
        return true;
    case MEMORY_ENTRIES:
        if (count > SLICE_WORDS || first + count > ENTRIES || !rest_is_zero(data, 4u * count)) {
            return false;
        }
        copy_words(&entries[first], data, count);
        return true;
    case MEMORY_SAMPLES:
        if (count > 4u * SLICE_WORDS || first + count > SAMPLES || !rest_is_zero(data, count)) {
            return false;
        }
        if (first % 4u == 0u && count % 4u == 0u) {
            copy_words((uint32_t *)(void *)&samples[first], data, count / 4u);
        } else {
            copy_bytes(&samples[first], (const uint8_t *)data, count);
        }
        return true;
    default:
        return false;
    }
}

/* The receiving thread has looked at the CRC-32 and at which answer is wanted. */
static void take_question(uint32_t wanted)
{
    if (!time_runs) {
        unsynced = true; /* who asks has begun its time with a pulse that was not seen here (SAF-008) */
    }
    if (wanted == REPORT) {
        send_report();
    } else {
        send_playing();
    }
}

void handle_message(const struct message *message)
{
    const bool numbered = number != UNNUMBERED_NODE;
    if (message->kind == LOAD && numbered && take_load(message->body)) {
        return;
    }
    if (message->kind == COLLECT && numbered) {
        take_question(message->body[0]);
    } else if (message->kind == NUMBER && !numbered && message->body[0] < PROCESSORS) {
        take_number(message->body[0]);
        waits_for_link = true;
        handle_identity();
    } else {
        damaged++;
    }
}

/* Sends the identity that waits, as soon as it is known whether this processor is the last. It is known when the link
   behind has credit, when nobody has answered there for LINK_MS, and always of number 9. (CHN-023) */
void handle_identity(void)
{
    if (waits_for_link && (linked || number == PROCESSORS - 1u || ms >= LINK_MS)) {
        send_identity();
    }
}

void handle_begin(void)
{
    aim_at_switch(number);
    aim_at_each_other(number);
    link_setup = switch_read(LINK_SETUP);
    switch_write(number, DIMENSION_DIRECTION, 0);
    switch_write(number, DIMENSION_DIRECTION + 1u, 0);
    switch_write(number, LINK_STATUS + 1u, DOWN_DIRECTION);
}

/* The handling thread. */
void handle(void)
{
    const struct message *message = handle_ring;
    uint32_t time = timer_now(handle_clock);
    handle_events();
    for (;;) {
        if (handle_wait(time) == EVENT_MESSAGE) {
            signal_take(handle_inbox);
            handle_message(message);
            message = message->next;
            signal_send(handle_ready);
        } else if (linked || identified) {
            /* Nothing is left to do at a time. A quarter of the turn of the timer, 10.7 s, is well in the future. A
               time more than half a turn ahead would have passed. */
            time += 0x40000000u;
        } else {
            linked = say_hello();
            handle_identity();
            ms++;
            time += MS_TIME;
        }
    }
}
