/* The recording. The same period again and again is counted, and written when another follows. */
#define _XOPEN_SOURCE 700
#include "outputs.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static bool ends_with(const char *text, const char *end)
{
    const size_t size = strlen(text);
    const size_t end_size = strlen(end);
    return size > end_size && strcmp(text + size - end_size, end) == 0;
}

bool outputs_is_pipe(const char *path)
{
    struct stat about;
    return stat(path, &about) == 0 && S_ISFIFO(about.st_mode);
}

bool outputs_known(const char *path)
{
    return ends_with(path, ".sr") || ends_with(path, ".raw") || outputs_is_pipe(path);
}

static void complain(const struct outputs *self, const char *why)
{
    fprintf(stderr, "phasewire-reference: outputs %s: %s\n", self->path, why);
}

bool outputs_open(struct outputs *self, const char *path, const volatile sig_atomic_t *stops)
{
    self->path = path;
    self->stops = stops;
    self->failed = false;
    self->ticks = 0;
    self->repeats = 0;
    self->raw = -1;
    if (path == NULL) {
        return true;
    }
    self->session = ends_with(path, ".sr") && !outputs_is_pipe(path);
    bool opened;
    errno = 0;
    if (self->session) {
        opened = sigrok_open(&self->sigrok, path);
    } else {
        self->raw = open(path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
        opened = self->raw >= 0;
    }
    if (!opened && errno != EINTR) {
        complain(self, strerror(errno));
    }
    if (!opened) {
        self->path = NULL;
    }
    return opened;
}

static bool write_raw(struct outputs *self, const uint8_t *bytes, size_t size)
{
    size_t done = 0;
    while (done < size) {
        const ssize_t count = write(self->raw, bytes + done, size - done);
        if (count < 0 && (errno != EINTR || *self->stops != 0)) {
            return false;
        }
        done += count < 0 ? 0u : (size_t)count;
    }
    return true;
}

static void write_out(struct outputs *self, size_t size, uint64_t repeats)
{
    if (self->failed) {
        return;
    }
    bool written = true;
    if (self->session) {
        written = sigrok_write(&self->sigrok, self->period, size, repeats);
    } else {
        for (uint64_t i = 0; i < repeats && written; i++) {
            written = write_raw(self, self->period, size);
        }
    }
    if (!written) {
        self->failed = true; /* the device goes on without */
        complain(self, "the recording ends here: it is full, or nobody takes it");
    }
}

static void write_repeats(struct outputs *self)
{
    if (self->repeats != 0u) {
        write_out(self, sizeof self->period, self->repeats);
        self->repeats = 0;
    }
}

void outputs_flush(struct outputs *self)
{
    if (self->path != NULL && !self->session) {
        write_repeats(self);
    }
}

/* `period` holds what the last whole period was, and its repeats were counted or written. */
static void take(struct outputs *self, const uint8_t *rows, uint32_t ticks)
{
    const size_t size = OUTPUTS_ROW * (size_t)ticks;
    if (ticks != PW_TICKS || memcmp(self->period, rows, size) != 0) {
        write_repeats(self);
        memcpy(self->period, rows, size);
    }
    if (ticks == PW_TICKS) {
        self->repeats++;
    } else {
        write_out(self, size, 1);
    }
}

void outputs_play(struct outputs *self, const uint32_t *const words[PW_PROCESSORS], uint32_t ticks, bool changed)
{
    if (self->path == NULL || ticks == 0u) {
        return;
    }
    self->ticks += ticks;
    if (!changed && ticks == PW_TICKS && self->repeats != 0u) {
        self->repeats++;
        return;
    }
    uint8_t rows[OUTPUTS_ROW * PW_TICKS];
    uint8_t *at = rows;
    for (uint32_t tick = 0; tick < ticks; tick++) {
        for (uint32_t i = 0; i < PW_PROCESSORS; i++) {
            const uint32_t word = words[i][tick];
            at[0] = (uint8_t)(word & 0xFFu);
            at[1] = (uint8_t)((word >> 8) & 0xFFu);
            at[2] = (uint8_t)((word >> 16) & 0xFFu);
            at[3] = (uint8_t)(word >> 24);
            at += 4;
        }
    }
    take(self, rows, ticks);
}

void outputs_silence(struct outputs *self, uint64_t ticks)
{
    static const uint8_t silence[OUTPUTS_ROW * PW_TICKS] = {0};
    if (self->path == NULL || ticks == 0u) {
        return;
    }
    self->ticks += ticks;
    const uint64_t periods = ticks / PW_TICKS;
    if (periods != 0u) {
        take(self, silence, PW_TICKS);
        self->repeats += periods - 1u;
    }
    if (ticks % PW_TICKS != 0u) {
        take(self, silence, (uint32_t)(ticks % PW_TICKS));
    }
}

bool outputs_close(struct outputs *self)
{
    if (self->path == NULL) {
        return true;
    }
    write_repeats(self);
    bool closed = !self->failed;
    if (self->session) {
        closed = sigrok_close(&self->sigrok) && closed;
    } else {
        closed = close(self->raw) == 0 && closed;
    }
    self->path = NULL;
    return closed;
}
