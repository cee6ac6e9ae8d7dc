/* Chapter SER: serial lines. Bytes come in and go out by calls; the port moves them.
   A port calls, for each line: pw_line_receive with what has arrived, pw_line_poll after each pw_device_poll, and
   pw_line_send whenever the line can take bytes. The device has to be begun before. Device and lines belong to one
   context (device.h): an interrupt only moves their bytes. */
#ifndef PW_SER_H
#define PW_SER_H

#include "line.h"

/* Frames (SER-002 to SER-008): pure functions, ser_frames.c -------------------------------------------------------- */

#define PW_BODY_MOST 649u /* bytes of the longest body: SER-002 */

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

#endif
