/* Vectors and properties of frames, typing, commands and answers: what of SER and CON needs no device. */
#include "check.h"
#include "con.h"
#include "ser.h"
#include "sums.h"
#include "vectors.h"

/* COBS by the words of SER-003, written apart from the encoder: cut after each zero, then into groups. */
static size_t cobs_by_the_words(const uint8_t *content, size_t size, uint8_t *to)
{
    size_t at = 0;
    size_t begin = 0;
    for (size_t end = 0; end <= size; end++) {
        if ((end == size) || (content[end] == 0u)) {
            const bool full = ((end - begin) >= 254u);
            while ((end - begin) >= 254u) {
                to[at] = 0xFFu;
                memcpy(&to[at + 1u], &content[begin], 254u);
                at += 255u;
                begin += 254u;
            }
            if (!full || (end < size) || (begin < end)) {
                to[at] = (uint8_t)((end - begin) + 1u);
                memcpy(&to[at + 1u], &content[begin], end - begin);
                at += 1u + (end - begin);
            }
            begin = end + 1u;
        }
    }
    to[at] = 0u;
    return at + 1u;
}

static void test_frames(void)
{
    for (size_t i = 0; i < VEC_COUNT(vec_frames); i++) {
        const struct vec_frame *v = &vec_frames[i];
        uint8_t bytes[PW_FRAME_MOST];
        struct pw_frame frame = {0};
        check_case = v->name;
        CHECK_EQ(v->kind, v->code);
        CHECK_EQ(pw_frame_encode(bytes, v->kind, v->body, v->body_size), v->size);
        CHECK_BYTES(bytes, v->bytes, v->size);
        CHECK(pw_frame_decode(&frame, bytes, v->size - 1u));
        CHECK_EQ(frame.kind, v->kind);
        CHECK_EQ(frame.size, v->body_size);
        CHECK_BYTES(frame.body, v->body, v->body_size);
        if (v->kind == PW_FRAME_REQUEST) {
            const struct pw_setup setup = pw_frame_setup(frame.body);
            CHECK_EQ(frame.body[0], v->tag);
            CHECK_EQ(setup.type, v->request_type);
            CHECK_EQ(setup.request, v->request);
            CHECK_EQ(setup.value, v->value);
            CHECK_EQ(setup.index, v->index);
            CHECK_EQ(setup.length, v->length);
        }
        if (v->kind == PW_FRAME_REPLY) {
            CHECK_EQ(frame.body[0], v->tag);
            CHECK_EQ(frame.body[1], v->outcome);
        }
    }
}

static void test_refused_frames(void)
{
    for (size_t i = 0; i < VEC_COUNT(vec_refused_frames); i++) {
        const struct vec_refused_frame *v = &vec_refused_frames[i];
        uint8_t bytes[PW_FRAME_MOST + 2u];
        struct pw_frame frame = {0};
        check_case = v->name;
        CHECK(v->size <= sizeof bytes);
        memcpy(bytes, v->bytes, v->size);
        CHECK_EQ(bytes[v->size - 1u], 0);
        CHECK(!pw_frame_decode(&frame, bytes, v->size - 1u));
    }
}

/* A body of random bytes with many, few or no zeros, of any size that its kind allows. */
static size_t random_body(uint8_t kind, uint8_t *body)
{
    const uint32_t zeros = check_below(3);
    const size_t data = check_below(2) == 0u ? check_below(PW_ANSWER + 1u) : 250u + check_below(12);
    size_t size = 0;
    for (size_t i = 0; i < PW_BODY_MOST; i++) {
        const uint8_t any = (uint8_t)check_random();
        const bool zero = ((zeros == 0u) && (check_below(2) == 0u)) || ((zeros == 1u) && (check_below(300) == 0u));
        body[i] = zero ? 0u : (uint8_t)(any | 1u);
    }
    switch (kind) {
    case PW_FRAME_BLOCK:
        size = PW_BLOCK;
        break;
    case PW_FRAME_RECORD:
        size = check_below(2) == 0u ? PW_ACK : PW_STATUS;
        break;
    case PW_FRAME_REQUEST:
        body[1] = (uint8_t)(body[1] & 0x7Fu);
        pw_put16(&body[7], (uint32_t)data);
        size = 9u + data;
        break;
    case PW_FRAME_REPLY:
        body[1] = PW_DONE;
        size = 2u + data;
        break;
    default:
        size = 0;
        break;
    }
    return size;
}

static void test_any_frame(void)
{
    check_case = "any frame";
    for (uint32_t round = 0; round < 4000u; round++) {
        uint8_t body[PW_BODY_MOST + 8u];
        uint8_t content[PW_BODY_MOST + 8u];
        uint8_t bytes[PW_FRAME_MOST];
        uint8_t wanted[PW_FRAME_MOST];
        struct pw_frame frame = {0};
        const uint8_t kind = (uint8_t)(1u + (round % 5u));
        const size_t size = random_body(kind, body);
        content[0] = kind;
        memcpy(&content[1], body, size);
        pw_put32(&content[1u + size], pw_crc32(0u, content, 1u + size));
        const size_t length = pw_frame_encode(bytes, kind, body, size);
        CHECK_EQ(length, cobs_by_the_words(content, size + 5u, wanted));
        CHECK_BYTES(bytes, wanted, length);
        CHECK(memchr(bytes, 0, length) == &bytes[length - 1u]);
        CHECK(length <= (size + 5u + ((size + 5u + 253u) / 254u) + 1u)); /* SER-004 */
        CHECK(pw_frame_decode(&frame, bytes, length - 1u));
        CHECK_EQ(frame.kind, kind);
        CHECK_EQ(frame.size, size);
        CHECK_BYTES(frame.body, body, size);
    }
}

/* SER-015: two flipped bits are found; where they hit a length byte, with so few rounds that chance does not matter. */
static void test_flipped_bits(void)
{
    check_case = "flipped bits";
    uint8_t body[PW_BLOCK];
    memset(body, 0x55, sizeof body);
    uint8_t whole[PW_FRAME_MOST];
    const size_t length = pw_frame_encode(whole, PW_FRAME_BLOCK, body, sizeof body);
    for (uint32_t round = 0; round < 4000u; round++) {
        uint8_t bytes[PW_FRAME_MOST];
        struct pw_frame frame = {0};
        memcpy(bytes, whole, length);
        const size_t first = 1u + check_below((uint32_t)length - 2u);
        const size_t second = 1u + check_below((uint32_t)length - 2u);
        bytes[first] = (uint8_t)(bytes[first] ^ (1u << check_below(8)));
        bytes[second] = (uint8_t)(bytes[second] ^ (1u << check_below(8)));
        if (memcmp(bytes, whole, length) != 0) {
            CHECK(!pw_frame_decode(&frame, bytes, length - 1u));
        }
    }
}

/* Whatever arrives is read within its bounds, and a whole frame is the only encoding of its content. */
static uint8_t edges[PW_FRAME_MOST];

static void test_any_bytes(void)
{
    check_case = "any bytes";
    for (uint32_t round = 0; round < 20000u; round++) {
        uint8_t bytes[PW_FRAME_MOST];
        uint8_t again[PW_FRAME_MOST];
        uint8_t before[PW_FRAME_MOST];
        struct pw_frame frame = {0};
        const size_t size = check_below(PW_FRAME_MOST);
        const uint32_t most = 1u + check_below(255);
        for (size_t i = 0; i < size; i++) {
            bytes[i] = (uint8_t)(1u + check_below(most));
        }
        memcpy(before, bytes, size);
        /* At the edge of its memory, so that a sanitizer sees what is read beyond. */
        uint8_t *edge = &edges[sizeof edges - size];
        memcpy(edge, bytes, size);
        if (pw_frame_decode(&frame, edge, size)) {
            CHECK_EQ(pw_frame_encode(again, frame.kind, frame.body, frame.size), size + 1u);
            CHECK_BYTES(again, before, size);
        }
    }
    struct pw_frame frame = {0};
    CHECK(!pw_frame_decode(&frame, NULL, 0u));
}

/* Text ------------------------------------------------------------------------------------------------------------- */

static struct pw_ring shown;

static void drop_shown(void)
{
    shown.first = 0;
    shown.used = 0;
}

static void test_typing(void)
{
    for (size_t i = 0; i < VEC_COUNT(vec_typings); i++) {
        const struct vec_typing *v = &vec_typings[i];
        struct pw_typing typing = {0};
        const uint8_t *wanted = v->lines;
        uint8_t lines = 0;
        check_case = v->name;
        typing.echo = v->echo;
        drop_shown();
        for (size_t k = 0; k < v->typed_size; k++) {
            if (pw_typing_take(&typing, v->typed[k], &shown)) {
                const bool long_line = wanted[0] > PW_TYPED;
                CHECK_EQ(typing.too_long, long_line);
                CHECK_EQ(typing.size, long_line ? PW_TYPED : wanted[0]);
                CHECK_BYTES(typing.line, &wanted[1], typing.size);
                wanted = &wanted[1u + wanted[0]];
                lines++;
                pw_typing_clear(&typing);
            }
        }
        CHECK_EQ(lines, v->line_count);
        CHECK_EQ(shown.used, v->shown_size);
        CHECK_BYTES(shown.bytes, v->shown, v->shown_size);
    }
}

static void type_line(struct pw_typing *typing, const uint8_t *line, size_t size)
{
    for (size_t i = 0; i < size; i++) {
        (void)pw_typing_take(typing, line[i], &shown);
    }
}

static void test_commands(void)
{
    for (size_t i = 0; i < VEC_COUNT(vec_commands); i++) {
        const struct vec_command *v = &vec_commands[i];
        struct pw_typing typing = {0};
        struct pw_command command = {0};
        check_case = v->name;
        /* Take-back characters cannot be typed into a line, so they are put there. */
        if (v->size <= PW_TYPED) {
            memcpy(typing.line, v->line, v->size);
            typing.size = v->size;
        } else {
            type_line(&typing, v->line, v->size);
        }
        CHECK_EQ(v->error, v->code);
        CHECK_EQ(pw_command_read(&command, &typing), v->code);
        if (v->code == 0u) {
            const char *name = pw_command_name(command.code);
            CHECK_EQ(name == NULL, v->command == NULL);
            CHECK((name == NULL) || (strcmp(name, v->command) == 0));
            CHECK_EQ(command.words, (v->command != NULL ? 1 : 0) + (v->argument >= 0 ? 1 : 0));
            CHECK_EQ(command.argument, v->argument >= 0 ? v->argument : 0);
        }
    }
}

static const uint8_t *data_of(const char *name)
{
    for (size_t i = 0; i < VEC_COUNT(vec_console_data); i++) {
        if (strcmp(vec_console_data[i].name, name) == 0) {
            return vec_console_data[i].bytes;
        }
    }
    for (size_t i = 0; i < VEC_COUNT(vec_statuses); i++) {
        if (strcmp(vec_statuses[i].name, name) == 0) {
            return vec_statuses[i].bytes;
        }
    }
    return NULL;
}

static struct pw_line line;
static struct pw_device no_device;

/* What a device answers that has given these data for the command. */
static void answer(const char *command, const uint8_t *data, size_t size)
{
    struct pw_typing typing = {0};
    struct pw_command read = {0};
    pw_line_begin(&line, PW_DOOR_LINE(0u), true);
    memcpy(typing.line, command, strlen(command));
    typing.size = (uint8_t)strlen(command);
    CHECK_EQ(pw_command_read(&read, &typing), 0);
    line.pending_tag = read.code;
    line.pending_argument = read.argument;
    memcpy(&line.answer[2], data, size);
    pw_console_finish(&line, &no_device, PW_ANSWERED);
}

static void test_exchanges(void)
{
    const uint8_t pulses[16u + PW_PAYLOAD] = {[16 + 26] = 0x10}; /* of 17: phase 0, width 2 (PUL-005) */
    for (size_t i = 0; i < VEC_COUNT(vec_exchanges); i++) {
        const struct vec_exchange *v = &vec_exchanges[i];
        const char *of = v->of != NULL ? v->of : "clock-reading";
        const bool is_pulses = strcmp(v->name, "exchange-pulses") == 0;
        const uint8_t *data = is_pulses ? pulses : data_of(of);
        check_case = v->name;
        CHECK(data != NULL);
        if (data != NULL) {
            const bool boards = strcmp(v->line, "boards") == 0;
            const bool clock = v->of == NULL;
            answer(v->line, data, is_pulses ? sizeof pulses : boards ? 160u : clock ? 24u : 64u);
            CHECK_EQ(line.out.used, v->size);
            CHECK_BYTES(line.out.bytes, v->answer, v->size);
        }
    }
}

/* PW_TEXT_MOST and PW_REPLY_MOST hold for the longest answers that there are. */
static void test_longest_answers(void)
{
    uint8_t data[160];
    uint8_t frame[PW_FRAME_MOST];
    uint8_t body[2u + PW_ANSWER];
    memset(data, 0xFF, sizeof data);
    for (size_t i = 0; i < PW_PROCESSORS; i++) {
        data[(16u * i) + 2u] = 0x80;
        data[(16u * i) + 3u] = PW_BANK_FACTORY;
    }
    check_case = "longest text";
    answer("boards", data, sizeof data);
    CHECK_EQ(line.out.used + 2u, 1878);
    CHECK(line.out.used + 2u <= PW_TEXT_MOST);
    check_case = "longest frames";
    memset(body, 0x11, sizeof body);
    body[1] = PW_DONE;
    const size_t reply = pw_frame_encode(frame, PW_FRAME_REPLY, body, sizeof body);
    const size_t console = pw_frame_encode(frame, PW_FRAME_CONSOLE, NULL, 0u);
    const size_t record = pw_frame_encode(frame, PW_FRAME_RECORD, body, PW_ACK);
    CHECK(reply <= 651u);
    CHECK(1u + reply + console + record <= PW_REPLY_MOST);
}

int main(void)
{
    test_frames();
    test_refused_frames();
    test_any_frame();
    test_flipped_bits();
    test_any_bytes();
    test_typing();
    test_commands();
    test_exchanges();
    test_longest_answers();
    return check_end();
}
