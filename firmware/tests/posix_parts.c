/* Parts of the POSIX port, in virtual time: flash, chain, recording, and a whole machine by its lines. */
#define _XOPEN_SOURCE 700
#include "check.h"

#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "factory.h"
#include "machine.h"

#define FILE_ROOM 64u
#define RECORDING_PERIODS 30000u
#define ROW (PW_TICKS * OUTPUTS_ROW)

static char folder[FILE_ROOM];
static volatile sig_atomic_t stops;

static const char *path_of(const char *name)
{
    static char path[4][2u * FILE_ROOM];
    static uint32_t next;
    next = (next + 1u) % 4u;
    (void)snprintf(path[next], sizeof path[next], "%s/%s", folder, name);
    return path[next];
}

/* A whole file; the caller frees it. */
static uint8_t *read_file(const char *path, size_t *size)
{
    uint8_t *bytes = NULL;
    FILE *file = fopen(path, "rb");
    *size = 0;
    CHECK(file != NULL);
    if (file != NULL) {
        (void)fseek(file, 0, SEEK_END);
        *size = (size_t)ftell(file);
        (void)fseek(file, 0, SEEK_SET);
        bytes = malloc(*size + 1u);
        CHECK_EQ(fread(bytes, 1, *size, file), *size);
        (void)fclose(file);
    }
    return bytes;
}

/* Flash ----------------------------------------------------------------------------------------------------------- */

static void test_flash_work(struct flash *flash)
{
    static const uint8_t data[4] = {0x12, 0xF0, 0x0F, 0xFF};
    static const uint8_t more[4] = {0xF7, 0xFF, 0xFC, 0x3C};
    static const uint8_t both[4] = {0x12, 0xF0, 0x0C, 0x3C};
    uint8_t got[4];
    bool blank;
    check_case = "flash";
    CHECK(flash_open(flash, NULL, &blank));
    CHECK(blank);
    CHECK(flash_program(flash, 0, 0x1FE, data, 2));
    CHECK(flash_busy(flash, 0));
    CHECK(!flash_read(flash, 0, got, 1));
    CHECK(!flash_program(flash, 0, 0, data, 1));
    CHECK(!flash_busy(flash, 100000));
    CHECK(!flash_program(flash, 100000, 0x1FE, data, 3)); /* over the end of a page */
    CHECK(!flash_erase(flash, 100000, 0x100));
    CHECK(!flash_erase(flash, 100000, FLASH_SIZE));
    flash->at_once = true;
    CHECK(flash_program(flash, 0, 0x200, data, 4));
    CHECK(flash_program(flash, 0, 0x200, more, 4));
    CHECK(flash_read(flash, 0x200, got, 4));
    CHECK_BYTES(got, both, 4); /* bits are cleared only */
    CHECK(flash_erase(flash, 0, 0));
    CHECK(flash_read(flash, 0x200, got, 4));
    CHECK_EQ(pw_get32(got), 0xFFFFFFFFu);
    CHECK(!flash_read(flash, FLASH_SIZE - 3u, got, 4));
    flash->at_once = false;
    CHECK(flash_program(flash, 0, 0x300, data, 4));
    flash_power_cut(flash); /* half of it was written */
    CHECK(flash_read(flash, 0x300, got, 4));
    CHECK_EQ(pw_get32(got), 0xFFFFF012u);
}

static void test_flash_file(struct flash *flash)
{
    static const uint8_t data[1] = {0x5A};
    const char *path = path_of("flash");
    uint8_t got[1];
    bool blank;
    size_t size;
    check_case = "flash in a file";
    CHECK(flash_open(flash, path, &blank));
    CHECK(blank);
    CHECK(flash_store(flash));
    CHECK(flash_program(flash, 0, 0x200000, data, 1));
    CHECK(!flash_busy(flash, 100000));
    const pid_t child = fork();
    if (child == 0) {
        (void)freopen("/dev/null", "w", stderr);
        _exit(flash_open(flash, path, &blank) ? 1 : 0); /* another process must not have it */
    }
    int status = -1;
    (void)waitpid(child, &status, 0);
    CHECK_EQ(status, 0);
    flash_close(flash);
    CHECK(flash_open(flash, path, &blank));
    CHECK(!blank);
    CHECK(flash_read(flash, 0x200000, got, 1));
    CHECK_EQ(got[0], 0x5A);
    flash_close(flash);
    free(read_file(path, &size));
    CHECK_EQ(size, FLASH_SIZE);
}

/* The chain ------------------------------------------------------------------------------------------------------- */

static void test_chain(struct chain *chain)
{
    static const uint8_t firmware[3] = {1, 2, 3};
    static const uint8_t unique_id[8] = {1, 2, 3, 4, 5, 6, 7, 8};
    uint8_t message[PW_MESSAGE];
    check_case = "chain";
    chain_begin(chain, firmware, unique_id);
    CHECK(!chain_send(chain, message, pw_collect_put(message, 0, PW_END_REPORT))); /* it has no number yet */
    for (uint8_t number = 0; number < PW_PROCESSORS; number++) {
        CHECK(!chain_send(chain, message, pw_number_put(message, number))); /* it has no program yet */
        chain_start_next(chain);
        CHECK(chain_send(chain, message, pw_number_put(message, number)));
        CHECK_EQ(chain->processors[number].number, number);
        const struct chain_answer *answer = &chain->answers[number];
        struct pw_identity identity;
        CHECK_EQ(chain->answer_count, number + 1u);
        CHECK_EQ(answer->message[1], 0xFF);
        CHECK(pw_identity_get(&identity, answer->message + 3, answer->size - 3u));
        CHECK_EQ(identity.last, number == PW_PROCESSORS - 1u ? 1u : 0u);
    }
    CHECK(!chain_send(chain, message, pw_number_put(message, 9))); /* nobody is without a number */
    CHECK(chain_send(chain, message, pw_collect_put(message, 7, PW_END_REPORT)));
    CHECK_EQ(chain->answers[10].message[3], 7);
    CHECK_EQ(chain_due(chain), PW_NEVER);
    chain_sync(chain, 1234);
    CHECK_EQ(chain_due(chain), 1234u + PW_TICKS);
    chain_period(chain);
    CHECK_EQ(chain->processors[9].period, 1);
}

/* Recordings ------------------------------------------------------------------------------------------------------ */

/* Inflates a member into `to`, at most `room` bytes; returns how many. */
static size_t inflate_member(const uint8_t *packed, size_t size, uint8_t *to, size_t room)
{
    z_stream stream;
    memset(&stream, 0, sizeof stream);
    CHECK_EQ(inflateInit2(&stream, -15), Z_OK);
    stream.next_in = packed;
    stream.avail_in = (uInt)size;
    stream.next_out = to;
    stream.avail_out = (uInt)room;
    CHECK_EQ(inflate(&stream, Z_FINISH), Z_STREAM_END);
    (void)inflateEnd(&stream);
    return room - stream.avail_out;
}

/* The samples of a session file, by its directory; the caller frees them. */
static uint8_t *read_session(const char *path, size_t room, size_t *size)
{
    size_t file_size;
    uint8_t *file = read_file(path, &file_size);
    uint8_t *samples = malloc(room + 8192u);
    const uint8_t *end = file + file_size - 22u;
    const uint8_t *at = file + pw_get32(end + 16);
    *size = 0;
    CHECK_EQ(pw_get32(end), 0x06054B50u);
    for (uint32_t i = 0; i < pw_get16(end + 10); i++) {
        const uint8_t *local = file + pw_get32(at + 42);
        const size_t name_size = pw_get16(at + 28);
        uint8_t *to = samples + *size;
        CHECK_EQ(pw_get32(at), 0x02014B50u);
        CHECK_EQ(pw_get32(local), 0x04034B50u);
        CHECK_BYTES(local + 14, at + 16, 12); /* CRC and sizes */
        CHECK_BYTES(local + 30, at + 46, name_size);
        const size_t count = inflate_member(local + 30 + name_size, pw_get32(at + 20), to, room + 8192u - *size);
        CHECK_EQ(count, pw_get32(at + 24));
        CHECK_EQ(crc32(0, to, (uInt)count), pw_get32(at + 16));
        if (memcmp(at + 46, "logic-1-", 8) == 0) {
            *size += count;
        } else if (memcmp(at + 46, "metadata", 8) == 0) {
            to[count] = 0;
            CHECK(strstr((char *)to, "samplerate=2 MHz\n") != NULL);
            CHECK(strstr((char *)to, "unitsize=40\n") != NULL);
            CHECK(strstr((char *)to, "\nprobe1=b0p0_00\n") != NULL);
            CHECK(strstr((char *)to, "\nprobe320=b4p1_31\n") != NULL);
        } else {
            CHECK_EQ(to[0], '2');
        }
        at += 46u + name_size;
    }
    CHECK(at == end);
    free(file);
    return samples;
}

/* Periods that change now and then, or each time; silence, also of some ticks; part of a period. */
static void play(struct outputs *outputs)
{
    static uint32_t words[PW_PROCESSORS][PW_TICKS];
    const uint32_t *at[PW_PROCESSORS];
    for (uint32_t i = 0; i < PW_PROCESSORS; i++) {
        at[i] = words[i];
    }
    memset(words, 0, sizeof words);
    uint32_t rate = 1;
    for (uint32_t period = 0; period < RECORDING_PERIODS; period++) {
        const bool changed = period % rate == 0u;
        if (changed) {
            words[check_below(PW_PROCESSORS)][check_below(PW_TICKS)] ^= check_random();
        }
        outputs_play(outputs, at, PW_TICKS, changed);
        if (check_below(3000) == 0u) {
            rate = 1u + check_below(700);
        }
        if (check_below(3000) == 0u) {
            outputs_play(outputs, at, check_below(PW_TICKS), false);
            outputs_silence(outputs, check_below(20000));
            outputs_play(outputs, at, PW_TICKS, true);
        }
        if (check_below(3000) == 0u) {
            outputs_flush(outputs);
        }
    }
}

static void test_recordings(void)
{
    static struct outputs both[2];
    size_t raw_size;
    size_t session_size;
    check_case = "recording";
    CHECK(outputs_known("a.sr"));
    CHECK(!outputs_known(".sr"));
    CHECK(!outputs_known("a.vcd"));
    CHECK(outputs_open(&both[0], path_of("a.raw"), &stops));
    CHECK(outputs_open(&both[1], path_of("a.sr"), &stops));
    /* The same to both, as the random numbers go on from one period to the next. */
    static uint32_t words[PW_PROCESSORS][PW_TICKS] = {{0x04030201u, 0x80000000u}};
    const uint32_t *at[PW_PROCESSORS];
    for (uint32_t i = 0; i < PW_PROCESSORS; i++) {
        at[i] = words[i];
    }
    words[9][49] = 0x0D0C0B0Au;
    outputs_play(&both[0], at, PW_TICKS, true);
    play(&both[0]);
    CHECK(outputs_close(&both[0]));
    uint8_t *raw = read_file(path_of("a.raw"), &raw_size);
    CHECK_EQ(raw_size, both[0].ticks * OUTPUTS_ROW);
    CHECK_EQ(pw_get32(raw), 0x04030201u);
    CHECK_EQ(raw[OUTPUTS_ROW + 3u], 0x80);
    CHECK_EQ(pw_get32(raw + ROW - 4u), 0x0D0C0B0Au);
    for (size_t done = 0; done < raw_size; done += ROW) { /* what was played, period by period */
        uint32_t again[PW_PROCESSORS][PW_TICKS];
        const size_t left = raw_size - done;
        const uint32_t ticks = (uint32_t)((left < ROW ? left : ROW) / OUTPUTS_ROW);
        for (uint32_t i = 0; i < PW_PROCESSORS * ticks; i++) {
            again[i % PW_PROCESSORS][i / PW_PROCESSORS] = pw_get32(raw + done + 4u * (size_t)i);
            at[i % PW_PROCESSORS] = again[i % PW_PROCESSORS];
        }
        outputs_play(&both[1], at, ticks, true);
    }
    CHECK(outputs_close(&both[1]));
    uint8_t *session = read_session(path_of("a.sr"), raw_size, &session_size);
    CHECK_EQ(session_size, raw_size);
    CHECK_BYTES(session, raw, raw_size);
    free(session);
    free(raw);
}

/* Machines -------------------------------------------------------------------------------------------------------- */

static void type(struct machine *machine, const char *text)
{
    struct pw_line *line = &machine->lines[0].line;
    CHECK_EQ(pw_line_receive(line, &machine->life.device, (const uint8_t *)text, strlen(text)), strlen(text));
}

/* Let time pass until a tick, in steps of so many ticks, as busy computers do. */
static void run_until(struct machine *machine, uint64_t tick, uint64_t step)
{
    uint8_t unread[SERIAL_BUFFER];
    while (machine->tick < tick) {
        const uint64_t next = machine->tick + step;
        machine_advance(machine, next < tick ? next : tick);
        machine_serve(machine);
        if (machine->mode == MACHINE_RUNS) {
            (void)pw_line_send(&machine->lines[0].line, &machine->life.device, unread, sizeof unread);
        }
    }
}

static struct machine *new_machine(const char *recording)
{
    static const uint8_t firmware[3] = {1, 0, 0};
    struct machine *machine = calloc(1, sizeof *machine);
    bool blank;
    CHECK(flash_open(&machine->flash, NULL, &blank));
    factory_image(machine->flash.bytes, firmware);
    machine->serial_number = "TEST";
    CHECK(serial_open(&machine->lines[0], "tcp:0"));
    machine->line_count = 1;
    CHECK(outputs_open(&machine->outputs, recording, &stops));
    machine_begin(machine);
    machine_power_up(machine);
    return machine;
}

static void free_machine(struct machine *machine)
{
    machine_record(machine);
    CHECK(outputs_close(&machine->outputs));
    serial_close(&machine->lines[0]);
    free(machine);
}

static uint64_t since_period; /* of the first update that plays */

/* Plays, lets the watchdog fire, plays on, restarts, and loses its power while it plays. */
static void live(const char *recording, uint64_t step)
{
    struct machine *machine = new_machine(recording);
    CHECK_EQ(machine->mode, MACHINE_RUNS);
    CHECK(pw_device_serving(&machine->life.device));
    run_until(machine, 10011, step);
    type(machine, "enable\rtest 17\r");
    run_until(machine, 30013, step);
    CHECK_EQ(machine->life.device.state, PW_STATE_PLAYING);
    since_period = machine->life.device.since_period;
    type(machine, "test 3\r");
    run_until(machine, 400007, step);
    CHECK_EQ(machine->life.device.state, PW_STATE_OFF); /* by the watchdog */
    CHECK(machine->life.device.watchdog_fired);
    type(machine, "reset\r");
    run_until(machine, 800000, step);
    CHECK(machine->life.device.accepted == 0u);
    type(machine, "enable\rtest 319\r");
    run_until(machine, 810015, step);
    CHECK_EQ(machine->life.device.state, PW_STATE_PLAYING);
    machine_power_cut(machine);
    CHECK_EQ(machine->mode, MACHINE_OFF);
    run_until(machine, 900000, step);
    CHECK_EQ(machine->life.device.state, PW_STATE_OFF);
    CHECK_EQ(machine->life.device.faults, 0);
    free_machine(machine);
}

/* Ticks of the recording in which an output is high. */
static uint32_t high_ticks(const uint8_t *raw, size_t size, uint32_t output)
{
    uint32_t high = 0;
    for (size_t at = 0; at < size; at += OUTPUTS_ROW) {
        high += (uint32_t)(raw[at + output / 8u] >> (output % 8u)) & 1u;
    }
    return high;
}

static uint64_t first_high_tick(const uint8_t *raw, size_t size, uint32_t output)
{
    uint64_t tick = 0;
    while (tick < size / OUTPUTS_ROW && high_ticks(raw + tick * OUTPUTS_ROW, OUTPUTS_ROW, output) == 0u) {
        tick++;
    }
    return tick;
}

static void test_machine(void)
{
    static const uint64_t steps[3] = {2000, 77, 40000};
    uint8_t *first = NULL;
    size_t first_size = 0;
    for (uint32_t i = 0; i < 3u; i++) {
        size_t size;
        check_case = i == 0u ? "machine" : "machine on a busy computer";
        live(path_of("b.raw"), steps[i]);
        uint8_t *raw = read_file(path_of("b.raw"), &size);
        CHECK_EQ(size, 900000u * OUTPUTS_ROW);
        if (i == 0u) {
            first = raw;
            first_size = size;
            /* Transducer 17 stands in the row 0, column 17: board 4, processor 8, bit 15 (machine.c). */
            const uint32_t high = high_ticks(raw, size, 8u * 32u + 15u);
            CHECK(high >= 2u * 395u && high <= 2u * 405u);
            CHECK_EQ(high_ticks(raw, size, 0), 0);
            CHECK_EQ(first_high_tick(raw, size, 8u * 32u + 15u), since_period * PW_TICKS); /* phase 0 begins there */
            CHECK(high_ticks(raw, size, 9u * 32u + 24u) > 0u); /* transducer 319 until the power cut */
        } else {
            /* RESET waits for a line to be served: how soon depends on the computer. What comes before does not. */
            const size_t same = 400000u * OUTPUTS_ROW;
            CHECK(first_size >= same);
            CHECK_BYTES(raw, first, same);
            free(raw);
        }
    }
    free(first);
}

int main(void)
{
    (void)snprintf(folder, sizeof folder, "/tmp/phasewire-parts-XXXXXX");
    CHECK(mkdtemp(folder) != NULL);
    struct flash *flash = malloc(sizeof *flash);
    struct chain *chain = malloc(sizeof *chain);
    memset(flash, 0, sizeof *flash);
    test_flash_work(flash);
    test_flash_file(flash);
    test_chain(chain);
    test_recordings();
    test_machine();
    free(flash);
    free(chain);
    (void)unlink(path_of("flash"));
    (void)unlink(path_of("a.raw"));
    (void)unlink(path_of("a.sr"));
    (void)unlink(path_of("b.raw"));
    (void)rmdir(folder);
    return check_end();
}
