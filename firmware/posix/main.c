/* phasewire-reference: the reference device as a process. */
#define _XOPEN_SOURCE 700
#include <errno.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/select.h>
#include <time.h>

#include "factory.h"
#include "machine.h"

#define ADDRESS "127.0.0.1"
#define BUS_ID "1-1"
#define SERIAL_NUMBER "REFERENCE-1"
#define NANOSECONDS_PER_TICK 500u
#define TICKS_PER_MS ((uint64_t)PW_TICKS_PER_MS)
#define LAG_TICKS (30u * TICKS_PER_MS) /* that a watchdog of 100 ms forgives */
#define LONGEST_WAIT_US 1000u
#define SHORTEST_WAIT_US 100u
#define NAME_ROOM 512u

static const uint8_t FIRMWARE[3] = {1, 0, 0};

static const char USAGE[] =
    "usage: phasewire-reference [--serial tcp:PORT|pty:PATH]... [--usbip PORT] [--flash FILE]\n"
    "                           [--outputs FILE.sr|FILE.raw] [--serial-number TEXT] [--full-speed]\n"
    "PORT 0 picks one. A line of JSON on stdout tells what it listens on, on 127.0.0.1 alone.\n"
    "SIGTERM and SIGINT end it; SIGUSR1 cuts the power of the device and brings it back.\n";

/* Signals --------------------------------------------------------------------------------------------------------- */

static volatile sig_atomic_t stops;
static volatile sig_atomic_t power_cut;

static void on_signal(int number)
{
    if (number == SIGUSR1) {
        power_cut = 1;
    } else {
        stops = 1;
    }
}

static void catch_signals(void)
{
    struct sigaction action;
    memset(&action, 0, sizeof action);
    (void)sigemptyset(&action.sa_mask);
    action.sa_handler = on_signal; /* without SA_RESTART: what waits for a pipe is interrupted */
    (void)sigaction(SIGTERM, &action, NULL);
    (void)sigaction(SIGINT, &action, NULL);
    (void)sigaction(SIGUSR1, &action, NULL);
    action.sa_handler = SIG_IGN;
    (void)sigaction(SIGPIPE, &action, NULL);
}

/* Options --------------------------------------------------------------------------------------------------------- */

struct options {
    const char *serial[MACHINE_LINES];
    uint32_t serial_count;
    long usbip; /* -1: none */
    const char *flash;
    const char *outputs;
    const char *serial_number;
    bool full_speed;
};

static void refuse(const char *why, const char *what)
{
    fprintf(stderr, "phasewire-reference: %s: %s\n", what, why);
    exit(2);
}

static long usbip_port_of(const char *text)
{
    char *end;
    const long port = strtol(text, &end, 10);
    if (text[0] < '0' || text[0] > '9' || *end != '\0' || port > 65535) {
        refuse("not a port, 0 to 65535", text);
    }
    return port;
}

static const char *serial_number_of(const char *text)
{
    static const char allowed[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789.-_";
    const size_t size = strlen(text);
    if (size == 0u || size > 64u || strspn(text, allowed) != size) {
        refuse("a serial number has 1 to 64 letters, digits, dots, hyphens and underscores", text);
    }
    return text;
}

static void take_serial(struct options *options, const char *text)
{
    if (!serial_known(text)) {
        refuse("a serial line is tcp:PORT or pty:PATH", text);
    }
    if (options->serial_count == MACHINE_LINES) {
        refuse("too many serial lines", text);
    }
    options->serial[options->serial_count] = text;
    options->serial_count++;
}

static void take_option(struct options *options, const char *option, const char *value)
{
    if (value == NULL) {
        refuse("takes a value", option);
    }
    if (strcmp(option, "--serial") == 0) {
        take_serial(options, value);
    } else if (strcmp(option, "--usbip") == 0) {
        options->usbip = usbip_port_of(value);
    } else if (strcmp(option, "--flash") == 0) {
        options->flash = value;
    } else if (strcmp(option, "--serial-number") == 0) {
        options->serial_number = serial_number_of(value);
    } else if (outputs_known(value)) {
        options->outputs = value;
    } else {
        refuse("outputs go to FILE.sr, FILE.raw or a pipe", value);
    }
}

static bool takes_value(const char *option)
{
    static const char *const with_value[] = {"--serial", "--usbip", "--flash", "--outputs", "--serial-number"};
    for (size_t i = 0; i < sizeof with_value / sizeof with_value[0]; i++) {
        if (strcmp(option, with_value[i]) == 0) {
            return true;
        }
    }
    return false;
}

static void read_options(struct options *options, int count, char **arguments)
{
    memset(options, 0, sizeof *options);
    options->usbip = -1;
    options->serial_number = SERIAL_NUMBER;
    for (int i = 1; i < count; i++) {
        if (strcmp(arguments[i], "--help") == 0) {
            (void)fputs(USAGE, stdout);
            exit(0);
        }
        if (strcmp(arguments[i], "--full-speed") == 0) {
            options->full_speed = true;
        } else if (takes_value(arguments[i])) {
            take_option(options, arguments[i], arguments[i + 1]);
            i++;
        } else {
            refuse("no such option; --help lists them", arguments[i]);
        }
    }
    if (options->serial_count == 0u && options->usbip < 0) {
        refuse("one of them is needed, or nobody can reach the device", "--serial, --usbip");
    }
}

/* Beginning ------------------------------------------------------------------------------------------------------- */

static bool open_flash(struct machine *machine, const char *path)
{
    bool blank;
    if (!flash_open(&machine->flash, path, &blank)) {
        return false;
    }
    if (!blank) {
        return true;
    }
    factory_image(machine->flash.bytes, FIRMWARE);
    return flash_store(&machine->flash);
}

static bool open_doors(struct machine *machine, const struct options *options)
{
    for (uint32_t i = 0; i < options->serial_count; i++) {
        if (!serial_open(&machine->lines[i], options->serial[i])) {
            return false;
        }
        machine->line_count = i + 1u;
    }
    if (options->usbip < 0) {
        return true;
    }
    machine->usbip = usbip_open(ADDRESS, (uint16_t)options->usbip, &machine->life.usb, BUS_ID);
    if (machine->usbip == NULL) {
        fprintf(stderr, "phasewire-reference: usbip %ld: %s\n", options->usbip, strerror(errno));
        return false;
    }
    usbip_clock(machine->usbip, &machine->tick);
    return true;
}

static void print_text(const char *text)
{
    (void)putchar('"');
    for (const char *at = text; *at != '\0'; at++) {
        if (*at == '"' || *at == '\\') {
            (void)putchar('\\');
        }
        (void)putchar(*at);
    }
    (void)putchar('"');
}

static void print_doors(const struct machine *machine)
{
    char text[NAME_ROOM];
    (void)fputs("{\"serial\": [", stdout);
    for (uint32_t i = 0; i < machine->line_count; i++) {
        (void)fputs(i == 0u ? "" : ", ", stdout);
        serial_name(&machine->lines[i], text, sizeof text);
        print_text(text);
    }
    if (machine->usbip == NULL) {
        (void)fputs("], \"usbip\": null}\n", stdout);
    } else {
        (void)printf("], \"usbip\": %d}\n", usbip_port(machine->usbip));
    }
    (void)fflush(stdout);
}

/* Running --------------------------------------------------------------------------------------------------------- */

static uint64_t nanoseconds(void)
{
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint64_t)now.tv_sec * 1000000000u + (uint64_t)now.tv_nsec;
}

static void wait_for(const struct machine *machine, long microseconds)
{
    struct pollfd fds[MACHINE_FDS];
    fd_set reads;
    fd_set writes;
    struct timespec timeout = {0, microseconds * 1000};
    int most = -1;
    const uint32_t count = machine_poll(machine, fds);
    FD_ZERO(&reads);
    FD_ZERO(&writes);
    for (uint32_t i = 0; i < count; i++) {
        if ((fds[i].events & POLLIN) != 0) {
            FD_SET(fds[i].fd, &reads);
        }
        if ((fds[i].events & POLLOUT) != 0) {
            FD_SET(fds[i].fd, &writes);
        }
        most = fds[i].fd > most ? fds[i].fd : most;
    }
    (void)pselect(most + 1, &reads, &writes, NULL, &timeout, NULL);
}

/* How long nothing has to be done that anybody could see. */
static long wait_of(const struct machine *machine)
{
    if (machine->usbip != NULL && usbip_wants_step(machine->usbip)) {
        return 0;
    }
    const uint64_t due = machine_due(machine);
    const uint64_t ticks = due <= machine->tick ? 0u : due - machine->tick;
    if (ticks >= 2u * LONGEST_WAIT_US) {
        return (long)LONGEST_WAIT_US;
    }
    const long microseconds = (long)ticks / 2; /* 0.5 us each */
    return microseconds < (long)SHORTEST_WAIT_US ? (long)SHORTEST_WAIT_US : microseconds;
}

/* How far to go before looking at the doors: all the way, as a host that has waited for a time must find it over. But
   if the computer was so busy that the watchdog might fire, what had arrived meanwhile is to be heard in time. */
static uint64_t next_tick(const struct machine *machine, uint64_t target)
{
    const enum pw_state state = machine->life.device.state;
    const bool watched = machine->mode == MACHINE_RUNS && (state == PW_STATE_READY || state == PW_STATE_PLAYING);
    return watched && target > machine->tick + LAG_TICKS ? machine->tick + TICKS_PER_MS : target;
}

static void run(struct machine *machine)
{
    const uint64_t since = nanoseconds();
    machine_power_up(machine);
    while (stops == 0 && !machine->dead) {
        const uint64_t target = (nanoseconds() - since) / NANOSECONDS_PER_TICK;
        const uint64_t next = next_tick(machine, target);
        if (power_cut != 0) {
            power_cut = 0;
            machine_power_cut(machine);
        }
        machine_advance(machine, next);
        machine_serve(machine);
        outputs_flush(&machine->outputs);
        wait_for(machine, next < target ? 0 : wait_of(machine));
    }
    machine_record(machine);
}

static bool open_outputs(struct machine *machine, const char *path)
{
    bool opened = outputs_open(&machine->outputs, path, &stops);
    while (!opened && errno == EINTR && stops == 0) {
        opened = outputs_open(&machine->outputs, path, &stops);
    }
    return opened;
}

static void close_all(struct machine *machine)
{
    for (uint32_t i = 0; i < machine->line_count; i++) {
        serial_close(&machine->lines[i]);
    }
    if (machine->usbip != NULL) {
        usbip_close(machine->usbip);
    }
    flash_close(&machine->flash);
}

int main(int count, char **arguments)
{
    static struct machine machine;
    struct options options;
    read_options(&options, count, arguments);
    catch_signals();
    machine.serial_number = options.serial_number;
    machine.full_speed = options.full_speed;
    /* Somebody may wait for the line of JSON before it reads from the pipe. */
    const bool pipe = options.outputs != NULL && outputs_is_pipe(options.outputs);
    bool good = open_flash(&machine, options.flash) && open_doors(&machine, &options)
        && (pipe || open_outputs(&machine, options.outputs));
    if (good) {
        print_doors(&machine);
        good = !pipe || open_outputs(&machine, options.outputs);
    }
    if (good) {
        machine_begin(&machine);
        run(&machine);
        good = outputs_close(&machine.outputs) && !machine.dead;
    }
    close_all(&machine);
    return good || stops != 0 ? 0 : 1;
}
