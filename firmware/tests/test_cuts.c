/* Chapters FWU and DFU: power that is cut in every operation of the flash, and a flash that fails. */
#include "flash_sim.h"

#define SEGMENT 2500u
#define MS PW_TICKS_PER_MS
#define KEPT (4u * PW_FLASH_SECTOR) /* of each bank; the images are smaller */
#define NEW 3u                      /* patch version of the image that is downloaded */

static uint8_t images[4][3u * PW_FLASH_SECTOR]; /* by patch version: factory, of A, of B, the new one */
static uint32_t sizes[4];
static uint8_t kept[4][KEPT]; /* banks before everything */

/* What stands in a bank. */
struct stand {
    bool there;
    uint32_t generation, started, confirmed;
    bool damaged; /* the image */
};
#define NO 0xFFFFFFFFu
#define EMPTY { false, 0, NO, NO, false }
#define CAME_UP(generation) { true, generation, 0, 0, false }
#define FAILED(generation) { true, generation, 0, NO, false }
#define FRESH(generation) { true, generation, NO, NO, false }
#define DAMAGED(generation) { true, generation, 0, 0, true }

struct scenario {
    const char *name;
    struct stand a, b;
    uint8_t may_boot; /* patch versions, as bits, besides the new one: what boots before */
};
static const struct scenario scenarios[] = {
    { "nothing but the factory image", EMPTY, EMPTY, 1 },
    { "A", CAME_UP(0), EMPTY, 2 },
    { "B", EMPTY, CAME_UP(3), 4 },
    { "A, then B", CAME_UP(5), CAME_UP(6), 4 },
    { "B, then A", CAME_UP(5), CAME_UP(4), 2 },
    { "A, and B failed", CAME_UP(5), FAILED(6), 2 },
    { "A failed, and B", FAILED(7), CAME_UP(6), 4 },
    { "both failed", FAILED(7), FAILED(6), 1 },
    { "A, and B not yet started", CAME_UP(5), FRESH(6), 2 | 4 },
    { "wrapped", CAME_UP(0xFFFFFFFFu), CAME_UP(0), 4 },
    { "A damaged, and B", DAMAGED(6), CAME_UP(5), 4 },
    { "A, and B damaged", CAME_UP(6), DAMAGED(7), 2 }
};
#define SCENARIOS (sizeof scenarios / sizeof scenarios[0])

static void stand_put(uint8_t bank, const struct stand *stand)
{
    if (stand->there) {
        const uint32_t version = bank - 1u;
        sim_put(bank, images[version], sizes[version], stand->generation, stand->started, stand->confirmed);
    }
    if (stand->damaged) {
        sim.bytes[PW_BANK_IMAGE(bank) + 1000u] ^= 4u;
    }
}

static void keep(void)
{
    for (uint32_t bank = PW_BANK_FACTORY; bank <= (uint32_t)PW_BANK_B; bank++) {
        (void)memcpy(kept[bank], &sim.bytes[PW_BANK_ADDRESS(bank)], KEPT);
    }
}

static void restore(void)
{
    for (uint32_t bank = PW_BANK_FACTORY; bank <= (uint32_t)PW_BANK_B; bank++) {
        (void)memcpy(&sim.bytes[PW_BANK_ADDRESS(bank)], kept[bank], KEPT);
    }
    sim_power();
}

static void begin(const struct scenario *scenario)
{
    sim_begin();
    sim.erase_ticks = 3;
    sim.program_ticks = 2;
    for (uint32_t i = 0; i < 4u; i++) {
        sizes[i] = make_image(images[i], 2, SEGMENT, (uint8_t)i);
    }
    sim_put(PW_BANK_FACTORY, images[0], sizes[0], 0, 0, 0);
    stand_put(PW_BANK_A, &scenario->a);
    stand_put(PW_BANK_B, &scenario->b);
    check_case = scenario->name;
    keep();
}

/* FWU-020: the image has come up; after a cut nothing is written any more. */
static void come_up(const struct pw_boot *boot)
{
    for (uint32_t i = 0; (i < 4u) && !pw_boot_confirm(&sim_port, boot); i++) {
        sim.now += 10;
    }
}

/* A device starts, is upgraded, and starts again. */
static void live(void)
{
    struct pw_boot boot;
    if (pw_boot(&sim_port, &boot)) {
        come_up(&boot);
        pw_dfu_begin(&dfu, &sim_port, &boot);
        pw_dfu_configured(&dfu);
        (void)send_image(images[NEW], sizes[NEW]);
        (void)pw_dfu_bus_reset(&dfu);
        sim.now += 10;
        CHECK(pw_dfu_leaves(&dfu));
        if (pw_boot(&sim_port, &boot)) {
            come_up(&boot);
        }
    }
}

/* Power is back: what boots is one of the patch versions in `allowed`. */
static uint8_t boots(uint8_t allowed)
{
    struct pw_boot boot = { 0 };
    sim_power();
    CHECK(pw_boot(&sim_port, &boot));
    CHECK_EQ((1u << boot.firmware[2]) & allowed, 1u << boot.firmware[2]);
    CHECK_EQ(boot.size, sizes[boot.firmware[2]]);
    CHECK_EQ(memcmp(&sim.bytes[boot.address], images[boot.firmware[2]], boot.size), 0);
    CHECK_EQ(memcmp(&sim.bytes[PW_BANK_ADDRESS(PW_BANK_FACTORY)], kept[PW_BANK_FACTORY], KEPT), 0);
    CHECK_EQ(sim.misused, 0);
    return boot.firmware[2];
}

/* Every operation, in every way. */
static void test_upgrades(void)
{
    for (size_t i = 0; i < SCENARIOS; i++) {
        const uint8_t allowed = (uint8_t)(scenarios[i].may_boot | (1u << NEW));
        uint32_t operations;
        begin(&scenarios[i]);
        live();
        operations = sim.operations;
        CHECK_EQ(boots(1u << NEW), NEW);
        CHECK_EQ(boots(1u << NEW), NEW); /* it has come up */
        CHECK(operations >= 27u);
        for (uint32_t cut = 1; cut <= operations; cut++) {
            for (uint32_t mode = 0; mode < (2u * SIM_MODES); mode++) {
                restore();
                sim.cut_at = cut;
                sim.cut_mode = mode;
                live();
                CHECK(sim.dead);
                (void)boots(allowed);
                (void)boots(allowed); /* and if that does not come up */
            }
        }
    }
}

/* A cut upgrade is tried again, and cut again; in the end it succeeds. */
static void test_upgrades_again(void)
{
    for (uint32_t i = 0; i < 300u; i++) {
        const struct scenario *scenario = &scenarios[i % SCENARIOS];
        uint8_t allowed = (uint8_t)(scenario->may_boot | 1u | (1u << NEW));
        begin(scenario);
        if (scenario->may_boot == 4u) {
            allowed |= 2u; /* an older one that is still there */
        }
        for (uint32_t k = check_below(4); k > 0u; k--) {
            sim_power();
            sim.cut_at = 1u + check_below(30);
            sim.cut_mode = check_random();
            live();
            (void)boots(allowed);
        }
        sim_power();
        live();
        CHECK_EQ(boots(1u << NEW), NEW);
    }
}

static void test_reverts(void)
{
    for (size_t i = 0; i < SCENARIOS; i++) {
        uint32_t operations;
        struct pw_boot boot;
        begin(&scenarios[i]);
        pw_boot_revert(&sim_port);
        operations = sim.operations;
        CHECK(operations <= 2u);
        CHECK(pw_boot(&sim_port, &boot));
        CHECK_EQ(boot.bank, PW_BANK_FACTORY);
        CHECK_EQ(boot.faults, 0);
        restore();
        CHECK(pw_boot(&sim_port, &boot));
        for (uint32_t cut = 1; cut <= operations; cut++) {
            for (uint32_t mode = 0; mode < (8u * SIM_MODES); mode++) {
                restore();
                sim.cut_at = cut;
                sim.cut_mode = mode;
                pw_boot_revert(&sim_port);
                (void)boots((uint8_t)((1u << boot.firmware[2]) | 1u)); /* what it would boot without REVERT */
            }
        }
    }
}

/* Failures ----------------------------------------------------------------------------------------------------- */

static void expect(uint8_t state, enum pw_dfu_status status)
{
    const struct pw_dfu_reply reply = get_status();
    CHECK_EQ(reply.state, state);
    CHECK_EQ(reply.status, status);
    CHECK_EQ(reply.string, 0);
}

/* In DFU mode, with the record of B to be overwritten, and times of a real flash. */
static void begin_dfu(void)
{
    struct pw_boot boot;
    begin(&scenarios[5]);
    CHECK(pw_boot(&sim_port, &boot));
    pw_dfu_begin(&dfu, &sim_port, &boot);
    pw_dfu_configured(&dfu);
    sim.erase_ticks = 60u * MS;
    sim.program_ticks = 1u * MS;
}

/* The way from DNLOAD to a failure that is found while the device is busy. Returns the ms that it took. */
static uint32_t fails(enum pw_dfu_status status)
{
    uint32_t ms = 0;
    CHECK_EQ(get_status().state, PW_DFU_DNBUSY);
    while ((dfu.state != (uint8_t)PW_DFU_ERROR) && (ms < 12000u)) {
        wait_ticks(MS);
        ms++;
        if (dfu.state == (uint8_t)PW_DFU_DNLOAD_SYNC) {
            (void)get_status();
        }
    }
    expect(PW_DFU_ERROR, status);
    return ms;
}

static void send_first(void) { CHECK_EQ(request(PW_DFU_DNLOAD, 0, 2048, images[NEW]), 0); }

static void test_failures(void)
{
    uint32_t ms;
    begin_dfu();
    check_case = "failures";
    sim.locked = true;
    send_first();
    CHECK(fails(PW_DFU_WRITE) <= 1u);
    begin_dfu();
    sim.blind = PW_BANK_B; /* or else the record that may not boot would be erased without being overwritten */
    send_first();
    CHECK(fails(PW_DFU_WRITE) <= 1u);
    CHECK_EQ(sim.operations, 0);
    begin_dfu();
    send_first();
    wait_ticks(30u * MS); /* the record is being erased */
    CHECK_EQ(sim.erasures, 1);
    sim.stuck = true;
    ms = fails(PW_DFU_ERASE);
    CHECK((ms >= 9960u) && (ms <= 9972u)); /* 10 s after the block */
    sim.stuck = false;
    CHECK_EQ(request(PW_DFU_CLRSTATUS, 0, 0, NULL), 0);
    CHECK(send_image(images[NEW], sizes[NEW]));
    begin_dfu();
    check_case = "erasure";
    sim.sticky = true;
    send_first();
    wait_ticks(0);
    sim.bytes[0x300000] = 0; /* what `sticky` did to the zeros */
    CHECK(fails(PW_DFU_CHECK_ERASED) >= 60u);
    begin_dfu();
    check_case = "page";
    send_first();
    wait_ticks(123u * MS);
    CHECK_EQ(sim.erasures, 2);
    sim.sticky = true;
    CHECK(fails(PW_DFU_VERIFY) <= 5u);
    CHECK_EQ(request(PW_DFU_CLRSTATUS, 0, 0, NULL), 0);
    sim.sticky = false;
    send_first();
    wait_ticks(123u * MS);
    sim.stuck = true;
    (void)fails(PW_DFU_PROG);
    CHECK_EQ(request(PW_DFU_CLRSTATUS, 0, 0, NULL), 0); /* the flash does not end: a download waits for it, 10 s */
    send_first();
    ms = fails(PW_DFU_WRITE);
    CHECK((ms >= 9990u) && (ms <= 10001u));
    CHECK_EQ(request(PW_DFU_CLRSTATUS, 0, 0, NULL), 0);
    sim.step = 100000;
    CHECK_EQ(request(PW_DFU_UPLOAD, 0, 2048, NULL), -1);
    expect(PW_DFU_ERROR, PW_DFU_WRITE);
    CHECK_EQ(sim.misused, 0);
}

static void test_manifest_failures(void)
{
    for (uint32_t i = 0; i < 4u; i++) {
        begin_dfu();
        check_case = "manifestation fails";
        CHECK(send_blocks(images[NEW], sizes[NEW]));
        CHECK_EQ(request(PW_DFU_DNLOAD, 3, 0, NULL), 0);
        sim.mute = i == 0u;
        sim.locked = i == 1u;
        sim.sticky = i == 2u;
        if (i == 3u) {
            sim.bytes[0x301000u + 700u] ^= 1u; /* it was right when it was read back */
        }
        CHECK_EQ(get_status().poll_ms, 2500);
        wait_ticks(2400u * MS);
        {
            const struct pw_dfu_reply reply = get_status(); /* not too early: it is an error already */
            CHECK_EQ(reply.state, PW_DFU_ERROR);
            CHECK_EQ(reply.status, (i < 2u) ? PW_DFU_WRITE : ((i == 2u) ? PW_DFU_VERIFY : PW_DFU_FILE));
            CHECK_EQ(reply.string, (i == 3u) ? (16u + (uint32_t)PW_IMAGE_HASH) : 0u);
        }
        sim.mute = false;
        sim.locked = false;
        (void)boots(2);
    }
}

/* DFU-013: ERROR does not stop what the flash is doing, and nothing more is begun. */
static void test_error_while_busy(void)
{
    begin_dfu();
    check_case = "error while busy";
    send_first();
    wait_ticks(30u * MS);
    CHECK_EQ(get_status().poll_ms, 128);
    CHECK_EQ(request(PW_DFU_GETSTATE, 0, 1, NULL), -1);
    expect(PW_DFU_ERROR, PW_DFU_STALLEDPKT);
    CHECK_EQ(request(PW_DFU_CLRSTATUS, 0, 0, NULL), 0);
    CHECK(sim_busy(NULL));
    send_first();
    CHECK_EQ(get_status().poll_ms, 128);
    wait_ticks(128u * MS);
    CHECK_EQ(get_status().poll_ms, 128); /* it had to wait */
    wait_ticks(128u * MS);
    expect(PW_DFU_DNLOAD_IDLE, PW_DFU_OK);
    CHECK_EQ(sim.erasures, 3);
    CHECK_EQ(request(PW_DFU_DNLOAD, 0, 2048, images[NEW]), -1);
    wait_ticks(1000u * MS);
    CHECK_EQ(sim.erasures, 3);
    CHECK_EQ(request(PW_DFU_CLRSTATUS, 0, 0, NULL), 0);
    send_first();
    wait_ticks(30u * MS);
    CHECK_EQ(request(PW_DFU_ABORT, 0, 0, NULL), -1);
    CHECK_EQ(request(PW_DFU_CLRSTATUS, 0, 0, NULL), 0);
    CHECK_EQ(request(PW_DFU_UPLOAD, 0, 2048, NULL), 2048); /* waits for the flash */
    CHECK_BYTES(dfu_in, images[1], 2048);
    CHECK_EQ(sim.misused, 0);
}

/* DFU-015 */
static void test_bus_reset(void)
{
    struct pw_boot boot;
    begin_dfu();
    check_case = "bus reset";
    pw_dfu_begin(&dfu, &sim_port, &(const struct pw_boot){ .bank = PW_BANK_A });
    CHECK(!pw_dfu_bus_reset(&dfu)); /* of enumeration */
    CHECK(!pw_dfu_leaves(&dfu));
    expect(PW_DFU_IDLE, PW_DFU_OK);
    pw_dfu_configured(&dfu);
    send_first();
    wait_ticks(30u * MS);
    CHECK_EQ(sim.erasures, 1);
    CHECK(pw_dfu_bus_reset(&dfu));
    CHECK(!pw_dfu_leaves(&dfu));
    CHECK(pw_dfu_due(&dfu) > sim.now);
    CHECK(pw_dfu_due(&dfu) < (sim.now + MS));
    wait_ticks(29u * MS);
    CHECK(!pw_dfu_leaves(&dfu));
    wait_ticks(3u * MS);
    CHECK(pw_dfu_leaves(&dfu));
    CHECK(pw_dfu_bus_reset(&dfu));
    CHECK_EQ(sim.erasures, 1);
    CHECK(pw_boot(&sim_port, &boot));
    CHECK_EQ(boot.bank, PW_BANK_A);
    begin_dfu();
    send_first();
    wait_ticks(30u * MS);
    sim.stuck = true;
    CHECK(pw_dfu_bus_reset(&dfu));
    wait_ticks(9990u * MS);
    CHECK(!pw_dfu_leaves(&dfu));
    wait_ticks(20u * MS);
    CHECK(pw_dfu_leaves(&dfu)); /* a flash that never ends does not keep the device */
    CHECK_EQ(sim.misused, 0);
}

int main(void)
{
    test_upgrades();
    test_upgrades_again();
    test_reverts();
    test_failures();
    test_manifest_failures();
    test_error_while_busy();
    test_bus_reset();
    return check_end();
}
