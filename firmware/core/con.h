/* Chapter CON: the text console of a serial line. */
#ifndef PW_CON_H
#define PW_CON_H

#include "line.h"

/* Typing and commands: con.c --------------------------------------------------------------------------------------- */

/* A byte was typed; what is sent back for it goes to `shown`. Returns whether it ends the line (CON-003). */
bool pw_typing_take(struct pw_typing *typing, uint8_t byte, struct pw_ring *shown);
/* The line was carried out or is forgotten; the next one begins. */
void pw_typing_clear(struct pw_typing *typing);

/* In the order of CON-005 */
enum pw_command_code {
    PW_CMD_HELP, PW_CMD_VERSION, PW_CMD_INFO, PW_CMD_STATUS, PW_CMD_FAULTS, PW_CMD_CLOCK, PW_CMD_BOARDS, PW_CMD_PULSES,
    PW_CMD_IDENTIFY, PW_CMD_ENABLE, PW_CMD_STOP, PW_CMD_TEST, PW_CMD_WATCHDOG, PW_CMD_LIMIT, PW_CMD_CLEAR, PW_CMD_RESET,
    PW_CMD_DFU, PW_CMD_FRAMES, PW_CMD_ECHO, PW_COMMANDS
};

struct pw_word {
    uint8_t at; /* in the line */
    uint8_t size;
};

/* What a line says. */
struct pw_command {
    uint8_t words; /* 0, 1, 2, or 3 for more */
    struct pw_word word[2];
    uint8_t code; /* enum pw_command_code; PW_COMMANDS if it is none */
    uint16_t argument;
};

/* Returns 0, or the code of CON-006. A line without words is right, and no command. */
uint8_t pw_command_read(struct pw_command *command, const struct pw_typing *typing);
const char *pw_command_name(uint8_t code);

/* A byte of text, not 0, has arrived. Needs room for PW_ECHO_MOST bytes, at the end of a line for PW_TEXT_MOST. */
void pw_console_take(struct pw_line *line, struct pw_device *device, uint8_t byte);
/* The end of a command that was answered LATER; the data stand behind the first two bytes of line->answer. */
void pw_console_finish(struct pw_line *line, struct pw_device *device, enum pw_answer end);
void pw_console_prompt(struct pw_line *line);

/* Answers as text (CON-007): con_answers.c ------------------------------------------------------------------------- */

void pw_text(struct pw_ring *out, const char *text);
void pw_text_number(struct pw_ring *out, uint64_t number);
/* The lines that answer a command: of the data of its request, or of the table of commands. */
void pw_text_info(struct pw_ring *out, const uint8_t *info);
void pw_text_version(struct pw_ring *out, const uint8_t *info);
void pw_text_status(struct pw_ring *out, const uint8_t *status);
void pw_text_faults(struct pw_ring *out, const uint8_t *status);
void pw_text_clock(struct pw_ring *out, const uint8_t *clock);
void pw_text_boards(struct pw_ring *out, const uint8_t *processors);
void pw_text_pulse(struct pw_ring *out, const uint8_t *read_back, uint16_t transducer);
/* Names of codes; NULL if a code has none. */
const char *pw_state_name(uint8_t state);
const char *pw_reason_name(uint8_t reason);

#endif
