/* Chapter CON: typing, commands, and what carries them out. */
#include "con.h"

#define BACKSPACE 0x08u
#define DELETE 0x7Fu
#define CANCEL 0x03u
#define CANCEL_LINE 0x15u
#define LINE_FEED 0x0Au
#define CARRIAGE_RETURN 0x0Du
#define SPACE 0x20u
#define TILDE 0x7Eu

/* CON-005. A command with an argument takes one number from `least` to `most`; one with a request asks the device. */
struct row {
    const char *name;
    const char *argument; /* NULL: none */
    const char *meaning;
    uint16_t least;
    uint16_t most;
    uint8_t type; /* of the request; 0: none */
    uint8_t request;
    uint16_t length; /* of its data */
};

static const struct row ROWS[PW_COMMANDS] = {
    {"help", NULL, "list the commands", 0u, 0u, 0u, 0u, 0u},
    {"version", NULL, "versions of protocol and firmware", 0u, 0u, PW_REQUEST_IN, PW_REQ_INFO, 64u},
    {"info", NULL, "what this device is", 0u, 0u, PW_REQUEST_IN, PW_REQ_INFO, 64u},
    {"status", NULL, "what it is doing", 0u, 0u, PW_REQUEST_IN, PW_REQ_STATUS, PW_STATUS},
    {"faults", NULL, "the faults that are set", 0u, 0u, PW_REQUEST_IN, PW_REQ_STATUS, PW_STATUS},
    {"clock", NULL, "its time", 0u, 0u, PW_REQUEST_IN, PW_REQ_CLOCK, 24u},
    {"boards", NULL, "one line for each processor", 0u, 0u, PW_REQUEST_IN, PW_REQ_PROCESSORS, 160u},
    {"pulses", "transducer", "the pulse that a transducer plays", 0u, 319u, PW_REQUEST_IN, PW_REQ_PULSES, 496u},
    {"identify", "board", "blink the light of a board", 0u, 4u, PW_REQUEST_OUT, PW_REQ_IDENTIFY, 0u},
    {"enable", NULL, "enable the outputs", 0u, 0u, PW_REQUEST_OUT, PW_REQ_ENABLE, 0u},
    {"stop", NULL, "silence and disable the outputs; works at any time", 0u, 0u, PW_REQUEST_OUT, PW_REQ_DISABLE, 0u},
    {"test", "transducer", "drive one transducer alone, weakly", 0u, 319u, 0u, 0u, 0u},
    {"watchdog", "ms", "set the watchdog time in ms", 10u, 60000u, PW_REQUEST_OUT, PW_REQ_WATCHDOG, 0u},
    {"limit", "transducers", "set the limit on the total drive", 0u, 320u, PW_REQUEST_OUT, PW_REQ_LIMIT, 0u},
    {"clear", NULL, "clear the faults", 0u, 0u, PW_REQUEST_OUT, PW_REQ_CLEAR_FAULTS, 0u},
    {"reset", NULL, "start again as from power-up", 0u, 0u, PW_REQUEST_OUT, PW_REQ_RESET, 0u},
    {"dfu", NULL, "restart in DFU mode", 0u, 0u, 0u, 0u, 0u},
    {"frames", NULL, "how to go over to frames", 0u, 0u, 0u, 0u, 0u},
    {"echo", "on", "send back what is typed", 0u, 1u, 0u, 0u, 0u},
};

/* Typing (CON-003) ------------------------------------------------------------------------------------------------- */

static bool printable(uint8_t byte)
{
    return (byte >= SPACE) && (byte <= TILDE);
}

static void show(const struct pw_typing *typing, struct pw_ring *shown, const char *text)
{
    if (typing->echo) {
        pw_text(shown, text);
    }
}

/* The characters that were forgotten count as one: taking it back makes the line one of 80 characters again. */
static void take_back(struct pw_typing *typing, struct pw_ring *shown)
{
    if (typing->too_long) {
        typing->too_long = false;
    } else if (typing->size > 0u) {
        typing->size--;
        show(typing, shown, "\b \b");
    } else {
        /* nothing to take back */
    }
}

static void take_character(struct pw_typing *typing, uint8_t byte, struct pw_ring *shown)
{
    if (typing->size == PW_TYPED) {
        typing->too_long = true;
        show(typing, shown, "\a");
        return;
    }
    typing->line[typing->size] = byte;
    typing->size++;
    if (typing->echo) {
        const uint8_t mark = printable(byte) ? byte : (uint8_t)'?';
        pw_ring_put(shown, &mark, 1u);
    }
}

bool pw_typing_take(struct pw_typing *typing, uint8_t byte, struct pw_ring *shown)
{
    const bool second = typing->after_cr && (byte == LINE_FEED);
    const bool ends = (byte == CARRIAGE_RETURN) || ((byte == LINE_FEED) && !second);
    typing->after_cr = byte == CARRIAGE_RETURN;
    if (ends) {
        show(typing, shown, "\r\n");
    } else if ((byte == BACKSPACE) || (byte == DELETE)) {
        take_back(typing, shown);
    } else if ((byte == CANCEL) || (byte == CANCEL_LINE)) {
        while (typing->size > 0u) {
            take_back(typing, shown);
        }
    } else if (!second) {
        take_character(typing, byte, shown);
    } else {
        /* the LF of a CR LF: its line has ended */
    }
    return ends;
}

void pw_typing_clear(struct pw_typing *typing)
{
    typing->size = 0;
    typing->too_long = false;
}

/* Commands (CON-001, CON-006) -------------------------------------------------------------------------------------- */

static void split(struct pw_command *command, const struct pw_typing *typing)
{
    bool in_word = false;
    command->words = 0;
    for (uint8_t i = 0; i < typing->size; i++) {
        const bool space = typing->line[i] == SPACE;
        if (!space && !in_word && (command->words < 3u)) {
            if (command->words < 2u) {
                command->word[command->words].at = i;
                command->word[command->words].size = 0;
            }
            command->words++;
        }
        in_word = !space;
        if (in_word && (command->words < 3u)) {
            command->word[command->words - 1u].size++;
        }
    }
}

static bool is_name(const uint8_t *word, uint8_t size, const char *name)
{
    uint8_t i = 0;
    while ((i < size) && (name[i] != '\0') && (word[i] == (uint8_t)name[i])) {
        i++;
    }
    return (i == size) && (name[i] == '\0');
}

static uint8_t find(const uint8_t *word, uint8_t size)
{
    uint8_t code = 0;
    while ((code < (uint8_t)PW_COMMANDS) && !is_name(word, size, ROWS[code].name)) {
        code++;
    }
    return code;
}

static bool all_digits(const uint8_t *word, uint8_t size)
{
    bool digits = true;
    for (uint8_t i = 0; i < size; i++) {
        digits = digits && (word[i] >= (uint8_t)'0') && (word[i] <= (uint8_t)'9');
    }
    return digits;
}

/* However many digits there are, what is beyond every range stays beyond it. */
static uint32_t number_of(const uint8_t *word, uint8_t size)
{
    uint32_t number = 0;
    for (uint8_t i = 0; i < size; i++) {
        number = (number * 10u) + ((uint32_t)word[i] - (uint32_t)'0');
        if (number > 100000u) {
            number = 100000u;
        }
    }
    return number;
}

static bool any_unprintable(const struct pw_typing *typing)
{
    bool any = false;
    for (uint8_t i = 0; i < typing->size; i++) {
        any = any || !printable(typing->line[i]);
    }
    return any;
}

/* The checks from ARGUMENTS on, of a line that names a command. */
static uint8_t read_argument(struct pw_command *command, const struct pw_typing *typing)
{
    const struct row *row = &ROWS[command->code];
    if (row->argument == NULL) {
        return (command->words == 1u) ? 0u : (uint8_t)PW_CONSOLE_ARGUMENTS;
    }
    if (command->words != 2u) {
        return (uint8_t)PW_CONSOLE_ARGUMENTS;
    }
    const uint8_t *word = &typing->line[command->word[1].at];
    if (!all_digits(word, command->word[1].size)) {
        return (uint8_t)PW_CONSOLE_ARGUMENTS;
    }
    const uint32_t number = number_of(word, command->word[1].size);
    if ((number < row->least) || (number > row->most)) {
        return (uint8_t)PW_CONSOLE_RANGE;
    }
    command->argument = (uint16_t)number;
    return 0u;
}

uint8_t pw_command_read(struct pw_command *command, const struct pw_typing *typing)
{
    uint8_t code = 0;
    command->code = PW_COMMANDS;
    command->argument = 0;
    split(command, typing);
    if (command->words > 0u) {
        command->code = find(&typing->line[command->word[0].at], command->word[0].size);
    }
    if (typing->too_long) {
        code = PW_CONSOLE_LENGTH;
    } else if (any_unprintable(typing)) {
        code = PW_CONSOLE_CHARACTER;
    } else if (command->words == 0u) {
        code = 0;
    } else if (command->code == (uint8_t)PW_COMMANDS) {
        code = PW_CONSOLE_COMMAND;
    } else {
        code = read_argument(command, typing);
    }
    return code;
}

const char *pw_command_name(uint8_t code)
{
    return (code < (uint8_t)PW_COMMANDS) ? ROWS[code].name : NULL;
}

/* Errors (CON-002) ------------------------------------------------------------------------------------------------- */

static void begin_error(struct pw_ring *out, enum pw_console_code code)
{
    pw_text(out, "error ");
    pw_text_number(out, (uint64_t)code);
    pw_text(out, " ");
}

static void put_takes(struct pw_ring *out, const struct row *row)
{
    pw_text(out, row->name);
    pw_text(out, " takes ");
    if (row->argument == NULL) {
        pw_text(out, "no argument");
    } else {
        pw_text(out, row->argument);
        pw_text(out, " ");
        pw_text_number(out, row->least);
        pw_text(out, " to ");
        pw_text_number(out, row->most);
    }
}

static void put_error(struct pw_ring *out, uint8_t code, const struct pw_command *command,
                      const struct pw_typing *typing)
{
    begin_error(out, (enum pw_console_code)code);
    switch (code) {
    case PW_CONSOLE_LENGTH:
        pw_text(out, "more than 80 characters");
        break;
    case PW_CONSOLE_CHARACTER:
        pw_text(out, "a character that is not printable ASCII");
        break;
    case PW_CONSOLE_COMMAND:
        pw_text(out, "no command ");
        pw_ring_put(out, &typing->line[command->word[0].at], (size_t)command->word[0].size);
        pw_text(out, "; help lists them");
        break;
    case PW_CONSOLE_ARGUMENTS:
        put_takes(out, &ROWS[command->code]);
        break;
    default:
        put_takes(out, &ROWS[command->code]);
        pw_text(out, ", not ");
        pw_ring_put(out, &typing->line[command->word[1].at], (size_t)command->word[1].size);
        break;
    }
    pw_text(out, "\r\n");
}

/* Why the device refused a command. It answers STALL and no more, so the reason is that of the request's clause. */
static void put_refusal(struct pw_ring *out, const struct pw_device *device, uint8_t code)
{
    const char *name = pw_state_name((uint8_t)device->state);
    begin_error(out, PW_CONSOLE_REFUSED);
    if (code == (uint8_t)PW_CMD_PULSES) {
        pw_text(out, "what plays cannot be read");
    } else if ((code == (uint8_t)PW_CMD_LIMIT) && pw_state_enabled(device->state)) {
        pw_text(out, "not while the outputs are enabled");
    } else if (code == (uint8_t)PW_CMD_LIMIT) {
        pw_text(out, "more than the limit at power-up");
    } else {
        pw_text(out, "not in state ");
        pw_text(out, (name != NULL) ? name : "unknown");
    }
    pw_text(out, "\r\n");
}

/* CON-008: the text begins with the reason's name. */
static void put_test_refusal(struct pw_ring *out, int reason)
{
    const char *name = (reason > 0) ? pw_reason_name((uint8_t)reason) : NULL;
    begin_error(out, PW_CONSOLE_REFUSED);
    pw_text(out, (name != NULL) ? name : "the queue has no room");
    if (reason == (int)PW_FAULTED) {
        pw_text(out, ": a fault is not cleared");
    } else if (reason == (int)PW_DISABLED) {
        pw_text(out, ": the outputs are not enabled");
    } else if (reason == (int)PW_DRIVE) {
        pw_text(out, ": more power than the limit");
    } else {
        /* the name says enough */
    }
    pw_text(out, "\r\n");
}

/* Answers ---------------------------------------------------------------------------------------------------------- */

static void put_help(struct pw_ring *out)
{
    for (uint8_t i = 0; i < (uint8_t)PW_COMMANDS; i++) {
        pw_text(out, ROWS[i].name);
        if (ROWS[i].argument != NULL) {
            pw_text(out, " ");
            for (const char *letter = ROWS[i].argument; *letter != '\0'; letter++) {
                const uint8_t capital = (uint8_t)(*letter - ('a' - 'A'));
                pw_ring_put(out, &capital, 1u);
            }
        }
        pw_text(out, ": ");
        pw_text(out, ROWS[i].meaning);
        pw_text(out, "\r\n");
    }
}

static void put_answer(struct pw_ring *out, uint8_t code, const uint8_t *data, uint16_t argument)
{
    switch (code) {
    case PW_CMD_HELP:
        put_help(out);
        break;
    case PW_CMD_VERSION:
        pw_text_version(out, data);
        break;
    case PW_CMD_INFO:
        pw_text_info(out, data);
        break;
    case PW_CMD_STATUS:
        pw_text_status(out, data);
        break;
    case PW_CMD_FAULTS:
        pw_text_faults(out, data);
        break;
    case PW_CMD_CLOCK:
        pw_text_clock(out, data);
        break;
    case PW_CMD_BOARDS:
        pw_text_boards(out, data);
        break;
    case PW_CMD_PULSES:
        pw_text_pulse(out, data, argument);
        break;
    case PW_CMD_FRAMES:
        pw_text(out, "frames: send the byte 00\r\n");
        break;
    default:
        /* nothing to say */
        break;
    }
    pw_text(out, "ok\r\n");
}

void pw_console_prompt(struct pw_line *line)
{
    pw_text(&line->out, "> ");
}

void pw_console_finish(struct pw_line *line, struct pw_device *device, enum pw_answer end)
{
    const uint8_t code = line->pending_tag;
    if (end == PW_ANSWERED) {
        put_answer(&line->out, code, &line->answer[2], line->pending_argument);
        line->deaf = line->deaf || (code == (uint8_t)PW_CMD_RESET);
    } else {
        put_refusal(&line->out, device, code);
    }
    pw_console_prompt(line);
    line->owes = true;
}

static void put_test(struct pw_line *line, struct pw_device *device, uint16_t transducer)
{
    const int reason = pw_device_test(device, line->door, transducer);
    if (reason == (int)PW_ACCEPTED) {
        pw_text(&line->out, "ok\r\n");
    } else {
        put_test_refusal(&line->out, reason);
    }
    pw_console_prompt(line);
    line->owes = true;
}

static enum pw_answer ask(struct pw_line *line, struct pw_device *device, const struct pw_command *command)
{
    const struct row *row = &ROWS[command->code];
    struct pw_setup setup = {row->type, row->request, 0u, 0u, row->length};
    uint16_t size = 0;
    if (row->type == PW_REQUEST_OUT) {
        setup.value = command->argument;
    }
    return pw_line_ask(line, device, &setup, &size);
}

static void carry_out(struct pw_line *line, struct pw_device *device, const struct pw_command *command)
{
    enum pw_answer end = PW_ANSWERED;
    line->pending_tag = command->code;
    line->pending_argument = command->argument;
    if (ROWS[command->code].type != 0u) {
        end = ask(line, device, command);
    } else if (command->code == (uint8_t)PW_CMD_DFU) {
        end = pw_device_detach(device, line->door) ? PW_ANSWERED : PW_STALLED;
    } else if (command->code == (uint8_t)PW_CMD_ECHO) {
        line->typing.echo = command->argument == 1u;
    } else {
        /* it only tells something */
    }
    if (end == PW_LATER) {
        line->pending = PW_PENDING_COMMAND;
        line->pending_mute = false;
    } else {
        pw_console_finish(line, device, end);
    }
}

void pw_console_take(struct pw_line *line, struct pw_device *device, uint8_t byte)
{
    struct pw_command command;
    if (!pw_typing_take(&line->typing, byte, &line->out)) {
        return;
    }
    const uint8_t error = pw_command_read(&command, &line->typing);
    if (error != 0u) {
        put_error(&line->out, error, &command, &line->typing);
        pw_console_prompt(line);
    } else if (command.words == 0u) {
        pw_console_prompt(line);
    } else if (command.code == (uint8_t)PW_CMD_TEST) {
        put_test(line, device, command.argument);
    } else {
        carry_out(line, device, &command);
    }
    pw_typing_clear(&line->typing);
}
