/* Properties of the pure units under random numbers, against literal readings of the clauses. */
#include "blk.h"
#include "check.h"
#include "chn.h"
#include "pul.h"
#include "sta.h"
#include "sums.h"

static struct pw_pulse random_pulse(void)
{
    const struct pw_pulse pulse = { (uint8_t)check_below(100), (uint8_t)check_below(PW_WIDTHS) };
    return pulse;
}

static void random_pulses(uint8_t *packed, uint32_t count)
{
    for (uint32_t i = 0; i < count; i++) {
        pw_pulse_put(packed, i, random_pulse());
    }
}

static void random_bytes(uint8_t *bytes, size_t size)
{
    for (size_t i = 0; i < size; i++) {
        bytes[i] = (uint8_t)check_below(256);
    }
}

/* PUL-005 and PUL-001 for every code at every place of a pair; the neighbours stay. */
static void test_packing(void)
{
    check_case = "packing";
    for (uint32_t code = 0; code < 4096u; code++) {
        const struct pw_pulse pulse = { (uint8_t)(code & 0x7Fu), (uint8_t)(code >> 7) };
        for (uint32_t place = 0; place < 6u; place++) {
            uint8_t packed[9];
            struct pw_pulse before[6];
            uint32_t mistakes = 0;
            random_pulses(packed, 6);
            for (uint32_t i = 0; i < 6u; i++) {
                before[i] = pw_pulse_get(packed, i);
            }
            before[place] = pulse;
            pw_pulse_put(packed, place, pulse);
            for (uint32_t i = 0; i < 6u; i++) {
                const struct pw_pulse got = pw_pulse_get(packed, i);
                mistakes += ((got.phase != before[i].phase) || (got.width != before[i].width)) ? 1u : 0u;
            }
            CHECK_EQ(mistakes, 0);
            CHECK_EQ(pw_pulses_valid(packed, 6), (pulse.phase < 100u) && (pulse.width < 26u));
        }
    }
}

/* REQ-004 and its inverse. */
static void test_sorting(void)
{
    check_case = "sorting";
    for (uint32_t round = 0; round < 50u; round++) {
        uint16_t wiring[PW_CHANNELS];
        uint8_t packed[PW_PAYLOAD];
        uint8_t back[PW_PAYLOAD];
        uint8_t slices[PW_PROCESSORS][PW_SLICE];
        uint32_t mistakes = 0;
        for (uint32_t i = 0; i < PW_CHANNELS; i++) {
            const uint32_t other = check_below(i + 1u); /* Fisher and Yates, from within */
            wiring[i] = wiring[other];
            wiring[other] = (uint16_t)i;
        }
        random_pulses(packed, PW_CHANNELS);
        (void)memset(slices, 0xA5, sizeof slices);
        (void)memset(back, 0xA5, sizeof back);
        pw_pulses_sort(packed, wiring, slices);
        for (uint32_t i = 0; i < PW_CHANNELS; i++) {
            const struct pw_pulse from = pw_pulse_get(packed, i);
            const struct pw_pulse to = pw_pulse_get(slices[wiring[i] / 32u], wiring[i] % 32u);
            mistakes += ((from.phase != to.phase) || (from.width != to.width)) ? 1u : 0u;
        }
        CHECK_EQ(mistakes, 0);
        for (uint32_t processor = 0; processor < PW_PROCESSORS; processor++) {
            pw_pulses_unsort(slices[processor], processor, wiring, back);
        }
        CHECK_BYTES(back, packed, PW_PAYLOAD);
    }
    /* A channel that does not exist, as in no wiring of REQ-004: nothing is written there. */
    {
        static const uint16_t nowhere[PW_CHANNELS] = { 0xFFFF, 320 };
        uint8_t packed[PW_PAYLOAD] = { 0 };
        uint8_t slices[PW_PROCESSORS][PW_SLICE];
        (void)memset(packed, 0xFF, 3);
        pw_pulses_sort(packed, nowhere, slices);
        CHECK(pw_all_zero(slices[0], sizeof slices));
    }
}

static void test_power(void)
{
    check_case = "power";
    for (uint32_t round = 0; round < 50u; round++) {
        uint8_t packed[PW_PAYLOAD];
        uint32_t sum = 0;
        random_pulses(packed, PW_CHANNELS);
        for (uint32_t i = 0; i < PW_CHANNELS; i++) {
            uint8_t alone[3] = { 0 };
            pw_pulse_put(alone, 0, pw_pulse_get(packed, i));
            sum += pw_pulses_power(alone, 2);
        }
        CHECK_EQ(pw_pulses_power(packed, PW_CHANNELS), sum);
    }
}

/* PUL-004 read literally: an output is high in tick t if t is one of the `width` ticks from its beginning on. */
static void rasterise_literally(const uint8_t *slice, uint8_t sample, uint32_t words[PW_TICKS])
{
    (void)memset(words, 0, PW_TICKS * sizeof words[0]);
    for (uint32_t bit = 0; bit < PW_PORT_BITS; bit++) {
        const struct pw_pulse pulse = pw_pulse_get(slice, bit);
        const int width = pw_modulated_width(pulse.width, sample);
        int begin = (int)pulse.phase - width;
        begin = ((begin - (begin & 1)) / 2) + 50; /* the floor of the half */
        for (int n = 0; n < width; n++) {
            words[(begin + n) % 50] |= (uint32_t)1u << bit;
        }
    }
}

static void test_rasterise(void)
{
    check_case = "rasterise";
    for (uint32_t round = 0; round < 2000u; round++) {
        uint8_t slice[PW_SLICE];
        uint32_t words[PW_TICKS];
        uint32_t wanted[PW_TICKS];
        const uint8_t sample = (round < 500u) ? 255u : (uint8_t)check_below(256);
        random_pulses(slice, PW_PORT_BITS);
        (void)memset(words, 0xA5, sizeof words);
        pw_rasterise(slice, sample, words);
        rasterise_literally(slice, sample, wanted);
        CHECK(memcmp(words, wanted, sizeof words) == 0);
    }
    for (uint32_t code = 0; code < 2600u; code++) { /* every pulse alone */
        const struct pw_pulse pulse = { (uint8_t)(code % 100u), (uint8_t)(code / 100u) };
        uint8_t slice[PW_SLICE] = { 0 };
        uint32_t words[PW_TICKS];
        uint32_t wanted[PW_TICKS];
        pw_pulse_put(slice, code % PW_PORT_BITS, pulse);
        pw_rasterise(slice, 255, words);
        rasterise_literally(slice, 255, wanted);
        CHECK(memcmp(words, wanted, sizeof words) == 0);
    }
    for (uint32_t round = 0; round < 200u; round++) { /* reserved codes: anything, but within the array */
        uint8_t slice[PW_SLICE];
        uint32_t words[PW_TICKS + 1u];
        words[PW_TICKS] = 0xA5A5A5A5u;
        random_bytes(slice, sizeof slice);
        pw_rasterise(slice, (uint8_t)check_below(256), words);
        CHECK_EQ(words[PW_TICKS], 0xA5A5A5A5u);
    }
    CHECK_EQ(pw_modulated_width(26, 255), 0);
    CHECK_EQ(pw_modulated_width(255, 255), 0);
}

/* IEEE 802.3, bit by bit. */
static uint32_t crc_literally(const uint8_t *data, size_t size)
{
    uint32_t crc = 0xFFFFFFFFu;
    for (size_t i = 0; i < size; i++) {
        crc ^= data[i];
        for (int bit = 0; bit < 8; bit++) {
            crc = ((crc & 1u) != 0u) ? ((crc >> 1) ^ 0xEDB88320u) : (crc >> 1);
        }
    }
    return ~crc;
}

static void test_crc(void)
{
    static const uint8_t digits[] = { '1', '2', '3', '4', '5', '6', '7', '8', '9' };
    uint8_t data[600];
    check_case = "CRC-32";
    CHECK_EQ(pw_crc32(0, digits, sizeof digits), 0xCBF43926u);
    CHECK_EQ(pw_crc32(0, NULL, 0), 0);
    for (uint32_t round = 0; round < 300u; round++) {
        const size_t offset = check_below(8);
        const size_t size = check_below(sizeof data - 8u);
        const size_t cut = check_below((uint32_t)size + 1u);
        random_bytes(data, sizeof data);
        CHECK_EQ(pw_crc32(0, &data[offset], size), crc_literally(&data[offset], size));
        CHECK_EQ(pw_crc32(pw_crc32(0, &data[offset], cut), &data[offset + cut], size - cut),
                 crc_literally(&data[offset], size));
    }
}

/* The examples of FIPS 180-4, and the lengths at which the padding takes another block. */
static void test_sha256(void)
{
    static const struct {
        const char *text;
        uint32_t times;
        uint8_t digest[32];
    } known[] = {
        { "", 1,
          { 0xE3, 0xB0, 0xC4, 0x42, 0x98, 0xFC, 0x1C, 0x14, 0x9A, 0xFB, 0xF4, 0xC8, 0x99, 0x6F, 0xB9, 0x24,
            0x27, 0xAE, 0x41, 0xE4, 0x64, 0x9B, 0x93, 0x4C, 0xA4, 0x95, 0x99, 0x1B, 0x78, 0x52, 0xB8, 0x55 } },
        { "abc", 1,
          { 0xBA, 0x78, 0x16, 0xBF, 0x8F, 0x01, 0xCF, 0xEA, 0x41, 0x41, 0x40, 0xDE, 0x5D, 0xAE, 0x22, 0x23,
            0xB0, 0x03, 0x61, 0xA3, 0x96, 0x17, 0x7A, 0x9C, 0xB4, 0x10, 0xFF, 0x61, 0xF2, 0x00, 0x15, 0xAD } },
        { "abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq", 1,
          { 0x24, 0x8D, 0x6A, 0x61, 0xD2, 0x06, 0x38, 0xB8, 0xE5, 0xC0, 0x26, 0x93, 0x0C, 0x3E, 0x60, 0x39,
            0xA3, 0x3C, 0xE4, 0x59, 0x64, 0xFF, 0x21, 0x67, 0xF6, 0xEC, 0xED, 0xD4, 0x19, 0xDB, 0x06, 0xC1 } },
        { "a", 1000000,
          { 0xCD, 0xC7, 0x6E, 0x5C, 0x99, 0x14, 0xFB, 0x92, 0x81, 0xA1, 0xC7, 0xE2, 0x84, 0xD7, 0x3E, 0x67,
            0xF1, 0x80, 0x9A, 0x48, 0xA4, 0x97, 0x20, 0x0E, 0x04, 0x6D, 0x39, 0xCC, 0xC7, 0x11, 0x2C, 0xD0 } },
    };
    check_case = "SHA-256";
    for (size_t i = 0; i < (sizeof known / sizeof known[0]); i++) {
        struct pw_sha256 sum;
        uint8_t text[64] = { 0 };
        uint8_t digest[32];
        const size_t size = strlen(known[i].text);
        (void)memcpy(text, known[i].text, size);
        pw_sha256_begin(&sum);
        for (uint32_t n = 0; n < known[i].times; n++) {
            pw_sha256_add(&sum, text, size);
        }
        pw_sha256_end(&sum, digest);
        CHECK_BYTES(digest, known[i].digest, 32);
    }
    for (size_t size = 0; size < 200u; size++) { /* in pieces as in one */
        struct pw_sha256 whole;
        struct pw_sha256 pieces;
        uint8_t data[200];
        uint8_t digest[32];
        uint8_t other[32];
        size_t at = 0;
        random_bytes(data, sizeof data);
        pw_sha256_begin(&whole);
        pw_sha256_add(&whole, data, size);
        pw_sha256_end(&whole, digest);
        pw_sha256_begin(&pieces);
        while (at < size) {
            const size_t part = check_below((uint32_t)(size - at) + 1u);
            pw_sha256_add(&pieces, &data[at], part);
            at += part;
        }
        pw_sha256_end(&pieces, other);
        CHECK_BYTES(other, digest, 32);
    }
}

/* The table of BLK-011 as conditions. */
static bool fields_literally(const struct pw_block *b, bool payload_is_zero_from_item_end)
{
    const uint32_t end = (uint32_t)b->first + b->count;
    const bool restart_only = (b->flags == 0u) || (b->flags == 1u);
    const bool no_items = (b->first == 0u) && (b->count == 0u);
    const bool no_times = (b->hold == 0u) && (b->repeats == 0u);
    bool good = false;
    switch (b->kind) {
    case PW_UPDATE:
        good = no_items && no_times && (b->action == 0u) && restart_only;
        break;
    case PW_SLOT:
        good = (b->period == 0u) && (b->first <= 255u) && (b->count == 0u) && no_times && (b->action == 0u) &&
               restart_only;
        break;
    case PW_STORE_ENTRIES:
        good = (b->period == 0u) && (b->count >= 1u) && (b->count <= 120u) && (end <= 1024u) && no_times &&
               (b->action == 0u) && restart_only && payload_is_zero_from_item_end;
        break;
    case PW_SEQUENCE:
        good = (b->count >= 1u) && (b->count <= 1024u) && (end <= 1024u) && (b->hold == 0u) && (b->action == 0u) &&
               (b->flags <= 3u) && payload_is_zero_from_item_end;
        break;
    case PW_STORE_SAMPLES:
        good = (b->period == 0u) && (b->count >= 1u) && (b->count <= 480u) && (end <= 4096u) && no_times &&
               (b->action == 0u) && restart_only && payload_is_zero_from_item_end;
        break;
    case PW_MODULATION:
        good = (b->count >= 1u) && (b->count <= 4096u) && (end <= 4096u) && (b->hold >= 1u) && (b->repeats == 0u) &&
               (b->action == 0u) && restart_only && payload_is_zero_from_item_end;
        break;
    case PW_OUTPUT:
        good = no_items && no_times && (b->action >= 1u) && (b->action <= 3u) && restart_only &&
               payload_is_zero_from_item_end;
        break;
    default:
        good = (b->period == 0u) && no_items && no_times && (b->action == 0u) && restart_only &&
               payload_is_zero_from_item_end;
        break;
    }
    return good;
}

static uint16_t often_zero(const uint16_t *some, uint32_t count)
{
    return (check_below(3) != 0u) ? 0u : some[check_below(count)];
}

static void test_block_fields(void)
{
    static const uint16_t values[] = { 1, 2, 3, 119, 120, 121, 255, 256, 257, 479, 480, 481, 903, 904, 905, 1023, 1024,
                                       1025, 3616, 3617, 4095, 4096, 4097, 65535 };
    static const uint16_t small[] = { 1, 2, 3, 4, 5, 128, 129, 255 };
    uint32_t accepted = 0;
    check_case = "fields of blocks";
    for (uint32_t round = 0; round < 40000u; round++) {
        uint8_t bytes[PW_BLOCK] = { 0x50, 0x57, 1 };
        uint8_t checked[PW_BLOCK];
        struct pw_block made = { 0 };
        struct pw_block got;
        size_t items = 0;
        bool zero = true;
        made.kind = (uint8_t)(1u + check_below(9));
        made.flags = (uint8_t)often_zero(small, 8);
        made.action = (uint8_t)often_zero(small, (made.kind == PW_OUTPUT) ? 4 : 8);
        made.sequence = check_random();
        made.period = (check_below(3) == 0u) ? (((uint64_t)check_random() << 32) | check_random()) : 0u;
        made.first = often_zero(values, 24);
        made.count = often_zero(values, 24);
        made.hold = often_zero(values, 24);
        made.repeats = often_zero(values, 24);
        if ((made.kind == PW_STORE_ENTRIES) || (made.kind == PW_STORE_SAMPLES)) {
            items = (size_t)made.count * ((made.kind == PW_STORE_ENTRIES) ? 4u : 1u);
        }
        if ((items > 0u) && (items <= PW_PAYLOAD)) {
            for (size_t i = 0; i < items; i++) { /* slots below 256 and periods that are not 0 */
                bytes[32u + i] = ((i % 4u) == 1u) ? 0u : 7u;
            }
        }
        if ((made.kind > PW_SLOT) && (items < PW_PAYLOAD) && (check_below(8) == 0u)) {
            zero = false;
            bytes[32u + items + check_below((uint32_t)(PW_PAYLOAD - items))] = 1;
        }
        bytes[3] = made.kind;
        pw_put32(&bytes[4], made.sequence);
        pw_put64(&bytes[8], made.period);
        pw_put16(&bytes[16], made.first);
        pw_put16(&bytes[18], made.count);
        pw_put16(&bytes[20], made.hold);
        pw_put16(&bytes[22], made.repeats);
        bytes[26] = made.flags;
        bytes[27] = made.action;
        (void)memcpy(checked, bytes, sizeof checked);
        pw_put32(&checked[28], pw_crc32(0, bytes, sizeof bytes));
        CHECK_EQ(pw_block_check(checked, PW_BLOCK, &got), fields_literally(&made, zero) ? PW_ACCEPTED : PW_FIELD);
        if (pw_block_check(checked, PW_BLOCK, &got) == PW_ACCEPTED) {
            accepted++;
            CHECK((got.period == made.period) && (got.first == made.first) && (got.count == made.count) &&
                  (got.hold == made.hold) && (got.repeats == made.repeats) && (got.action == made.action));
            checked[check_below(PW_BLOCK)] ^= (uint8_t)(1u << check_below(8));
            CHECK_EQ(pw_block_check(checked, PW_BLOCK, &got), PW_CHECKSUM);
        }
    }
    CHECK(accepted > 1000u);
    for (uint32_t value = 0; value < 0x10000u; value += 0x55u) { /* the magic, under a right checksum */
        uint8_t bytes[PW_BLOCK] = { (uint8_t)(value & 0xFFu), (uint8_t)(value >> 8), 1, PW_NO_OP };
        struct pw_block got;
        const uint32_t checksum = pw_crc32(0, bytes, sizeof bytes);
        pw_put32(&bytes[28], checksum);
        CHECK_EQ(pw_block_check(bytes, PW_BLOCK, &got), PW_MAGIC);
    }
}

/* CHN-012 and CHN-014 as conditions. */
static bool load_literally(uint16_t node, const struct pw_load *l, uint32_t used)
{
    const uint32_t end = (uint32_t)l->first + l->count;
    const uint32_t items[4] = { 0, 1, 12, 48 };
    const uint32_t bytes[4] = { 0, 48, 4, 1 };
    const uint32_t ends[4] = { 0, 256, 1024, 4096 };
    return (node <= 9u) && (l->memory >= 1u) && (l->memory <= 3u) && (l->count >= 1u) &&
           (l->count <= items[l->memory]) && (end <= ends[l->memory]) &&
           (used <= ((uint32_t)l->count * bytes[l->memory]));
}

static bool program_literally(uint16_t node, const struct pw_program *p)
{
    const bool none = (p->first == 0u) && (p->hold == 0u) && (p->repeats == 0u);
    const bool entries = (p->memory == 2u) && (((uint32_t)p->first + p->count) <= 1024u) && (p->hold == 0u);
    const bool samples = (p->memory == 3u) && (((uint32_t)p->first + p->count) <= 4096u) && (p->hold >= 1u) &&
                         (p->repeats == 0u);
    const bool stop = ((p->memory == 2u) || (p->memory == 3u)) && none;
    return (node <= 9u) && ((p->count == 0u) ? stop : (entries || samples));
}

static void test_loads_and_programs(void)
{
    static const uint16_t values[] = { 1, 2, 12, 13, 48, 49, 255, 256, 976, 1012, 1013, 1023, 1024, 1025, 4048, 4049,
                                       4095, 4096, 65535 };
    uint32_t loads = 0;
    uint32_t programs = 0;
    check_case = "loads and programs";
    for (uint32_t round = 0; round < 20000u; round++) {
        const uint16_t node = (uint16_t)((check_below(8) == 0u) ? (10u + check_below(300)) : check_below(10));
        const uint32_t used = (check_below(2) == 0u) ? 1u : check_below(PW_SLICE + 1u); /* up to its last byte */
        struct pw_load load = { (uint8_t)check_below(5), often_zero(values, 19), (uint8_t)check_below(50), { 0 } };
        struct pw_load load_back = { 0 };
        struct pw_program program = { (uint8_t)check_below(5), often_zero(values, 19), often_zero(values, 19),
                                      often_zero(values, 3), often_zero(values, 3), check_random() };
        struct pw_program back = { 0 };
        uint8_t message[PW_MESSAGE];
        size_t size;
        load.count = (check_below(3) == 0u) ? 1u : load.count;
        for (uint32_t i = 0; i < used; i++) {
            load.data[i] = (uint8_t)(1u + check_below(255));
        }
        size = pw_load_put(message, node, &load);
        CHECK_EQ(pw_load_get(&load_back, node, &message[3], size - 3u), load_literally(node, &load, used));
        if (load_literally(node, &load, used)) {
            loads++;
            CHECK_EQ(load_back.memory, load.memory);
            CHECK_EQ(load_back.first, load.first);
            CHECK_EQ(load_back.count, load.count);
            CHECK_BYTES(load_back.data, load.data, PW_SLICE);
            CHECK(!pw_load_get(&load_back, (uint16_t)((node + 1u) % 10u), &message[3], size - 3u));
        }
        size = pw_program_put(message, node, &program);
        CHECK_EQ(pw_program_get(&back, node, &message[3], size - 3u), program_literally(node, &program));
        if (program_literally(node, &program)) {
            programs++;
            CHECK((back.memory == program.memory) && (back.first == program.first) && (back.count == program.count));
            CHECK((back.hold == program.hold) && (back.repeats == program.repeats) && (back.period == program.period));
            CHECK(!pw_program_get(&back, (uint16_t)((node + 1u) % 10u), &message[3], size - 3u));
        }
    }
    CHECK((loads > 500u) && (programs > 500u));
}

/* The one field of a short message at every value, under a right checksum. */
static void test_short_messages(void)
{
    check_case = "short messages";
    for (uint32_t value = 0; value < 256u; value++) {
        const struct pw_identity identity = { (uint8_t)value, 0, { 0 }, { 0 } };
        const struct pw_identity lasting = { 9, (uint8_t)value, { 0 }, { 0 } };
        const struct pw_playing playing = { (uint8_t)value, 1000, { 0 } };
        const struct pw_report report = { (uint8_t)value, 0, 0, { 0 }, 0, 0, 0, 0 };
        struct pw_identity identity_back;
        struct pw_playing playing_back;
        struct pw_report report_back;
        uint8_t back = 0;
        uint8_t message[PW_MESSAGE];
        size_t size = pw_collect_put(message, 9, (uint8_t)value);
        CHECK_EQ(pw_collect_get(&back, 9, &message[3], size - 3u), (value == 7u) || (value == 8u));
        size = pw_collect_put(message, (uint16_t)value, 7);
        CHECK_EQ(pw_collect_get(&back, (uint16_t)value, &message[3], size - 3u), value < 10u);
        size = pw_number_put(message, (uint8_t)value);
        CHECK_EQ(pw_number_get(&back, &message[3], size - 3u), value < 10u);
        size = pw_identity_put(message, &identity);
        CHECK_EQ(pw_identity_get(&identity_back, &message[3], size - 3u), value < 10u);
        size = pw_identity_put(message, &lasting);
        CHECK_EQ(pw_identity_get(&identity_back, &message[3], size - 3u), value < 2u);
        size = pw_playing_put(message, &playing);
        CHECK_EQ(pw_playing_get(&playing_back, &message[3], size - 3u), value < 10u);
        size = pw_report_put(message, &report);
        CHECK_EQ(pw_report_get(&report_back, &message[3], size - 3u), value < 10u);
    }
}

/* What no enumeration names is no state and no event, and does nothing. */
static void test_states(void)
{
    check_case = "states";
    for (unsigned event = 13; event < 40u; event++) {
        CHECK(!pw_state_allows(PW_STATE_READY, (enum pw_event)event));
        CHECK_EQ(pw_state_after(PW_STATE_READY, (enum pw_event)event), PW_STATE_READY);
    }
    CHECK(!pw_state_allows((enum pw_state)7, PW_EVENT_RESTART));
    CHECK(!pw_state_enabled((enum pw_state)7));
}

int main(void)
{
    test_packing();
    test_sorting();
    test_power();
    test_rasterise();
    test_crc();
    test_sha256();
    test_block_fields();
    test_loads_and_programs();
    test_short_messages();
    test_states();
    return check_end();
}
