/* Chapter FWU: checks of images, boot records, and the loader. */
#include "fwu.h"

#include <string.h>

#define RECORD_SIZE_AT 8u
#define RECORD_DIGEST_AT 12u
#define RECORD_CHECKSUM_AT 44u
#define RECORD_STARTED_AT 48u
#define RECORD_CONFIRMED_AT 52u
#define HEADER_CHECKED 28u /* bytes of the header that its checksum covers */
#define KEY_ID_AT 16u
#define VERSION_AT 8u      /* of the firmware */
#define SEGMENTS_AT 5u
#define FEW_SEGMENTS 2u
#define MANY_SEGMENTS (PW_PROCESSORS + 1u)
#define PROGRAM_ENTRY 16u /* of a segment: target, offset, size and CRC-32 */
#define UNMARKED 0xFFFFFFFFu
#define STILL_LOOKS 1000000u /* at a busy flash within one tick */

static const uint8_t image_magic[4] = { 0x50, 0x57, 0x46, 0x57 };
static const uint8_t record_magic[4] = { 0x50, 0x57, 0x42, 0x52 };
static const uint8_t zeros[PW_RECORD_WRITTEN] = { 0 };

/* Header and table --------------------------------------------------------------------------------------------- */

static const uint8_t *entry_of(const uint8_t *head, uint32_t segment)
{
    return &head[PW_IMAGE_HEADER + (PW_IMAGE_ENTRY * segment)];
}

static uint32_t offset_of(const uint8_t *head, uint32_t segment) { return pw_get32(&entry_of(head, segment)[4]); }

static uint32_t size_of(const uint8_t *head, uint32_t segment) { return pw_get32(&entry_of(head, segment)[8]); }

static uint32_t head_size(const uint8_t *head) { return PW_IMAGE_HEADER + (PW_IMAGE_ENTRY * head[SEGMENTS_AT]); }

static uint32_t padded(uint32_t size) { return (size + 3u) & ~(uint32_t)3u; }

/* FWU-003 */
static bool checksum_right(const uint8_t *head)
{
    const uint32_t sum = pw_crc32(0, head, HEADER_CHECKED);
    return pw_get32(&head[HEADER_CHECKED]) ==
           pw_crc32(sum, &head[PW_IMAGE_HEADER], head_size(head) - PW_IMAGE_HEADER);
}

/* FWU-004 */
static bool values_known(const uint8_t *head)
{
    bool known = (head[VERSION_AT] <= 99u) && (head[VERSION_AT + 1u] <= 9u) && (head[VERSION_AT + 2u] <= 9u);
    known = known && (head[11] != 0u) && pw_all_zero(&head[24], 4);
    for (uint32_t i = 0; i < head[SEGMENTS_AT]; i++) {
        known = known && pw_all_zero(&entry_of(head, i)[1], 3);
    }
    return known;
}

/* FWU-007: of eleven, segment i is for processor i. */
static bool targets_right(const uint8_t *head)
{
    const uint32_t segments = head[SEGMENTS_AT];
    bool right = (segments == FEW_SEGMENTS) || (segments == MANY_SEGMENTS);
    for (uint32_t i = 0; right && (i < segments); i++) {
        uint32_t target = i;
        if ((i + 1u) == segments) {
            target = PW_CONTROLLER;
        } else if (segments == FEW_SEGMENTS) {
            target = PW_ALL_PROCESSORS;
        } else {
            /* a processor has its own segment */
        }
        right = entry_of(head, i)[0] == target;
    }
    return right;
}

static bool sizes_right(const uint8_t *head)
{
    bool right = true;
    for (uint32_t i = 0; i < head[SEGMENTS_AT]; i++) {
        right = right && (size_of(head, i) >= 1u) && (size_of(head, i) <= PW_IMAGE_SEGMENT);
    }
    return right;
}

/* FWU-009; the sizes are right, so the sum is small. */
static bool offsets_right(const uint8_t *head)
{
    uint32_t at = head_size(head);
    bool right = true;
    for (uint32_t i = 0; i < head[SEGMENTS_AT]; i++) {
        right = right && (offset_of(head, i) == at);
        at = padded(at + size_of(head, i));
    }
    return right && (pw_image_total(head) == (at + PW_IMAGE_SIGNED));
}

enum pw_image_reason pw_image_head(const uint8_t *bytes, size_t size)
{
    enum pw_image_reason reason = PW_IMAGE_ACCEPTED;
    if ((size < PW_IMAGE_HEADER) || (size < head_size(bytes))) {
        reason = PW_IMAGE_LENGTH;
    } else if (memcmp(bytes, image_magic, sizeof image_magic) != 0) {
        reason = PW_IMAGE_MAGIC;
    } else if (bytes[4] != 1u) {
        reason = PW_IMAGE_VERSION;
    } else if (!checksum_right(bytes)) {
        reason = PW_IMAGE_CHECKSUM;
    } else if (!values_known(bytes)) {
        reason = PW_IMAGE_RESERVED;
    } else if (pw_get16(&bytes[6]) != PW_HARDWARE_FIVE_BOARDS) {
        reason = PW_IMAGE_HARDWARE;
    } else if (!targets_right(bytes)) {
        reason = PW_IMAGE_TARGETS;
    } else if (!sizes_right(bytes)) {
        reason = PW_IMAGE_SIZE;
    } else if (!offsets_right(bytes)) {
        reason = PW_IMAGE_OFFSET;
    } else {
        /* ACCEPTED */
    }
    return reason;
}

uint32_t pw_image_total(const uint8_t *head) { return pw_get32(&head[12]); }

/* The whole image ---------------------------------------------------------------------------------------------- */

void pw_image_begin(struct pw_image *image, const struct pw_port *port, uint32_t address, uint32_t size, uint8_t *block)
{
    const uint32_t first = (size < PW_FIRST_BLOCK) ? size : PW_FIRST_BLOCK;
    (void)memset(image, 0, sizeof *image);
    image->port = port;
    image->head = block;
    image->address = address;
    image->size = size;
    pw_sha256_begin(&image->whole);
    pw_sha256_begin(&image->part);
    if (!port->flash_read(port->self, address, block, first)) {
        image->unreadable = true;
    } else {
        image->reason = (uint8_t)pw_image_head(block, first);
    }
    if (!image->unreadable && (image->reason == (uint8_t)PW_IMAGE_ACCEPTED) && (pw_image_total(block) != size)) {
        image->reason = PW_IMAGE_TOTAL;
    }
}

static bool has_segment(const struct pw_image *image) { return image->segment < image->head[SEGMENTS_AT]; }

static uint32_t signature_at(const struct pw_image *image) { return image->size - PW_IMAGE_SIGNED; }

/* Where the next segment begins, or the signature. */
static uint32_t next_begins(const struct pw_image *image)
{
    return has_segment(image) ? offset_of(image->head, image->segment) : signature_at(image);
}

/* Where a run of bytes of one sort ends: header and table, padding, a segment or the signature. */
static uint32_t run_ends(const struct pw_image *image)
{
    uint32_t end = next_begins(image);
    if (image->at >= end) {
        end = has_segment(image) ? (end + size_of(image->head, image->segment)) : image->size;
    }
    return end;
}

/* FWU-010 */
static void segment_ends(struct pw_image *image)
{
    const uint8_t *entry = entry_of(image->head, image->segment);
    uint8_t digest[32];
    pw_sha256_end(&image->part, digest);
    if ((image->part_crc != pw_get32(&entry[12])) || (memcmp(digest, &entry[16], sizeof digest) != 0)) {
        image->bad_hash = true;
    }
    image->segment++;
    image->part_crc = 0;
    pw_sha256_begin(&image->part);
}

/* Bytes of one run, from image->at on. */
static void take(struct pw_image *image, const uint8_t *bytes, uint32_t size)
{
    const bool inside = image->at >= next_begins(image);
    pw_sha256_add(&image->whole, bytes, size);
    if (inside && has_segment(image)) {
        pw_sha256_add(&image->part, bytes, size);
        image->part_crc = pw_crc32(image->part_crc, bytes, size);
        if ((image->at + size) == run_ends(image)) {
            segment_ends(image);
        }
    } else if (inside) {
        (void)memcpy(&image->signature[image->at - signature_at(image)], bytes, size);
    } else if (image->segment > 0u) {
        image->bad_padding = image->bad_padding || !pw_all_zero(bytes, size);
    } else {
        /* header and table are judged already */
    }
    image->at += size;
}

/* FWU-011, FWU-012 */
static bool signature_accepted(const struct pw_image *image)
{
    const struct pw_port *port = image->port;
    const uint8_t *key_id = &image->head[KEY_ID_AT];
    bool accepted = true;
    if (pw_all_zero(key_id, 8)) {
        accepted = (port->flash_signed == NULL) && pw_all_zero(image->signature, PW_IMAGE_SIGNED);
    } else if (port->flash_signed != NULL) {
        accepted = port->flash_signed(port->self, key_id, image->address, signature_at(image), image->signature);
    } else {
        /* a device without keys cannot check it */
    }
    return accepted;
}

/* All bytes were read: the first reason by the order of FWU-015. */
static void image_ends(struct pw_image *image)
{
    pw_sha256_end(&image->whole, image->digest);
    if (image->bad_padding) {
        image->reason = PW_IMAGE_PADDING;
    } else if (image->bad_hash) {
        image->reason = PW_IMAGE_HASH;
    } else if (!signature_accepted(image)) {
        image->reason = PW_IMAGE_SIGNATURE;
    } else {
        /* ACCEPTED */
    }
}

bool pw_image_step(struct pw_image *image)
{
    const struct pw_port *port = image->port;
    bool more = !image->unreadable && (image->reason == (uint8_t)PW_IMAGE_ACCEPTED) && (image->at < image->size);
    if (more) {
        uint8_t page[PW_FLASH_PAGE];
        const uint32_t left = run_ends(image) - image->at;
        const uint32_t size = (left < PW_FLASH_PAGE) ? left : PW_FLASH_PAGE;
        if (!port->flash_read(port->self, image->address + image->at, page, size)) {
            image->unreadable = true;
        } else {
            take(image, page, size);
        }
        more = !image->unreadable && (image->at < image->size);
        if (image->at == image->size) {
            image_ends(image);
        }
    }
    return more;
}

/* Boot records ------------------------------------------------------------------------------------------------- */

bool pw_record_get(struct pw_record *record, const uint8_t bytes[PW_RECORD])
{
    const uint32_t size = pw_get32(&bytes[RECORD_SIZE_AT]);
    bool valid = memcmp(bytes, record_magic, sizeof record_magic) == 0;
    valid = valid && (size >= 1u) && (size <= PW_IMAGE_LARGEST);
    valid = valid && (pw_get32(&bytes[RECORD_CHECKSUM_AT]) == pw_crc32(0, bytes, RECORD_CHECKSUM_AT));
    if (valid) {
        record->generation = pw_get32(&bytes[4]);
        record->size = size;
        (void)memcpy(record->digest, &bytes[RECORD_DIGEST_AT], sizeof record->digest);
        record->started = pw_get32(&bytes[RECORD_STARTED_AT]);
        record->confirmed = pw_get32(&bytes[RECORD_CONFIRMED_AT]);
    }
    return valid;
}

void pw_record_put(uint8_t bytes[PW_RECORD_WRITTEN], const struct pw_record *record)
{
    (void)memcpy(bytes, record_magic, sizeof record_magic);
    pw_put32(&bytes[4], record->generation);
    pw_put32(&bytes[RECORD_SIZE_AT], record->size);
    (void)memcpy(&bytes[RECORD_DIGEST_AT], record->digest, sizeof record->digest);
    pw_put32(&bytes[RECORD_CHECKSUM_AT], pw_crc32(0, bytes, RECORD_CHECKSUM_AT));
}

/* One bit of a mark is enough. */
bool pw_record_may_boot(const struct pw_record *record)
{
    return (record->confirmed != UNMARKED) || (record->started == UNMARKED);
}

/* Whether B comes before A: if neither is newer, it does not. */
static bool b_is_newer(const struct pw_record *a, const struct pw_record *b)
{
    const uint32_t ahead = b->generation - a->generation; /* modulo 2^32 */
    return (ahead != 0u) && (ahead < 0x80000000u);
}

uint32_t pw_boot_order(const struct pw_record *a, const struct pw_record *b, uint8_t order[3])
{
    const bool has_a = (a != NULL) && pw_record_may_boot(a);
    const bool has_b = (b != NULL) && pw_record_may_boot(b);
    const bool b_first = has_a && has_b && b_is_newer(a, b);
    uint32_t count = 0;
    if (b_first) {
        order[count] = PW_BANK_B;
        count++;
    }
    if (has_a) {
        order[count] = PW_BANK_A;
        count++;
    }
    if (has_b && !b_first) {
        order[count] = PW_BANK_B;
        count++;
    }
    order[count] = PW_BANK_FACTORY;
    return count + 1u;
}

/* Flash -------------------------------------------------------------------------------------------------------- */

/* A clock that stands still must not keep the device here for ever. */
bool pw_flash_wait(const struct pw_port *port)
{
    const uint64_t since = port->now(port->self);
    uint64_t last = since;
    uint32_t still = 0;
    bool busy = port->flash_busy(port->self);
    while (busy && ((last - since) < PW_FLASH_LIMIT) && (still < STILL_LOOKS)) {
        const uint64_t now = port->now(port->self);
        still = (now == last) ? (still + 1u) : 0u;
        last = now;
        busy = port->flash_busy(port->self);
    }
    return !busy;
}

enum pw_found pw_flash_record(const struct pw_port *port, uint8_t bank, struct pw_record *record)
{
    uint8_t bytes[PW_RECORD];
    enum pw_found found = PW_FOUND_UNREADABLE;
    if (pw_flash_wait(port) && port->flash_read(port->self, PW_BANK_ADDRESS(bank), bytes, sizeof bytes)) {
        found = pw_record_get(record, bytes) ? PW_FOUND_RECORD : PW_FOUND_NONE;
    }
    return found;
}

bool pw_flash_banks(const struct pw_port *port, struct pw_banks *banks)
{
    bool readable = true;
    (void)memset(banks, 0, sizeof *banks);
    for (uint8_t bank = PW_BANK_FACTORY; bank <= (uint8_t)PW_BANK_B; bank++) {
        const enum pw_found found = pw_flash_record(port, bank, &banks->records[bank]);
        banks->has[bank] = found == PW_FOUND_RECORD;
        readable = readable && (found != PW_FOUND_UNREADABLE);
    }
    banks->count = pw_boot_order(banks->has[PW_BANK_A] ? &banks->records[PW_BANK_A] : NULL,
                                 banks->has[PW_BANK_B] ? &banks->records[PW_BANK_B] : NULL, banks->order);
    return readable;
}

bool pw_flash_intact(const struct pw_port *port, uint8_t bank, const struct pw_record *record)
{
    struct pw_sha256 sum;
    uint8_t bytes[PW_FLASH_PAGE];
    uint8_t digest[32];
    uint32_t at = 0;
    bool readable = pw_flash_wait(port);
    pw_sha256_begin(&sum);
    while (readable && (at < record->size)) {
        const uint32_t left = record->size - at;
        const uint32_t size = (left < PW_FLASH_PAGE) ? left : PW_FLASH_PAGE;
        readable = port->flash_read(port->self, PW_BANK_IMAGE(bank) + at, bytes, size);
        if (readable) {
            pw_sha256_add(&sum, bytes, size);
        }
        at += size;
    }
    pw_sha256_end(&sum, digest);
    return readable && (memcmp(digest, record->digest, sizeof digest) == 0);
}

/* Programs zeros within one page and waits. */
static bool clear(const struct pw_port *port, uint32_t address, uint32_t size)
{
    return pw_flash_wait(port) && port->flash_program(port->self, address, zeros, size) && pw_flash_wait(port);
}

/* The loader --------------------------------------------------------------------------------------------------- */

/* FWU-020: true if the image may be started now. The factory's record is confirmed and never written. */
static bool put_on_trial(const struct pw_port *port, uint8_t bank, const struct pw_record *record)
{
    bool marked = (bank == (uint8_t)PW_BANK_FACTORY) || (record->confirmed != UNMARKED);
    if (!marked) {
        struct pw_record after;
        marked = clear(port, PW_BANK_ADDRESS(bank) + RECORD_STARTED_AT, 4) &&
                 (pw_flash_record(port, bank, &after) == PW_FOUND_RECORD) && (after.started != UNMARKED);
    }
    return marked;
}

static bool try_bank(const struct pw_port *port, uint8_t bank, const struct pw_record *record, struct pw_boot *boot)
{
    const uint32_t image = PW_BANK_IMAGE(bank);
    uint8_t firmware[3];
    bool good = pw_flash_intact(port, bank, record);
    good = good && port->flash_read(port->self, image + VERSION_AT, firmware, sizeof firmware);
    good = good && put_on_trial(port, bank, record);
    if (good) {
        (void)memcpy(boot->firmware, firmware, sizeof firmware);
        boot->bank = bank;
        boot->address = image;
        boot->size = record->size;
    }
    return good;
}

bool pw_boot(const struct pw_port *port, struct pw_boot *boot)
{
    struct pw_banks banks;
    bool booted = false;
    (void)memset(boot, 0, sizeof *boot);
    (void)pw_flash_banks(port, &banks); /* what cannot be read does not boot */
    for (uint8_t bank = PW_BANK_A; bank <= (uint8_t)PW_BANK_B; bank++) {
        if (banks.has[bank] && !pw_record_may_boot(&banks.records[bank])) {
            boot->faults = PW_FAULT_FLASH;
        }
    }
    for (uint32_t i = 0; !booted && (i < banks.count); i++) {
        const uint8_t bank = banks.order[i];
        booted = banks.has[bank] && try_bank(port, bank, &banks.records[bank], boot);
        if (!booted) {
            boot->faults = PW_FAULT_FLASH;
        }
    }
    return booted;
}

bool pw_boot_program(const struct pw_port *port, const struct pw_boot *boot, uint8_t processor,
                     bool (*send)(void *context, const uint8_t *bytes, size_t size), void *context)
{
    uint8_t entry[PROGRAM_ENTRY] = { 0 };
    uint8_t page[PW_FLASH_PAGE];
    uint8_t segments = 0;
    bool good = port->flash_read(port->self, boot->address + SEGMENTS_AT, &segments, 1);
    const uint32_t index = (segments == FEW_SEGMENTS) ? 0u : processor;
    good = good &&
           port->flash_read(port->self, boot->address + PW_IMAGE_HEADER + (PW_IMAGE_ENTRY * index), entry, PROGRAM_ENTRY);
    const uint32_t address = boot->address + pw_get32(&entry[4]);
    const uint32_t size = pw_get32(&entry[8]);
    good = good && send(context, &entry[8], 4);
    for (uint32_t at = 0; good && (at < size); at += PW_FLASH_PAGE) {
        const uint32_t left = size - at;
        const uint32_t length = (left < PW_FLASH_PAGE) ? left : PW_FLASH_PAGE;
        good = port->flash_read(port->self, address + at, page, length) && send(context, page, length);
    }
    return good && send(context, &entry[12], 4);
}

/* Makes a record none; true if the bank is empty then. */
static bool give_up(const struct pw_port *port, uint8_t bank)
{
    struct pw_record record;
    enum pw_found found = pw_flash_record(port, bank, &record);
    if ((found == PW_FOUND_RECORD) && clear(port, PW_BANK_ADDRESS(bank), PW_RECORD_WRITTEN)) {
        found = pw_flash_record(port, bank, &record);
    }
    return found == PW_FOUND_NONE;
}

void pw_boot_revert(const struct pw_port *port)
{
    struct pw_record factory;
    struct pw_record a;
    struct pw_record b;
    const bool possible = (pw_flash_record(port, PW_BANK_FACTORY, &factory) == PW_FOUND_RECORD) &&
                          pw_flash_intact(port, PW_BANK_FACTORY, &factory);
    if (possible) {
        const enum pw_found has_a = pw_flash_record(port, PW_BANK_A, &a);
        const enum pw_found has_b = pw_flash_record(port, PW_BANK_B, &b);
        const bool a_is_older = (has_a == PW_FOUND_RECORD) && (has_b == PW_FOUND_RECORD) && b_is_newer(&a, &b);
        const uint8_t older = a_is_older ? (uint8_t)PW_BANK_A : (uint8_t)PW_BANK_B;
        const uint8_t newer = a_is_older ? (uint8_t)PW_BANK_B : (uint8_t)PW_BANK_A;
        if ((has_a != PW_FOUND_UNREADABLE) && (has_b != PW_FOUND_UNREADABLE) && give_up(port, older)) {
            (void)give_up(port, newer);
        }
    }
}

bool pw_boot_confirm(const struct pw_port *port, const struct pw_boot *boot)
{
    struct pw_record record;
    bool done = (boot->bank != (uint8_t)PW_BANK_A) && (boot->bank != (uint8_t)PW_BANK_B);
    if (!done && !port->flash_busy(port->self)) {
        const enum pw_found found = pw_flash_record(port, boot->bank, &record);
        done = (found == PW_FOUND_NONE) || ((found == PW_FOUND_RECORD) && (record.confirmed != UNMARKED));
        if (!done && (found == PW_FOUND_RECORD)) {
            (void)port->flash_program(port->self, PW_BANK_ADDRESS(boot->bank) + RECORD_CONFIRMED_AT, zeros, 4);
        }
    }
    return done;
}
