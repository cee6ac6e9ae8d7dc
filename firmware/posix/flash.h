/* The serial NOR flash of FWU-016: in memory, and in a file if there is one. */
#ifndef FLASH_H
#define FLASH_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define FLASH_SIZE 0x400000u
#define FLASH_SECTOR 4096u
#define FLASH_PAGE 256u

struct flash {
    const char *path; /* NULL: in memory only */
    int file;
    /* The loader waits for the flash while the ticks stand still: then work takes no time. */
    bool at_once;
    /* The second half of an erasure or a page, which is done when its time is over: a power cut comes between. */
    bool busy;
    bool erases;
    uint64_t busy_until; /* tick */
    uint32_t address, size;
    uint8_t page[FLASH_PAGE];
    /* The sector that was written and is perhaps not on the disk yet. */
    bool dirty;
    uint32_t dirty_sector;
    uint8_t bytes[FLASH_SIZE];
};

/* Reads the file, or makes it. `blank` says whether nothing was there. False: a line on stderr says why. */
bool flash_open(struct flash *self, const char *path, bool *blank);
/* Writes all bytes to the file: of a device that was just made. */
bool flash_store(struct flash *self);
void flash_close(struct flash *self);
/* Work that is not over is half done, and stays so. */
void flash_power_cut(struct flash *self);

/* The functions of struct pw_port, with the tick that it is. */
bool flash_read(const struct flash *self, uint32_t address, uint8_t *data, size_t size);
bool flash_erase(struct flash *self, uint64_t now, uint32_t address);
bool flash_program(struct flash *self, uint64_t now, uint32_t address, const uint8_t *data, size_t size);
bool flash_busy(struct flash *self, uint64_t now);

#endif
