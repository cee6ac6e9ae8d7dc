/* The serial NOR flash. Bytes reach the disk in the order in which sectors were written, as the order of FWU-018 needs:
   no sector is written before the one that was written last is on the disk. */
#define _XOPEN_SOURCE 700
#include "flash.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define ERASE_TICKS 90000u /* 45 ms: a host waits for 60 (DFU-008) */
#define PROGRAM_TICKS 1200u /* 0.6 ms */
#define BANK 0x100000u

static bool complain(const struct flash *self, const char *why)
{
    fprintf(stderr, "phasewire-reference: flash %s: %s\n", self->path, why);
    return false;
}

/* The file -------------------------------------------------------------------------------------------------------- */

static bool write_all(struct flash *self, uint32_t address, size_t size)
{
    size_t done = 0;
    while (done < size) {
        const ssize_t count = pwrite(self->file, self->bytes + address + done, size - done, (off_t)(address + done));
        if (count < 0 && errno != EINTR) {
            return complain(self, strerror(errno));
        }
        done += count < 0 ? 0u : (size_t)count;
    }
    return true;
}

static bool sync_file(struct flash *self)
{
    self->dirty = false;
    return fdatasync(self->file) == 0 || complain(self, strerror(errno));
}

/* A part of one sector has changed. */
static bool write_through(struct flash *self, uint32_t address, size_t size)
{
    if (self->path == NULL) {
        return true;
    }
    const uint32_t sector = address / FLASH_SECTOR;
    if (self->dirty && self->dirty_sector != sector && !sync_file(self)) {
        return false;
    }
    if (!write_all(self, address, size)) {
        return false;
    }
    self->dirty = true;
    self->dirty_sector = sector;
    /* Boot records are written last, and nothing may come that would sync them. */
    return address % BANK >= FLASH_SECTOR || sync_file(self);
}

static bool read_all(struct flash *self)
{
    size_t done = 0;
    while (done < FLASH_SIZE) {
        const ssize_t count = pread(self->file, self->bytes + done, FLASH_SIZE - done, (off_t)done);
        if (count == 0) {
            return complain(self, "it has become shorter");
        }
        if (count < 0 && errno != EINTR) {
            return complain(self, strerror(errno));
        }
        done += count < 0 ? 0u : (size_t)count;
    }
    return true;
}

/* Two devices must not share a flash. */
static bool lock_file(struct flash *self)
{
    struct flock lock;
    memset(&lock, 0, sizeof lock);
    lock.l_type = F_WRLCK;
    lock.l_whence = SEEK_SET;
    return fcntl(self->file, F_SETLK, &lock) == 0 || complain(self, "another device uses it");
}

bool flash_open(struct flash *self, const char *path, bool *blank)
{
    self->path = path;
    self->file = -1;
    self->busy = false;
    self->dirty = false;
    *blank = true;
    memset(self->bytes, 0xFF, FLASH_SIZE);
    if (path == NULL) {
        return true;
    }
    self->file = open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0666);
    struct stat about;
    if (self->file < 0 || fstat(self->file, &about) != 0) {
        return complain(self, strerror(errno));
    }
    if (!lock_file(self)) {
        return false;
    }
    *blank = about.st_size == 0;
    if (*blank) {
        return true;
    }
    if (about.st_size != (off_t)FLASH_SIZE) {
        return complain(self, "not a flash of 4194304 bytes");
    }
    return read_all(self);
}

bool flash_store(struct flash *self)
{
    return self->path == NULL || (write_all(self, 0, FLASH_SIZE) && sync_file(self));
}

void flash_close(struct flash *self)
{
    if (self->file >= 0) {
        (void)sync_file(self);
        (void)close(self->file);
        self->file = -1;
    }
}

/* Work ------------------------------------------------------------------------------------------------------------ */

bool flash_read(const struct flash *self, uint32_t address, uint8_t *data, size_t size)
{
    if (self->busy || address > FLASH_SIZE || size > FLASH_SIZE - address) {
        return false;
    }
    memcpy(data, self->bytes + address, size);
    return true;
}

/* Does bytes `from` to `to` of the work. Programming clears bits and sets none. */
static bool work_on(struct flash *self, uint32_t from, uint32_t to)
{
    for (uint32_t i = from; i < to; i++) {
        uint8_t *at = &self->bytes[self->address + i];
        *at = self->erases ? 0xFFu : (uint8_t)(*at & self->page[i]);
    }
    return write_through(self, self->address + from, to - from);
}

bool flash_busy(struct flash *self, uint64_t now)
{
    if (self->busy && (self->at_once || now >= self->busy_until)) {
        self->busy = false;
        (void)work_on(self, self->size / 2u, self->size);
    }
    return self->busy;
}

static bool begin_work(struct flash *self, uint64_t until)
{
    self->busy = true;
    self->busy_until = until;
    const bool done = work_on(self, 0, self->size / 2u);
    if (self->at_once) {
        (void)flash_busy(self, until);
    }
    return done;
}

bool flash_erase(struct flash *self, uint64_t now, uint32_t address)
{
    if (flash_busy(self, now) || address % FLASH_SECTOR != 0u || address >= FLASH_SIZE) {
        return false;
    }
    self->erases = true;
    self->address = address;
    self->size = FLASH_SECTOR;
    return begin_work(self, now + ERASE_TICKS);
}

bool flash_program(struct flash *self, uint64_t now, uint32_t address, const uint8_t *data, size_t size)
{
    if (flash_busy(self, now) || size == 0u || address >= FLASH_SIZE || address % FLASH_PAGE + size > FLASH_PAGE) {
        return false;
    }
    self->erases = false;
    self->address = address;
    self->size = (uint32_t)size;
    memcpy(self->page, data, size);
    return begin_work(self, now + PROGRAM_TICKS);
}

void flash_power_cut(struct flash *self)
{
    self->busy = false;
}
