/* Chapter FWU: vectors of images and boot records, and the loader on a flash in memory. */
#include "flash_sim.h"
#include "vectors.h"

#include "../posix/booting.c" /* not of the core, nor is the factory's image: they are tested here with the loader */
#include "../posix/factory.c"

#define SUFFIX 16u

static uint8_t image_a[PW_FLASH_SECTOR], image_b[PW_FLASH_SECTOR];
static uint8_t block[PW_FIRST_BLOCK];
static const uint8_t factory_version[3] = { 1, 0, 0 };

/* Checks what stands in bank A as an image of this size. */
static enum pw_image_reason check_flash(const struct pw_port *port, const uint8_t *bytes, uint32_t size,
                                        uint8_t *digest)
{
    struct pw_image image;
    uint32_t steps = 0;
    (void)memcpy(&sim.bytes[PW_BANK_IMAGE(PW_BANK_A)], bytes, size);
    pw_image_begin(&image, port, PW_BANK_IMAGE(PW_BANK_A), size, block);
    while (pw_image_step(&image)) {
        steps++;
    }
    CHECK(!image.unreadable);
    CHECK(steps <= ((size / PW_FLASH_PAGE) + 26u)); /* each segment, padding and the signature may begin a page */
    CHECK(!pw_image_step(&image));
    (void)memcpy(digest, image.digest, 32);
    return (enum pw_image_reason)image.reason;
}

static void digest_of(const uint8_t *bytes, uint32_t size, uint8_t *digest)
{
    struct pw_sha256 sum;
    pw_sha256_begin(&sum);
    pw_sha256_add(&sum, bytes, size);
    pw_sha256_end(&sum, digest);
}

static void test_images(void)
{
    for (size_t i = 0; i < VEC_COUNT(vec_images); i++) {
        const struct vec_image *v = &vec_images[i];
        const uint32_t size = v->size - SUFFIX;
        struct pw_boot boot;
        uint8_t digest[32];
        uint8_t wanted[32];
        check_case = v->name;
        sim_begin();
        digest_of(v->bytes, size, wanted);
        CHECK_EQ(check_flash(&sim_port, v->bytes, size, digest), PW_IMAGE_ACCEPTED);
        CHECK_BYTES(digest, wanted, 32);
        CHECK_EQ(pw_image_head(v->bytes, size), PW_IMAGE_ACCEPTED);
        CHECK_EQ(pw_image_total(v->bytes), size);
        CHECK_BYTES(&v->bytes[16], v->key_id, 8);
        sim_put(PW_BANK_B, v->bytes, size, 3, 0, 0);
        CHECK(pw_boot(&sim_port, &boot));
        CHECK_BYTES(boot.firmware, v->version, 3);
        CHECK_EQ(boot.bank, PW_BANK_B);
        CHECK_EQ(boot.size, size);
        CHECK_EQ(boot.address, 0x301000);
        CHECK_EQ(boot.faults, 0);
    }
}

static void test_refused_images(void)
{
    uint32_t judged = 0;
    for (size_t i = 0; i < VEC_COUNT(vec_refused_images); i++) {
        const struct vec_refused_image *v = &vec_refused_images[i];
        uint8_t digest[32];
        check_case = v->name;
        CHECK_EQ(v->reason, v->code);
        if (v->reason != (uint8_t)PW_IMAGE_SUFFIX) { /* of files: a device gets no suffix */
            const uint32_t size = v->size - SUFFIX;
            const bool head = v->reason <= (uint8_t)PW_IMAGE_OFFSET;
            sim_begin();
            CHECK_EQ(check_flash(&sim_port, v->bytes, size, digest), v->reason);
            CHECK_EQ(pw_image_head(v->bytes, size), head ? v->reason : (uint8_t)PW_IMAGE_ACCEPTED);
            judged++;
        }
    }
    CHECK(judged >= 30u);
}

/* Of a TOTAL that fits the header but not the file, PADDING and HASH at once, the first in the order counts. */
static void test_first_reason(void)
{
    uint8_t digest[32];
    uint32_t size;
    check_case = "first reason";
    sim_begin();
    size = make_image(image_a, 2, 5, 1);
    image_a[128] ^= 1u;
    CHECK_EQ(check_flash(&sim_port, image_a, size, digest), PW_IMAGE_HASH);
    image_a[133] = 1; /* padding, behind the damage */
    CHECK_EQ(check_flash(&sim_port, image_a, size, digest), PW_IMAGE_PADDING);
    CHECK_EQ(check_flash(&sim_port, image_a, size + 1u, digest), PW_IMAGE_TOTAL);
    CHECK_EQ(check_flash(&sim_port, image_a, 40, digest), PW_IMAGE_LENGTH);
    image_a[9] = 10; /* a minor version that does not fit bcdDevice */
    pw_put32(&image_a[28], pw_crc32(pw_crc32(0, image_a, 28), &image_a[32], 96));
    CHECK_EQ(check_flash(&sim_port, image_a, size, digest), PW_IMAGE_RESERVED);
    size = make_image(image_a, 2, 5, 1);
    image_a[143] = 1; /* padding before the signature */
    CHECK_EQ(check_flash(&sim_port, image_a, size, digest), PW_IMAGE_PADDING);
    size = make_image(image_a, 2, 5, 1);
    sim.mute = true;
    {
        struct pw_image image;
        pw_image_begin(&image, &sim_port, PW_BANK_IMAGE(PW_BANK_A), size, block);
        CHECK(!pw_image_step(&image));
        CHECK(image.unreadable);
    }
}

/* A device that trusts the first vector's key; Ed25519 itself is the board's. */
static uint32_t asked;
static bool trusts(void *self, const uint8_t key_id[8], uint32_t address, uint32_t size, const uint8_t signature[64])
{
    const struct vec_signature *good = &vec_signatures[0];
    (void)self;
    asked++;
    CHECK_EQ(address, PW_BANK_IMAGE(PW_BANK_A));
    CHECK_EQ(size, good->size - 64u);
    return (memcmp(key_id, &good->bytes[16], 8) == 0) && (memcmp(signature, &good->bytes[good->size - 64u], 64) == 0);
}

static void test_signatures(void)
{
    struct pw_port port = sim_port;
    uint32_t trusted = 0;
    port.flash_signed = trusts;
    for (size_t i = 0; i < VEC_COUNT(vec_signatures); i++) {
        const struct vec_signature *v = &vec_signatures[i];
        uint8_t digest[32];
        check_case = v->name;
        sim_begin();
        CHECK_EQ(check_flash(&port, v->bytes, v->size, digest), v->trusted ? PW_IMAGE_ACCEPTED : PW_IMAGE_SIGNATURE);
        CHECK_EQ(check_flash(&sim_port, v->bytes, v->size, digest), PW_IMAGE_ACCEPTED); /* without keys */
        trusted += v->trusted ? 1u : 0u;
    }
    CHECK_EQ(trusted, 1);
    CHECK_EQ(asked, 3); /* not for the one without a key */
}

static void test_boot_records(void)
{
    for (size_t i = 0; i < VEC_COUNT(vec_boot_records); i++) {
        const struct vec_boot_record *v = &vec_boot_records[i];
        struct pw_record record = { 0 };
        check_case = v->name;
        CHECK_EQ(pw_record_get(&record, v->bytes), v->valid);
        if (v->valid) {
            uint8_t bytes[PW_RECORD_WRITTEN];
            CHECK_EQ(record.generation, v->generation);
            CHECK_EQ(record.size, v->size);
            CHECK_EQ(record.started, v->started);
            CHECK_EQ(record.confirmed, v->confirmed);
            CHECK_BYTES(record.digest, v->digest, 32);
            CHECK_EQ(pw_record_may_boot(&record), v->may_boot);
            pw_record_put(bytes, &record);
            CHECK_BYTES(bytes, v->bytes, PW_RECORD_WRITTEN);
        }
    }
}

static const struct pw_record *find(const char *name, struct pw_record *record)
{
    const struct pw_record *found = NULL;
    for (size_t i = 0; i < VEC_COUNT(vec_boot_records); i++) {
        if ((strcmp(vec_boot_records[i].name, name) == 0) && pw_record_get(record, vec_boot_records[i].bytes)) {
            found = record;
        }
    }
    return found;
}

static void test_boot_orders(void)
{
    for (size_t i = 0; i < VEC_COUNT(vec_boot_orders); i++) {
        const struct vec_boot_order *v = &vec_boot_orders[i];
        struct pw_record a;
        struct pw_record b;
        uint8_t order[3] = { 0 };
        check_case = v->name;
        CHECK_EQ(pw_boot_order(find(v->a, &a), find(v->b, &b), order), v->count);
        CHECK_BYTES(order, v->order, v->count);
    }
}

/* The loader --------------------------------------------------------------------------------------------------- */

static uint32_t size_a, size_b;

static void begin_device(void)
{
    sim_begin();
    factory_image(sim.bytes, factory_version);
    size_a = make_image(image_a, 2, 300, 1);
    size_b = make_image(image_b, 2, 301, 2);
}

/* Boots, and checks bank and faults. */
static struct pw_boot boots(uint8_t bank, uint16_t faults)
{
    struct pw_boot boot;
    CHECK(pw_boot(&sim_port, &boot));
    CHECK_EQ(boot.bank, bank);
    CHECK_EQ(boot.faults, faults);
    return boot;
}

static void test_factory(void)
{
    uint8_t digest[32];
    struct pw_boot boot;
    check_case = "factory";
    begin_device();
    boot = boots(PW_BANK_FACTORY, 0);
    CHECK_BYTES(boot.firmware, factory_version, 3);
    CHECK_EQ(sim.programs, 0);
    CHECK(pw_boot_confirm(&sim_port, &boot));
    CHECK_EQ(sim.operations, 0);
    CHECK_EQ(check_flash(&sim_port, &sim.bytes[boot.address], boot.size, digest), PW_IMAGE_ACCEPTED);
    pw_put32(&sim.bytes[0x100030], UINT32_MAX); /* not even a record without its marks is written again */
    pw_put32(&sim.bytes[0x100034], UINT32_MAX);
    boot = boots(PW_BANK_FACTORY, 0);
    CHECK(pw_boot_confirm(&sim_port, &boot));
    CHECK_EQ(sim.operations, 0);
    sim.bytes[boot.address + boot.size - 1u] ^= 1u;
    CHECK(!pw_boot(&sim_port, &boot));
    CHECK_EQ(boot.bank, PW_BANK_NONE);
    sim_begin();
    CHECK(!pw_boot(&sim_port, &boot));
    sim.mute = true;
    CHECK(!pw_boot(&sim_port, &boot));
}

static void test_trial(void)
{
    struct pw_boot boot;
    check_case = "trial";
    begin_device();
    sim_put(PW_BANK_A, image_a, size_a, 7, 0, 0);
    sim_put(PW_BANK_B, image_b, size_b, 8, UINT32_MAX, UINT32_MAX);
    boot = boots(PW_BANK_B, 0);
    CHECK_EQ(boot.firmware[2], 2);
    CHECK_EQ(sim.programs, 1);
    CHECK_EQ(pw_get32(&sim.bytes[0x300000u + 48u]), 0);
    CHECK_EQ(pw_get32(&sim.bytes[0x300000u + 52u]), UINT32_MAX);
    boot = boots(PW_BANK_A, PW_FAULT_FLASH); /* B never came up */
    CHECK_EQ(sim.programs, 1);
    sim_put(PW_BANK_B, image_b, size_b, 8, UINT32_MAX, UINT32_MAX);
    boot = boots(PW_BANK_B, 0);
    CHECK(!pw_boot_confirm(&sim_port, &boot)); /* it is being written */
    CHECK(!pw_boot_confirm(&sim_port, &boot));
    CHECK_EQ(sim.programs, 3);
    sim.now += 10000;
    CHECK(pw_boot_confirm(&sim_port, &boot));
    CHECK_EQ(sim.programs, 3);
    CHECK_EQ(pw_get32(&sim.bytes[0x300000u + 52u]), 0);
    boot = boots(PW_BANK_B, 0);
    CHECK_EQ(sim.programs, 3);
    sim.bytes[PW_BANK_IMAGE(PW_BANK_B) + size_b - 1u] ^= 1u; /* a damaged image */
    boot = boots(PW_BANK_A, PW_FAULT_FLASH);
    CHECK_EQ(boot.firmware[2], 1);
    sim.bytes[PW_BANK_IMAGE(PW_BANK_A)] ^= 1u;
    boot = boots(PW_BANK_FACTORY, PW_FAULT_FLASH);
    CHECK_EQ(sim.misused, 0);
}

/* Without the mark the image would be tried again and again: so it is not started. */
static void test_trial_of_locked_flash(void)
{
    check_case = "locked flash";
    begin_device();
    sim_put(PW_BANK_A, image_a, size_a, 0, UINT32_MAX, UINT32_MAX);
    sim.locked = true;
    (void)boots(PW_BANK_FACTORY, PW_FAULT_FLASH);
    sim.locked = false;
    sim.lame = true;
    (void)boots(PW_BANK_FACTORY, PW_FAULT_FLASH);
    sim.lame = false;
    (void)boots(PW_BANK_A, 0);
    sim_put(PW_BANK_A, image_a, size_a, 0, UINT32_MAX, UINT32_MAX);
    sim.stuck = true; /* the clock goes on, or it does not: the loader ends all the same */
    {
        struct pw_boot boot;
        sim.step = 1000;
        CHECK(!pw_boot(&sim_port, &boot));
        sim.step = 0;
        CHECK(!pw_boot(&sim_port, &boot));
    }
}

static bool is_empty(uint8_t bank)
{
    struct pw_record record;
    return !pw_record_get(&record, &sim.bytes[PW_BANK_ADDRESS(bank)]);
}

static void test_revert(void)
{
    check_case = "revert";
    begin_device();
    pw_boot_revert(&sim_port); /* nothing to do */
    CHECK_EQ(sim.operations, 0);
    sim_put(PW_BANK_A, image_a, size_a, 7, 0, 0);
    sim_put(PW_BANK_B, image_b, size_b, 8, 0, UINT32_MAX); /* also one that may not boot */
    pw_boot_revert(&sim_port);
    CHECK_EQ(sim.programs, 2);
    CHECK_EQ(sim.erasures, 0);
    CHECK(is_empty(PW_BANK_A) && is_empty(PW_BANK_B));
    CHECK(pw_all_zero(&sim.bytes[0x200000], 56));
    CHECK_EQ(pw_get32(&sim.bytes[0x300000u + 52u]), UINT32_MAX); /* bytes 0 to 47 only */
    (void)boots(PW_BANK_FACTORY, 0);
    for (uint32_t wrap = 0; wrap < 4u; wrap++) { /* the older one first */
        static const uint32_t a[4] = { 7, 8, UINT32_MAX, 5 };
        static const uint32_t b[4] = { 8, 7, 0, 5 };
        static const uint8_t older[4] = { PW_BANK_A, PW_BANK_B, PW_BANK_A, PW_BANK_B };
        begin_device();
        sim_put(PW_BANK_A, image_a, size_a, a[wrap], 0, 0);
        sim_put(PW_BANK_B, image_b, size_b, b[wrap], 0, 0);
        sim.cut_at = 2;
        pw_boot_revert(&sim_port);
        sim_power();
        CHECK(is_empty(older[wrap]));
        CHECK(!is_empty((older[wrap] == (uint8_t)PW_BANK_A) ? PW_BANK_B : PW_BANK_A));
    }
    begin_device(); /* the newer only when the older has become none */
    sim_put(PW_BANK_A, image_a, size_a, 7, 0, 0);
    sim_put(PW_BANK_B, image_b, size_b, 8, 0, 0);
    sim.locked = true;
    pw_boot_revert(&sim_port);
    (void)boots(PW_BANK_B, 0);
    sim.locked = false;
    for (uint8_t bank = PW_BANK_FACTORY; bank <= (uint8_t)PW_BANK_B; bank++) {
        sim.blind = bank;
        pw_boot_revert(&sim_port);
    }
    sim.blind = 0;
    sim.bytes[PW_BANK_IMAGE(PW_BANK_FACTORY)] ^= 1u; /* a bad factory image */
    pw_boot_revert(&sim_port);
    CHECK_EQ(sim.operations, 0);
    (void)boots(PW_BANK_B, 0);
    CHECK_EQ(sim.misused, 0);
}

/* FWU-021: what the boot program of a processor gets, and what it starts. */
static void test_programs(void)
{
    const struct pw_boot boot = { .bank = PW_BANK_A, .address = PW_BANK_IMAGE(PW_BANK_A) };
    uint8_t *head = &sim.bytes[boot.address];
    check_case = "programs";
    for (uint32_t segments = 2u; segments <= PW_PROCESSORS + 1u; segments += PW_PROCESSORS - 1u) {
        head[5] = (uint8_t)segments;
        for (uint32_t i = 0; i + 1u < segments; i++) {
            uint8_t *entry = &head[PW_IMAGE_HEADER + (PW_IMAGE_ENTRY * i)];
            uint8_t *segment = &head[2048u + (i * 1024u)];
            const uint32_t size = 253u + i; /* less than a page, one, and more */
            (void)memset(segment, (int)(i + 1u), size);
            pw_put32(&entry[4], 2048u + (i * 1024u));
            pw_put32(&entry[8], size);
            pw_put32(&entry[12], pw_crc32(0, segment, size));
        }
        for (uint8_t processor = 0; processor < PW_PROCESSORS; processor++) {
            const uint32_t index = segments == 2u ? 0u : processor;
            struct booting came = { 0 };
            CHECK(pw_boot_program(&sim_port, &boot, processor, booting_take, &came));
            CHECK(booting_starts(&came));
            CHECK_EQ(came.size, 253u + index);
            CHECK_EQ(came.sum, pw_get32(&head[PW_IMAGE_HEADER + (PW_IMAGE_ENTRY * index) + 12u]));
            CHECK(!booting_take(&came, head, 1)); /* nothing comes after it */
            struct booting damaged = { .sum = 1u };
            CHECK(pw_boot_program(&sim_port, &boot, processor, booting_take, &damaged));
            CHECK(!booting_starts(&damaged));
        }
    }
    sim.mute = true;
    struct booting none = { 0 };
    CHECK(!pw_boot_program(&sim_port, &boot, 0, booting_take, &none));
    CHECK(!booting_starts(&none));
    sim.mute = false;
}

int main(void)
{
    test_images();
    test_refused_images();
    test_first_reason();
    test_signatures();
    test_boot_records();
    test_boot_orders();
    test_factory();
    test_trial();
    test_trial_of_locked_flash();
    test_revert();
    test_programs();
    return check_end();
}
