/* Chapter DFU: the work that a download leaves to do, as steps that wait for the flash and for nothing else. */
#include "dfu_work.h"

#include <string.h>

#define LOOK_TICKS 100u /* between two looks at a busy flash */

/* Failures ----------------------------------------------------------------------------------------------------- */

void pw_dfu_happens(struct pw_dfu *dfu, enum pw_dfu_event event)
{
    bool stalls;
    dfu->state = pw_dfu_after(dfu->state, event, &stalls);
}

/* `ERROR`, with the status of the first failure; nothing more is begun. What the flash does goes on (DFU-013). */
void pw_dfu_fail(struct pw_dfu *dfu, enum pw_dfu_status status, enum pw_image_reason reason)
{
    if (dfu->state != (uint8_t)PW_DFU_ERROR) {
        dfu->status = (uint8_t)status;
        dfu->reason = (uint8_t)reason;
    }
    dfu->step = PW_STEP_NONE;
    dfu->flashing = false;
    pw_dfu_happens(dfu, PW_DFU_ON_FAILURE);
}

/* DFU-012 */
void pw_dfu_fail_image(struct pw_dfu *dfu, enum pw_image_reason reason)
{
    const bool target = (reason == PW_IMAGE_MAGIC) || (reason == PW_IMAGE_HARDWARE);
    pw_dfu_fail(dfu, target ? PW_DFU_TARGET : PW_DFU_FILE, reason);
}

void pw_dfu_work(struct pw_dfu *dfu, enum pw_dfu_step first, uint32_t ms)
{
    dfu->step = (uint8_t)first;
    dfu->flashing = false;
    dfu->written = 0;
    dfu->busy_ms = ms;
    dfu->work_since = dfu->port->now(dfu->port->self);
}

/* Begins an erasure (no data) or the programming of bytes of one page, to be read back. */
static void flash_begin(struct pw_dfu *dfu, uint32_t address, const uint8_t *data, uint32_t size)
{
    const struct pw_port *port = dfu->port;
    const bool begun = (data == NULL) ? port->flash_erase(port->self, address)
                                      : port->flash_program(port->self, address, data, size);
    if (begun) {
        dfu->flashing = true;
        dfu->flash_address = address;
        dfu->flash_data = data;
        dfu->flash_size = size;
        dfu->flash_checked = 0;
    } else {
        pw_dfu_fail(dfu, PW_DFU_WRITE, PW_IMAGE_ACCEPTED);
    }
}

/* Whether the flash says that it could not do what it was told. */
static bool flash_failed(const struct pw_dfu *dfu)
{
    const struct pw_port *port = dfu->port;
    return (port->flash_failed != NULL) && (dfu->flash_checked == 0u) && port->flash_failed(port->self);
}

/* Reads back a page of what the flash was told to do. */
static void flash_check(struct pw_dfu *dfu)
{
    const struct pw_port *port = dfu->port;
    const uint32_t left = dfu->flash_size - dfu->flash_checked;
    const uint32_t size = (left < PW_FLASH_PAGE) ? left : PW_FLASH_PAGE;
    uint8_t page[PW_FLASH_PAGE];
    if (flash_failed(dfu)) {
        pw_dfu_fail(dfu, (dfu->flash_data == NULL) ? PW_DFU_ERASE : PW_DFU_PROG, PW_IMAGE_ACCEPTED);
    } else if (!port->flash_read(port->self, dfu->flash_address + dfu->flash_checked, page, size)) {
        pw_dfu_fail(dfu, PW_DFU_WRITE, PW_IMAGE_ACCEPTED);
    } else {
        bool same = true;
        for (uint32_t i = 0; i < size; i++) {
            const uint8_t wanted = (dfu->flash_data == NULL) ? 0xFFu : dfu->flash_data[dfu->flash_checked + i];
            same = same && (page[i] == wanted);
        }
        dfu->flash_checked += size;
        if (!same) {
            pw_dfu_fail(dfu, (dfu->flash_data == NULL) ? PW_DFU_CHECK_ERASED : PW_DFU_VERIFY, PW_IMAGE_ACCEPTED);
        } else if (dfu->flash_checked == dfu->flash_size) {
            dfu->flashing = false;
        } else {
            /* the next page, by the next call */
        }
    }
}

/* FWU-018: an erasure that is cut short could clear a bit of `confirmed` and leave the rest of a record that may not
   boot. So the record is made none before. */
static void step_overwrite(struct pw_dfu *dfu)
{
    static const uint8_t zeros[PW_RECORD_WRITTEN] = { 0 };
    struct pw_record record;
    const enum pw_found found = pw_flash_record(dfu->port, dfu->bank, &record);
    dfu->step = PW_STEP_ERASE_RECORD;
    if (found == PW_FOUND_UNREADABLE) {
        pw_dfu_fail(dfu, PW_DFU_WRITE, PW_IMAGE_ACCEPTED);
    } else if ((found == PW_FOUND_RECORD) && !pw_record_may_boot(&record)) {
        flash_begin(dfu, PW_BANK_ADDRESS(dfu->bank), zeros, sizeof zeros);
    } else {
        /* it may be erased at once */
    }
}

static void step_erase(struct pw_dfu *dfu)
{
    dfu->step = PW_STEP_PROGRAM;
    dfu->intact &= (uint8_t)~PW_BANK_BIT(dfu->bank);
    if ((dfu->block_at % PW_FLASH_SECTOR) == 0u) {
        flash_begin(dfu, PW_BANK_IMAGE(dfu->bank) + dfu->block_at, NULL, PW_FLASH_SECTOR);
    }
}

static void step_program(struct pw_dfu *dfu)
{
    const uint32_t left = dfu->block_size - dfu->written;
    const uint32_t size = (left < PW_FLASH_PAGE) ? left : PW_FLASH_PAGE;
    if (size == 0u) {
        dfu->step = PW_STEP_NONE;
    } else {
        const uint32_t at = dfu->written;
        dfu->written += size;
        flash_begin(dfu, PW_BANK_IMAGE(dfu->bank) + dfu->block_at + at, &dfu->block[at], size);
    }
}

static void step_check(struct pw_dfu *dfu)
{
    if (pw_image_step(&dfu->image)) {
        /* more of it by the next call */
    } else if (dfu->image.unreadable) {
        pw_dfu_fail(dfu, PW_DFU_WRITE, PW_IMAGE_ACCEPTED);
    } else if (dfu->image.reason != (uint8_t)PW_IMAGE_ACCEPTED) {
        pw_dfu_fail_image(dfu, (enum pw_image_reason)dfu->image.reason);
    } else {
        dfu->intact |= PW_BANK_BIT(dfu->bank);
        dfu->step = PW_STEP_RECORD;
    }
}

/* FWU-017: one generation more than in the other bank. */
static void step_record(struct pw_dfu *dfu)
{
    const uint8_t other = (dfu->bank == (uint8_t)PW_BANK_A) ? (uint8_t)PW_BANK_B : (uint8_t)PW_BANK_A;
    struct pw_record before;
    struct pw_record record = { .size = dfu->total };
    const enum pw_found found = pw_flash_record(dfu->port, other, &before);
    if (found == PW_FOUND_UNREADABLE) {
        pw_dfu_fail(dfu, PW_DFU_WRITE, PW_IMAGE_ACCEPTED);
    } else {
        if (found == PW_FOUND_RECORD) {
            record.generation = before.generation + 1u;
        }
        (void)memcpy(record.digest, dfu->image.digest, sizeof record.digest);
        pw_record_put(dfu->record, &record);
        dfu->step = PW_STEP_END;
        flash_begin(dfu, PW_BANK_ADDRESS(dfu->bank), dfu->record, sizeof dfu->record);
    }
}

static void next_step(struct pw_dfu *dfu)
{
    switch ((enum pw_dfu_step)dfu->step) {
    case PW_STEP_OVERWRITE:
        step_overwrite(dfu);
        break;
    case PW_STEP_ERASE_RECORD:
        dfu->step = PW_STEP_ERASE;
        flash_begin(dfu, PW_BANK_ADDRESS(dfu->bank), NULL, PW_FLASH_SECTOR);
        break;
    case PW_STEP_ERASE:
        step_erase(dfu);
        break;
    case PW_STEP_PROGRAM:
        step_program(dfu);
        break;
    case PW_STEP_MANIFEST:
        dfu->step = PW_STEP_CHECK;
        pw_image_begin(&dfu->image, dfu->port, PW_BANK_IMAGE(dfu->bank), dfu->total, dfu->block);
        break;
    case PW_STEP_CHECK:
        step_check(dfu);
        break;
    case PW_STEP_RECORD:
        step_record(dfu);
        break;
    case PW_STEP_NONE:
    case PW_STEP_END:
    default:
        dfu->step = PW_STEP_NONE;
        break;
    }
}

/* Manifestation begins when the host asks for the status (DFU 1.1, A.2.8), however fast the flash is. */
static bool waits_for_the_host(const struct pw_dfu *dfu)
{
    return (dfu->step == (uint8_t)PW_STEP_MANIFEST) && (dfu->state == (uint8_t)PW_DFU_MANIFEST_SYNC);
}

void pw_dfu_time(struct pw_dfu *dfu)
{
    const uint64_t now = dfu->port->now(dfu->port->self);
    if (waits_for_the_host(dfu)) {
        dfu->work_since = now;
    }
    if ((dfu->step != (uint8_t)PW_STEP_NONE) && ((now - dfu->work_since) >= PW_FLASH_LIMIT)) {
        enum pw_dfu_status status = PW_DFU_WRITE;
        if (dfu->flashing) {
            status = (dfu->flash_data == NULL) ? PW_DFU_ERASE : PW_DFU_PROG;
        }
        pw_dfu_fail(dfu, status, PW_IMAGE_ACCEPTED);
    }
    if (pw_dfu_is_busy(dfu->state) && (now >= dfu->busy_until)) {
        pw_dfu_happens(dfu, PW_DFU_ON_POLL_TIMEOUT);
    }
}

void pw_dfu_poll(struct pw_dfu *dfu)
{
    pw_dfu_time(dfu);
    const bool works = (dfu->step != (uint8_t)PW_STEP_NONE) && !waits_for_the_host(dfu);
    if (works && !dfu->port->flash_busy(dfu->port->self)) {
        if (dfu->flashing) {
            flash_check(dfu);
        } else {
            next_step(dfu);
        }
    }
}

uint64_t pw_dfu_due(const struct pw_dfu *dfu)
{
    const uint64_t now = dfu->port->now(dfu->port->self);
    uint64_t due = PW_NEVER;
    if (dfu->leaving || ((dfu->step != (uint8_t)PW_STEP_NONE) && !waits_for_the_host(dfu))) {
        due = dfu->port->flash_busy(dfu->port->self) ? (now + LOOK_TICKS) : now;
    }
    return due;
}
