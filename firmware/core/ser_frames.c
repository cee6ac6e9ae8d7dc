/* Chapter SER: frames. COBS, the checksum, and the layouts of the kinds. */
#include "ser.h"

#include "sums.h"

#define FULL_GROUP 0xFFu      /* length byte of 254 bytes that no zero follows: SER-003 */
#define CHECKSUM 4u
#define SETUP_END 9u          /* a REQUEST is tag, SETUP packet, data: SER-007 */
#define REPLY_HEAD 2u         /* a REPLY is tag, outcome, data: SER-008 */

/* A frame that is being written: the length byte of its last group is filled in as the group grows. */
struct encoder {
    uint8_t *frame;
    size_t size;
    size_t group;
    bool open; /* whether the last group may still grow, or ends with a zero that the end stands for */
};

static void open_group(struct encoder *encoder)
{
    encoder->group = encoder->size;
    encoder->frame[encoder->size] = 1u;
    encoder->size++;
    encoder->open = true;
}

static void encode(struct encoder *encoder, const uint8_t *bytes, size_t size)
{
    for (size_t i = 0; i < size; i++) {
        if (!encoder->open) {
            open_group(encoder);
        }
        if (bytes[i] == 0u) {
            open_group(encoder);
        } else {
            encoder->frame[encoder->size] = bytes[i];
            encoder->size++;
            encoder->frame[encoder->group]++;
            /* After a full group the next one is opened only if something follows: 01 must not end a frame there. */
            encoder->open = encoder->frame[encoder->group] != FULL_GROUP;
        }
    }
}

size_t pw_frame_encode(uint8_t frame[PW_FRAME_MOST], uint8_t kind, const uint8_t *body, size_t size)
{
    struct encoder encoder = {frame, 0u, 0u, false};
    uint8_t checksum[CHECKSUM];
    pw_put32(checksum, pw_crc32(pw_crc32(0u, &kind, 1u), body, size));
    open_group(&encoder);
    encode(&encoder, &kind, 1u);
    encode(&encoder, body, size);
    encode(&encoder, checksum, CHECKSUM);
    frame[encoder.size] = 0u;
    return encoder.size + 1u;
}

/* Takes COBS away in place: no content is longer than its encoding. False: it is not in the form of SER-003. */
static bool decode(uint8_t *bytes, size_t *size)
{
    size_t from = 0;
    size_t to = 0;
    bool full_before = false;
    while (from < *size) {
        const uint8_t length = bytes[from];
        if ((length == 0u) || ((size_t)length > (*size - from))) {
            return false;
        }
        const bool last = (from + (size_t)length) == *size;
        if (last && full_before && (length == 1u)) {
            return false;
        }
        for (size_t i = 1; i < (size_t)length; i++) {
            if (bytes[from + i] == 0u) {
                return false;
            }
            bytes[to] = bytes[from + i];
            to++;
        }
        full_before = length == FULL_GROUP;
        if (!last && !full_before) {
            bytes[to] = 0u;
            to++;
        }
        from += (size_t)length;
    }
    *size = to;
    return true;
}

static bool request_valid(const uint8_t *body, size_t size)
{
    if (size < SETUP_END) {
        return false;
    }
    const struct pw_setup setup = pw_frame_setup(body);
    const size_t data = ((setup.type & 0x80u) == 0u) ? (size_t)setup.length : 0u;
    return (setup.length <= PW_ANSWER) && (size == (SETUP_END + data));
}

static bool reply_valid(const uint8_t *body, size_t size)
{
    if ((size < REPLY_HEAD) || (size > (REPLY_HEAD + PW_ANSWER))) {
        return false;
    }
    return (body[1] == (uint8_t)PW_DONE) || ((body[1] == (uint8_t)PW_STALL) && (size == REPLY_HEAD));
}

static bool body_valid(uint8_t kind, const uint8_t *body, size_t size)
{
    bool valid = false;
    switch (kind) {
    case PW_FRAME_BLOCK:
        valid = size == PW_BLOCK;
        break;
    case PW_FRAME_RECORD:
        valid = (size == PW_ACK) || (size == PW_STATUS);
        break;
    case PW_FRAME_REQUEST:
        valid = request_valid(body, size);
        break;
    case PW_FRAME_REPLY:
        valid = reply_valid(body, size);
        break;
    case PW_FRAME_CONSOLE:
        valid = size == 0u;
        break;
    default:
        valid = false;
        break;
    }
    return valid;
}

bool pw_frame_decode(struct pw_frame *frame, uint8_t *bytes, size_t size)
{
    size_t content = size;
    if ((size >= PW_FRAME_MOST) || !decode(bytes, &content) || (content < (1u + CHECKSUM))) {
        return false;
    }
    const size_t covered = content - CHECKSUM;
    if (pw_crc32(0u, bytes, covered) != pw_get32(&bytes[covered])) {
        return false;
    }
    frame->kind = bytes[0];
    frame->body = &bytes[1];
    frame->size = covered - 1u;
    return body_valid(frame->kind, frame->body, frame->size);
}

struct pw_setup pw_frame_setup(const uint8_t *body)
{
    struct pw_setup setup;
    setup.type = body[1];
    setup.request = body[2];
    setup.value = pw_get16(&body[3]);
    setup.index = pw_get16(&body[5]);
    setup.length = pw_get16(&body[7]);
    return setup;
}
