/* Chapters SER and CON: the state of a serial line, which its modes share: frames (ser.h) and console (con.h). */
#ifndef PW_LINE_H
#define PW_LINE_H

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
#define PW_FRAME_MOST 658u /* bytes of the longest frame, its zero included: SER-005 */

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

/* Ask the device; the data come behind the first two bytes of line->answer. The device reads the pulses for
   one door at a time: if it does so for another one, the request waits and ends LATER too. Then the caller says in
   line->pending what it is, and the line finishes it. */
enum pw_answer pw_line_ask(struct pw_line *line, struct pw_device *device, const struct pw_setup *setup,
                           uint16_t *size);

#endif
