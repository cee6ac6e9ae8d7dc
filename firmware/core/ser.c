/* Chapter SER: the modes of a line, what arrives on it, and its answers in order. */
#include "ser.h"

#include <string.h>

#include "con.h"

/* Answers ---------------------------------------------------------------------------------------------------------- */

static void put_frame(struct pw_line *line, uint8_t kind, const uint8_t *body, size_t size)
{
    const uint8_t zero = 0;
    uint8_t frame[PW_FRAME_MOST];
    const size_t length = pw_frame_encode(frame, kind, body, size);
    /* After a pause a UART may have brought noise; a zero keeps it out of this frame (SER-005). USB brings none. */
    if (line->is_uart && (line->out.used == 0u)) {
        pw_ring_put(&line->out, &zero, 1u);
    }
    pw_ring_put(&line->out, frame, length);
}

static void drop_answers(struct pw_line *line)
{
    line->owes = false;
    line->out.first = 0;
    line->out.used = 0;
}

/* Whether what arrives has to wait, as its answer would have no room or would overtake one that is LATER. */
static bool busy(struct pw_line *line, uint32_t most)
{
    if (line->muted) {
        drop_answers(line);
        return false;
    }
    return (pw_ring_room(&line->out) < most) || (line->pending != (uint8_t)PW_PENDING_NONE);
}

/* The console has put text into `out`, which had held `before` bytes. A host without DTR does not get it (USB-023), so
   that it answers nothing. */
static void keep_text(struct pw_line *line, uint32_t before, bool owed)
{
    if (!line->may_text) {
        line->out.used = before;
        line->owes = owed;
    }
}

static void reply(struct pw_line *line, uint8_t tag, enum pw_answer end, uint16_t size)
{
    const bool done = end == PW_ANSWERED;
    line->answer[0] = tag;
    line->answer[1] = done ? (uint8_t)PW_DONE : (uint8_t)PW_STALL;
    put_frame(line, PW_FRAME_REPLY, line->answer, 2u + (done ? (size_t)size : 0u));
    line->owes = true;
}

static void judge(struct pw_line *line, struct pw_device *device, const uint8_t *block, uint64_t arrived, bool mute)
{
    struct pw_ack ack;
    uint8_t record[PW_ACK];
    pw_device_block(device, line->door, block, PW_BLOCK, arrived, &ack);
    if (!mute) {
        pw_ack_put(record, &ack);
        put_frame(line, PW_FRAME_RECORD, record, PW_ACK);
    }
}

static void judge_what_waits(struct pw_line *line, struct pw_device *device)
{
    if (line->waits && pw_device_has_room(device)) {
        line->waits = false;
        judge(line, device, line->block, line->waits_since, line->waits_mute);
    }
}

/* Asks for what is pending until it ends. A request that has waited for another door is made then. */
static enum pw_answer ask_again(struct pw_line *line, struct pw_device *device, uint16_t *size)
{
    const struct pw_setup setup = line->pending_setup;
    enum pw_answer end = PW_STALLED;
    if (line->pending_asked) {
        end = pw_device_answer(device, line->door, &line->answer[2], size);
    } else if (!line->pending_mute) {
        end = pw_line_ask(line, device, &setup, size);
    } else {
        /* nobody waits for it any more, and the device does not know of it */
    }
    return end;
}

static void finish_what_is_late(struct pw_line *line, struct pw_device *device)
{
    if (line->pending == (uint8_t)PW_PENDING_NONE) {
        return;
    }
    uint16_t size = 0;
    const enum pw_answer end = ask_again(line, device, &size);
    if (end == PW_LATER) {
        return;
    }
    const uint8_t pending = line->pending;
    line->pending = PW_PENDING_NONE;
    if (line->pending_mute) {
        return;
    }
    if (pending == (uint8_t)PW_PENDING_REQUEST) {
        reply(line, line->pending_tag, end, size);
    } else {
        const uint32_t before = line->out.used;
        const bool owed = line->owes;
        pw_console_finish(line, device, end);
        keep_text(line, before, owed);
    }
}

/* Modes (SER-010) -------------------------------------------------------------------------------------------------- */

/* An LF that comes after frames, or from another host, belongs to no CR before them. */
static void forget_typing(struct pw_line *line)
{
    pw_typing_clear(&line->typing);
    line->typing.after_cr = false;
}

static void enter_frames(struct pw_line *line, struct pw_device *device)
{
    const uint8_t zero = 0;
    forget_typing(line);
    line->frames = true;
    pw_ring_put(&line->out, &zero, 1u);
    pw_device_listen(device, line->door, true);
}

/* The block that waits keeps its place, but nobody is told what becomes of it. So it is with what is pending. */
static void leave_frames(struct pw_line *line, struct pw_device *device)
{
    line->frames = false;
    line->frame_size = 0;
    line->too_long = false;
    line->held = false;
    line->waits_mute = line->waits;
    line->pending_mute = line->pending != (uint8_t)PW_PENDING_NONE;
    pw_device_listen(device, line->door, false);
}

static void take_console(struct pw_line *line, struct pw_device *device)
{
    put_frame(line, PW_FRAME_CONSOLE, NULL, 0u);
    leave_frames(line, device);
    const uint32_t before = line->out.used;
    pw_console_prompt(line);
    keep_text(line, before, line->owes);
}

void pw_line_hang_up(struct pw_line *line, struct pw_device *device)
{
    if (line->frames && ((line->frame_size > 0u) || line->too_long)) {
        pw_device_dropped_frame(device);
    }
    leave_frames(line, device);
    forget_typing(line);
    line->typing.echo = true;
    drop_answers(line);
}

/* Frames that arrive ----------------------------------------------------------------------------------------------- */

static void take_block(struct pw_line *line, struct pw_device *device, const uint8_t *block, uint64_t arrived)
{
    if (line->waits) {
        pw_device_dropped_frame(device);
    } else if (pw_device_has_room(device)) {
        judge(line, device, block, arrived, false);
    } else {
        (void)memcpy(line->block, block, PW_BLOCK);
        line->waits = true;
        line->waits_mute = false;
        line->waits_since = arrived;
    }
}

static void take_request(struct pw_line *line, struct pw_device *device, const uint8_t *body)
{
    const struct pw_setup setup = pw_frame_setup(body);
    const uint8_t tag = body[0];
    uint16_t size = 0;
    const enum pw_answer end = pw_line_ask(line, device, &setup, &size);
    if (end == PW_LATER) {
        line->pending = PW_PENDING_REQUEST;
        line->pending_mute = false;
        line->pending_tag = tag;
        return;
    }
    reply(line, tag, end, size);
    const bool restarts = (setup.request == (uint8_t)PW_REQ_RESET) || (setup.request == (uint8_t)PW_REQ_REVERT);
    if (restarts && (end == PW_ANSWERED)) {
        put_frame(line, PW_FRAME_CONSOLE, NULL, 0u);
        leave_frames(line, device);
        line->deaf = true;
    }
}

static void take_frame(struct pw_line *line, struct pw_device *device, uint64_t arrived)
{
    struct pw_frame frame = {0u, NULL, 0u};
    const bool whole = !line->too_long && pw_frame_decode(&frame, line->frame, (size_t)line->frame_size);
    line->frame_size = 0;
    line->too_long = false;
    if (whole && (frame.kind == (uint8_t)PW_FRAME_BLOCK)) {
        take_block(line, device, frame.body, arrived);
    } else if (whole && (frame.kind == (uint8_t)PW_FRAME_REQUEST)) {
        take_request(line, device, frame.body);
    } else if (whole && (frame.kind == (uint8_t)PW_FRAME_CONSOLE)) {
        take_console(line, device);
    } else {
        pw_device_dropped_frame(device);
    }
}

/* The zero that ends a frame: it is taken when its answer has room and is the next in order. Returns whether it is. */
static bool take_zero(struct pw_line *line, struct pw_device *device)
{
    if ((line->frame_size == 0u) && !line->too_long) {
        return true;
    }
    if (!line->held) {
        line->held_since = pw_device_tick(device);
    }
    judge_what_waits(line, device);
    line->held = busy(line, PW_REPLY_MOST);
    if (!line->held) {
        take_frame(line, device, line->held_since);
    }
    return !line->held;
}

static bool take_in_frames(struct pw_line *line, struct pw_device *device, uint8_t byte)
{
    if (byte == 0u) {
        return take_zero(line, device);
    }
    if (line->frame_size < (PW_FRAME_MOST - 1u)) {
        line->frame[line->frame_size] = byte;
        line->frame_size++;
    } else {
        line->too_long = true;
    }
    return true;
}

/* Text that arrives ------------------------------------------------------------------------------------------------ */

static bool take_in_text(struct pw_line *line, struct pw_device *device, uint8_t byte)
{
    const bool may_end = (byte == (uint8_t)'\r') || (byte == (uint8_t)'\n');
    const uint32_t most = may_end ? PW_TEXT_MOST : PW_ECHO_MOST;
    if (busy(line, most)) {
        return false;
    }
    if (byte == 0u) {
        enter_frames(line, device);
    } else {
        const uint32_t before = line->out.used;
        const bool owed = line->owes;
        pw_console_take(line, device, byte);
        keep_text(line, before, owed);
    }
    return true;
}

/* The calls of a port ---------------------------------------------------------------------------------------------- */

void pw_line_begin(struct pw_line *line, uint8_t door, bool is_uart)
{
    (void)memset(line, 0, sizeof *line);
    line->door = door;
    line->is_uart = is_uart;
    line->may_text = is_uart;
    line->typing.echo = true;
}

size_t pw_line_receive(struct pw_line *line, struct pw_device *device, const uint8_t *bytes, size_t size)
{
    size_t taken = 0;
    bool goes_on = true;
    while (goes_on && (taken < size)) {
        if (line->deaf || !pw_device_serving(device)) {
            taken = size;
        } else {
            goes_on = line->frames ? take_in_frames(line, device, bytes[taken])
                                   : take_in_text(line, device, bytes[taken]);
            taken += goes_on ? 1u : 0u;
        }
    }
    return taken;
}

void pw_line_finish(struct pw_line *line, struct pw_device *device, const uint8_t *bytes, size_t size)
{
    line->muted = true;
    (void)pw_line_receive(line, device, bytes, size);
    line->muted = false;
    pw_line_hang_up(line, device);
}

void pw_line_poll(struct pw_line *line, struct pw_device *device)
{
    judge_what_waits(line, device);
    finish_what_is_late(line, device);
}

size_t pw_line_send(struct pw_line *line, struct pw_device *device, uint8_t *bytes, size_t room)
{
    uint8_t record[PW_STATUS];
    struct pw_ring *out = &line->out;
    size_t size = 0;
    /* A block that waited is answered before the record that tells why it could be judged (SER-011). */
    pw_line_poll(line, device);
    if (line->frames && (room > 0u) && (out->used == 0u) && pw_device_tells(device, line->door, record)) {
        put_frame(line, PW_FRAME_RECORD, record, PW_STATUS);
    }
    while ((size < room) && (out->used > 0u)) {
        bytes[size] = out->bytes[out->first];
        size++;
        out->first = (out->first + 1u) % PW_LINE_BYTES;
        out->used--;
    }
    if (line->owes && (out->used == 0u)) {
        line->owes = false;
        line->answered = true;
    }
    return size;
}

bool pw_line_idle(const struct pw_line *line)
{
    return (line->out.used == 0u) && (line->pending == (uint8_t)PW_PENDING_NONE);
}
