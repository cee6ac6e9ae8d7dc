/* Chapter SER: serial lines. Bytes come in and go out by calls; the port moves them.
   A port calls, for each line: pw_line_receive with what has arrived, pw_line_poll after each pw_device_poll, and
   pw_line_send whenever the line can take bytes. The device has to be begun before. Device and lines belong to one
   context (device.h): an interrupt only moves their bytes. */
#ifndef PW_SER_H
#define PW_SER_H

#include "device.h"

#ifndef PW_LINE_BYTES
#define PW_LINE_BYTES 4096u /* that wait to be sent on a line */
#endif
#define PW_TEXT_MOST 2048u /* bytes of the longest answer of the console: `boards` has 1878 */
#define PW_ECHO_MOST 256u  /* bytes of the longest echo: a line is taken back by 240 */
#define PW_REPLY_MOST 768u /* bytes of the longest answer in frames, and of that to a block that waits: 698 */
#if PW_LINE_BYTES < (PW_TEXT_MOST + PW_ECHO_MOST)
#error "PW_LINE_BYTES is too small: the longest answer has to fit"
#endif

/* Frames (SER-002 to SER-008): pure functions, ser_frames.c -------------------------------------------------------- */

#define PW_FRAME_MOST 658u /* bytes of the longest frame, its zero included: SER-005 */
#define PW_BODY_MOST 649u  /* bytes of the longest body: SER-002 */

struct pw_frame {
    uint8_t kind;        /* enum pw_frame_kind */
    const uint8_t *body; /* within the bytes that were decoded */
    size_t size;         /* of the body */
};

/* Writes the frame of a body of at most PW_BODY_MOST bytes, its zero included, and returns its size. */
size_t pw_frame_encode(uint8_t frame[PW_FRAME_MOST], uint8_t kind, const uint8_t *body, size_t size);
/* Takes a frame without its zero and decodes it in place. False: it is damaged (SER-006). The direction of its kind is
   not judged. */
bool pw_frame_decode(struct pw_frame *frame, uint8_t *bytes, size_t size);
/* The SETUP packet of a REQUEST's body (SER-007). */
struct pw_setup pw_frame_setup(const uint8_t *body);

/* Lines: ser.c ----------------------------------------------------------------------------------------------------- */

/* Bytes that wait to be sent. */
struct pw_ring {
    uint32_t first;
    uint32_t used;
    uint8_t bytes[PW_LINE_BYTES];
};
uint32_t pw_ring_room(const struct pw_ring *ring);
/* What does not fit is left out as a whole; a caller sees to it that it fits. */
void pw_ring_put(struct pw_ring *ring, const uint8_t *bytes, size_t size);

/* A line of text that is being typed (CON-003). */
#define PW_TYPED 80u
struct pw_typing {
    uint8_t line[PW_TYPED];
    uint8_t size;
    bool too_long; /* a character was forgotten */
    bool after_cr; /* an LF that comes now belongs to it */
    bool echo;
};

/* What the device answers LATER. */
enum pw_pending { PW_PENDING_NONE, PW_PENDING_REQUEST, PW_PENDING_COMMAND };

struct pw_line {
    /* For the port. */
    bool may_text; /* the port writes it: DTR of CDC-ACM (USB-023). A UART always may. Hang up when DTR falls. */
    bool deaf;     /* what arrives is lost: the port sets it in DFU mode (STA-005), the line after RESET and REVERT */
    bool answered; /* a request or a command was answered, and the answer fetched (FWU-020); stays set */
    /* The mode (SER-010). Answers keep the order of what they answer, so one mode tells both directions: the host's
       now, and that of the end of `out`. */
    bool frames;
    uint8_t door;
    bool is_uart;
    bool owes;  /* `answered` follows when `out` is empty */
    bool muted; /* within pw_line_finish: nobody gets the answers */
    /* The frame that arrives. */
    bool too_long;
    bool held; /* its zero was not taken yet; it had arrived at held_since */
    uint64_t held_since;
    uint16_t frame_size;
    uint8_t frame[PW_FRAME_MOST];
    /* The block that waits (SER-011). */
    bool waits;
    bool waits_mute; /* its answer is not to be sent: SER-010 */
    uint64_t waits_since;
    uint8_t block[PW_BLOCK];
    /* What is answered LATER. Until then nothing that came after it is carried out. */
    uint8_t pending; /* enum pw_pending */
    bool pending_mute;
    bool pending_asked;  /* the device has it; otherwise it waits until another door has its pulses */
    uint8_t pending_tag; /* of the REQUEST, or the place of the command in CON-005 */
    uint16_t pending_argument;
    struct pw_setup pending_setup;
    uint8_t answer[2u + PW_ANSWER]; /* tag, outcome and data of a REPLY */
    struct pw_typing typing;
    struct pw_ring out;
};

/* Power-up and RESET: the line begins with the console. */
void pw_line_begin(struct pw_line *line, uint8_t door, bool is_uart);
/* Bytes have arrived. Returns how many of them the line took; the port offers the others again (USB answers NAK
   meanwhile). It takes fewer only while something is answered LATER, or while the answers have no room because nobody
   fetches them (SER-013). While the device does not serve yet it takes and drops all (TIM-002). */
size_t pw_line_receive(struct pw_line *line, struct pw_device *device, const uint8_t *bytes, size_t size);
/* What is to be sent next, at most `room` bytes. */
size_t pw_line_send(struct pw_line *line, struct pw_device *device, uint8_t *bytes, size_t room);
/* Judges the block that waits once there is room, and finishes what is answered LATER. */
void pw_line_poll(struct pw_line *line, struct pw_device *device);
/* Break, DTR low, the end of a connection; on CDC-ACM bus reset and SET_CONFIGURATION. */
void pw_line_hang_up(struct pw_line *line, struct pw_device *device);
/* The same, for a port that has bytes left which pw_line_receive did not take: of them it carries out what had arrived
   whole before, unanswered (SER-010). */
void pw_line_finish(struct pw_line *line, struct pw_device *device, const uint8_t *bytes, size_t size);
/* Whether every answer is sent: a port restarts the device after that. */
bool pw_line_idle(const struct pw_line *line);
/* For con.c: ask the device; the data come behind the first two bytes of line->answer. The device reads the pulses for
   one door at a time: if it does so for another one, the request waits and ends LATER too. Then the caller says in
   line->pending what it is, and the line finishes it. */
enum pw_answer pw_line_ask(struct pw_line *line, struct pw_device *device, const struct pw_setup *setup,
                           uint16_t *size);

#endif
