/* The flash behind the controller, with what is wrong with it. */
#ifndef MEMORY_H
#define MEMORY_H

#include "../posix/flash.h"
#include "faults.h"

struct memory {
    struct faults *faults;
    bool failed;         /* the last work did, as the status register says */
    bool cut;            /* the power goes within what the flash is doing */
    bool dead;           /* it has gone */
    uint64_t cut_at;     /* tick */
    int32_t off_periods; /* until it comes back; negative for good */
    uint32_t done;       /* bytes of the work before the cut */
    uint32_t dice;
    bool erases;
    uint32_t address, size;
    uint8_t before[FLASH_SECTOR]; /* what stood there before that work */
    uint8_t page[FLASH_PAGE];     /* what it was to write */
    struct flash flash;
};

/* False: a line on stderr says why. The flash is all ones. */
bool memory_open(struct memory *self, struct faults *faults);
void memory_close(struct memory *self);
/* The power goes, perhaps within some work, and comes. */
void memory_power(struct memory *self, bool on);
/* The tick at which the power goes by itself; PW_NEVER if it does not. */
uint64_t memory_due(const struct memory *self);
/* The functions of struct pw_port, with the tick that it is. */
bool memory_read(struct memory *self, uint64_t now, uint32_t address, uint8_t *data, size_t size);
bool memory_erase(struct memory *self, uint64_t now, uint32_t address);
bool memory_program(struct memory *self, uint64_t now, uint32_t address, const uint8_t *data, size_t size);
bool memory_busy(struct memory *self, uint64_t now);

#endif
