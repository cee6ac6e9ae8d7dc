/* Chapter CON: the data of requests as text (CON-007). */
#include "con.h"

#define FIRST_PULSE 16u /* of READ_BACK: REQ-007 */
#define REPORT 16u      /* bytes of a processor in PROCESSORS: REQ-008 */

/* How a field is written. The last ones are codes and sets of bits with names. */
enum value {
    VALUE_8, VALUE_16, VALUE_32, VALUE_64, VALUE_SIGNED, VALUE_VERSION, VALUE_UNIQUE, VALUE_HARDWARE, VALUE_STATE,
    VALUE_REASON, VALUE_BANK, VALUE_FAULTS, VALUE_FLAGS, VALUE_FEATURES
};

struct field {
    const char *key;
    uint8_t offset;
    uint8_t value; /* enum value */
};

/* REQ-002 without `later` */
static const struct field INFO[] = {
    {"oldest_version", 0, VALUE_8}, {"newest_version", 1, VALUE_8}, {"hardware", 2, VALUE_HARDWARE},
    {"firmware", 4, VALUE_VERSION}, {"boards", 7, VALUE_8}, {"unique_id", 8, VALUE_UNIQUE},
    {"carrier_hz", 16, VALUE_32}, {"features", 20, VALUE_FEATURES}, {"channels", 22, VALUE_16},
    {"columns", 24, VALUE_8}, {"rows", 25, VALUE_8}, {"pitch_um", 26, VALUE_16}, {"processors_per_board", 28, VALUE_8},
    {"ticks_per_period", 29, VALUE_8}, {"max_width_ticks", 30, VALUE_8}, {"link_wires", 31, VALUE_8},
    {"cycles_per_symbol", 32, VALUE_8}, {"queue_blocks", 33, VALUE_8}, {"periods_per_update", 34, VALUE_16},
    {"queue_records", 36, VALUE_16}, {"slots", 38, VALUE_16}, {"sequence_entries", 40, VALUE_16},
    {"modulation_samples", 42, VALUE_16}, {"drive_limit", 44, VALUE_16}, {"watchdog_ms", 46, VALUE_16},
};

static const struct field VERSION[] = {
    {"oldest_version", 0, VALUE_8}, {"newest_version", 1, VALUE_8}, {"firmware", 4, VALUE_VERSION},
};

/* REQ-003 without magic, version, reserved bytes and checksum */
static const struct field STATUS[] = {
    {"state", 3, VALUE_STATE}, {"faults", 4, VALUE_FAULTS}, {"last_refusal", 6, VALUE_REASON},
    {"flags", 7, VALUE_FLAGS}, {"now", 8, VALUE_64}, {"since_period", 16, VALUE_64}, {"accepted", 24, VALUE_32},
    {"refused", 28, VALUE_32}, {"late", 32, VALUE_32}, {"lost", 36, VALUE_32}, {"missed_commits", 40, VALUE_32},
    {"damaged_messages", 44, VALUE_32}, {"free", 48, VALUE_8}, {"temperature_c", 49, VALUE_SIGNED},
    {"watchdog_ms", 50, VALUE_16}, {"drive_limit", 52, VALUE_16}, {"dropped_frames", 54, VALUE_32},
};

static const struct field FAULTS[] = {{"faults", 4, VALUE_FAULTS}};

/* REQ-006 */
static const struct field CLOCK[] = {
    {"now", 0, VALUE_64}, {"sync_period", 8, VALUE_64}, {"sync_pulses", 16, VALUE_32},
};

/* REQ-008 */
static const struct field PROCESSOR[] = {
    {"faults", 0, VALUE_FAULTS}, {"temperature_c", 2, VALUE_SIGNED}, {"bank", 3, VALUE_BANK},
    {"missed_commits", 4, VALUE_32}, {"damaged_messages", 8, VALUE_32}, {"firmware", 12, VALUE_VERSION},
};

#define COUNT(table) (sizeof(table) / sizeof((table)[0]))

static const char *const STATE_NAMES[] = {"OFF", "READY", "PLAYING", "UNATTENDED", "FAULT", "SUSPENDED", "DFU"};
static const char *const REASON_NAMES[] = {
    "ACCEPTED", "LENGTH", "CHECKSUM", "MAGIC", "VERSION", "KIND", "FIELD", "PULSE", "UNSUPPORTED", "FAULT", "DISABLED",
    "SEQUENCE", "HORIZON", "RATE", "DRIVE", "EMPTY", "IN_USE",
};
static const char *const HARDWARE_NAMES[] = {NULL, "FIVE_BOARDS"};
static const char *const BANK_NAMES[] = {NULL, "FACTORY", "A", "B"};
static const char *const FAULT_NAMES[] = {"CHAIN", "PROCESSOR", "SYNC", "TEMPERATURE", "SUPPLY", "OVERRUN", "FLASH"};
static const char *const FLAG_NAMES[] = {"WATCHDOG_FIRED", "SEQUENCE", "MODULATION"};
static const char *const FEATURE_NAMES[] = {
    "SEQUENCES", "MODULATION", "UNATTENDED", "READ_BACK", "CONSOLE", "DFU", "REVERT",
};

/* Values ----------------------------------------------------------------------------------------------------------- */

void pw_text(struct pw_ring *out, const char *text)
{
    for (const char *at = text; *at != '\0'; at++) {
        const uint8_t byte = (uint8_t)*at;
        pw_ring_put(out, &byte, 1u);
    }
}

void pw_text_number(struct pw_ring *out, uint64_t number)
{
    uint8_t digits[20];
    size_t begin = sizeof digits;
    uint64_t rest = number;
    do {
        begin--;
        digits[begin] = (uint8_t)((uint64_t)'0' + (rest % 10u));
        rest /= 10u;
    } while (rest != 0u);
    pw_ring_put(out, &digits[begin], sizeof digits - begin);
}

/* The byte is a number in two's complement. */
static void put_signed(struct pw_ring *out, uint8_t byte)
{
    if (byte < 128u) {
        pw_text_number(out, byte);
    } else {
        pw_text(out, "-");
        pw_text_number(out, 256u - (uint64_t)byte);
    }
}

static void put_version(struct pw_ring *out, const uint8_t *numbers)
{
    pw_text_number(out, numbers[0]);
    pw_text(out, ".");
    pw_text_number(out, numbers[1]);
    pw_text(out, ".");
    pw_text_number(out, numbers[2]);
}

static void put_bytes(struct pw_ring *out, const uint8_t *bytes, size_t size)
{
    static const uint8_t DIGITS[] = {'0', '1', '2', '3', '4', '5', '6', '7', '8', '9', 'a', 'b', 'c', 'd', 'e', 'f'};
    for (size_t i = 0; i < size; i++) {
        const uint8_t pair[2] = {DIGITS[bytes[i] >> 4], DIGITS[bytes[i] & 0x0Fu]};
        pw_ring_put(out, pair, sizeof pair);
    }
}

static const char *name_of(const char *const *names, size_t count, uint32_t code)
{
    return (code < count) ? names[code] : NULL;
}

static void put_code(struct pw_ring *out, const char *const *names, size_t count, uint32_t code)
{
    const char *name = name_of(names, count, code);
    if (name != NULL) {
        pw_text(out, name);
    } else {
        pw_text_number(out, code);
    }
}

static void put_bits(struct pw_ring *out, const char *const *names, size_t count, uint32_t bits)
{
    bool any = false;
    for (size_t i = 0; i < count; i++) {
        if (((bits >> i) & 1u) != 0u) {
            pw_text(out, any ? "+" : "");
            pw_text(out, names[i]);
            any = true;
        }
    }
    pw_text(out, any ? "" : "none");
}

const char *pw_state_name(uint8_t state)
{
    return name_of(STATE_NAMES, COUNT(STATE_NAMES), state);
}

const char *pw_reason_name(uint8_t reason)
{
    return name_of(REASON_NAMES, COUNT(REASON_NAMES), reason);
}

static void put_number(struct pw_ring *out, uint8_t value, const uint8_t *at)
{
    uint64_t number = at[0];
    if (value == (uint8_t)VALUE_16) {
        number = pw_get16(at);
    } else if (value == (uint8_t)VALUE_32) {
        number = pw_get32(at);
    } else if (value == (uint8_t)VALUE_64) {
        number = pw_get64(at);
    } else {
        /* one byte */
    }
    pw_text_number(out, number);
}

static void put_value(struct pw_ring *out, uint8_t value, const uint8_t *at)
{
    switch (value) {
    case VALUE_SIGNED:
        put_signed(out, at[0]);
        break;
    case VALUE_VERSION:
        put_version(out, at);
        break;
    case VALUE_UNIQUE:
        put_bytes(out, at, 8u);
        break;
    case VALUE_HARDWARE:
        put_code(out, HARDWARE_NAMES, COUNT(HARDWARE_NAMES), pw_get16(at));
        break;
    case VALUE_STATE:
        put_code(out, STATE_NAMES, COUNT(STATE_NAMES), at[0]);
        break;
    case VALUE_REASON:
        put_code(out, REASON_NAMES, COUNT(REASON_NAMES), at[0]);
        break;
    case VALUE_BANK:
        put_code(out, BANK_NAMES, COUNT(BANK_NAMES), at[0]);
        break;
    case VALUE_FAULTS:
        put_bits(out, FAULT_NAMES, COUNT(FAULT_NAMES), pw_get16(at));
        break;
    case VALUE_FLAGS:
        put_bits(out, FLAG_NAMES, COUNT(FLAG_NAMES), at[0]);
        break;
    case VALUE_FEATURES:
        put_bits(out, FEATURE_NAMES, COUNT(FEATURE_NAMES), pw_get16(at));
        break;
    default:
        put_number(out, value, at);
        break;
    }
}

/* Answers ---------------------------------------------------------------------------------------------------------- */

static void put_lines(struct pw_ring *out, const struct field *fields, size_t count, const uint8_t *data)
{
    for (size_t i = 0; i < count; i++) {
        pw_text(out, fields[i].key);
        pw_text(out, ": ");
        put_value(out, fields[i].value, &data[fields[i].offset]);
        pw_text(out, "\r\n");
    }
}

void pw_text_info(struct pw_ring *out, const uint8_t *info)
{
    put_lines(out, INFO, COUNT(INFO), info);
}

void pw_text_version(struct pw_ring *out, const uint8_t *info)
{
    put_lines(out, VERSION, COUNT(VERSION), info);
}

void pw_text_status(struct pw_ring *out, const uint8_t *status)
{
    put_lines(out, STATUS, COUNT(STATUS), status);
}

void pw_text_faults(struct pw_ring *out, const uint8_t *status)
{
    put_lines(out, FAULTS, COUNT(FAULTS), status);
}

void pw_text_clock(struct pw_ring *out, const uint8_t *clock)
{
    put_lines(out, CLOCK, COUNT(CLOCK), clock);
}

void pw_text_boards(struct pw_ring *out, const uint8_t *processors)
{
    for (uint32_t processor = 0; processor < PW_PROCESSORS; processor++) {
        const uint8_t *report = &processors[processor * REPORT];
        pw_text(out, "processor ");
        pw_text_number(out, processor);
        for (size_t i = 0; i < COUNT(PROCESSOR); i++) {
            pw_text(out, (i == 0u) ? ": " : ", ");
            pw_text(out, PROCESSOR[i].key);
            pw_text(out, " ");
            put_value(out, PROCESSOR[i].value, &report[PROCESSOR[i].offset]);
        }
        pw_text(out, "\r\n");
    }
}

void pw_text_pulse(struct pw_ring *out, const uint8_t *read_back, uint16_t transducer)
{
    const struct pw_pulse pulse = pw_pulse_get(&read_back[FIRST_PULSE], transducer);
    pw_text(out, "phase: ");
    pw_text_number(out, pulse.phase);
    pw_text(out, "\r\nwidth: ");
    pw_text_number(out, pulse.width);
    pw_text(out, "\r\n");
}
