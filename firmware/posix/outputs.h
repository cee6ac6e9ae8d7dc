/* What the 320 outputs play, tick by tick, into a file or a pipe. */
#ifndef OUTPUTS_H
#define OUTPUTS_H

#include <signal.h>
#include <stdbool.h>
#include <stdint.h>

#include "config.h"
#include "sigrok.h"

#define OUTPUTS_ROW (4u * PW_PROCESSORS) /* bytes of a tick: a word of each processor, little-endian */

struct outputs {
    const char *path; /* NULL: nothing is recorded */
    const volatile sig_atomic_t *stops; /* not 0: do not wait for whoever reads a pipe */
    bool session;     /* a sigrok session file; otherwise raw words */
    int raw;
    bool failed;
    uint64_t ticks;   /* that were recorded */
    /* A period, and how often it has been played since it was written. */
    uint64_t repeats;
    uint8_t period[OUTPUTS_ROW * PW_TICKS];
    struct sigrok sigrok;
};

/* Whether a path is one that outputs_open takes: FILE.sr, FILE.raw, or a pipe. */
bool outputs_known(const char *path);
bool outputs_is_pipe(const char *path);
/* Waits until somebody reads from a pipe. False: a line on stderr says why, or a signal came (errno is EINTR). */
bool outputs_open(struct outputs *self, const char *path, const volatile sig_atomic_t *stops);
/* The first ticks of a period: the words of all processors. `changed`: they may differ from those of the last call. */
void outputs_play(struct outputs *self, const uint32_t *const words[PW_PROCESSORS], uint32_t ticks, bool changed);
void outputs_silence(struct outputs *self, uint64_t ticks);
/* Gives a pipe what has been played so far. */
void outputs_flush(struct outputs *self);
bool outputs_close(struct outputs *self);

#endif
