/* Chapter DFU: vectors of states, blocks and answers, and a host that downloads to a flash in memory. */
#include "flash_sim.h"
#include "vectors.h"

#define SEGMENT 2500u /* of the images here: three blocks, of which the last is short */
#define MS PW_TICKS_PER_MS

static uint8_t image_f[256], image_a[2u * 4096u], image_b[2u * 4096u], largest[MADE_LARGEST];
static uint32_t size_f, size_a, size_b;

/* A device in DFU mode that runs A (confirmed), or the factory image; a host has configured it. */
static void begin(bool with_a)
{
    struct pw_boot boot;
    sim_begin();
    size_f = make_image(image_f, 2, 20, 0);
    size_a = make_image(image_a, 2, SEGMENT, 1);
    size_b = make_image(image_b, 2, SEGMENT, 2);
    sim_put(PW_BANK_FACTORY, image_f, size_f, 0, 0, 0);
    if (with_a) {
        sim_put(PW_BANK_A, image_a, size_a, 7, 0, 0);
    }
    CHECK(pw_boot(&sim_port, &boot));
    CHECK_EQ(boot.bank, with_a ? PW_BANK_A : PW_BANK_FACTORY);
    pw_dfu_begin(&dfu, &sim_port, &boot);
    pw_dfu_configured(&dfu);
}

static uint8_t state(void) { return (request(PW_DFU_GETSTATE, 0, 1, NULL) == 1) ? dfu_in[0] : 0xFFu; }

static void expect(uint8_t wanted, enum pw_dfu_status status, uint8_t string)
{
    const struct pw_dfu_reply reply = get_status();
    CHECK_EQ(reply.state, wanted);
    CHECK_EQ(reply.status, status);
    CHECK_EQ(reply.string, string);
    CHECK_EQ(reply.poll_ms, 0);
}

static bool is_empty(uint8_t bank)
{
    struct pw_record record;
    return !pw_record_get(&record, &sim.bytes[PW_BANK_ADDRESS(bank)]);
}

/* Vectors ------------------------------------------------------------------------------------------------------ */

static void test_replies_and_blocks(void)
{
    for (size_t i = 0; i < VEC_COUNT(vec_dfu_replies); i++) {
        uint8_t bytes[6];
        check_case = vec_dfu_replies[i].name;
        pw_dfu_reply_put(bytes, &vec_dfu_replies[i].fields);
        CHECK_BYTES(bytes, vec_dfu_replies[i].bytes, 6);
    }
    for (size_t i = 0; i < VEC_COUNT(vec_dfu_blocks); i++) {
        const struct vec_dfu_block *v = &vec_dfu_blocks[i];
        check_case = v->name;
        CHECK_EQ(pw_dfu_block(v->block, v->length, v->received, v->total), v->status);
        if (v->poll_ms != 0u) {
            CHECK_EQ(pw_dfu_block_ms(v->block), v->poll_ms);
        }
    }
}

/* Leads a fresh device to a state; whether its work is over there. */
static void lead_to(uint8_t to, uint8_t event)
{
    const bool over = event == (uint8_t)PW_DFU_ON_GETSTATUS;
    const bool manifests = (to == (uint8_t)PW_DFU_MANIFEST_SYNC) || (to == (uint8_t)PW_DFU_MANIFEST);
    begin(event != (uint8_t)PW_DFU_ON_UPLOAD_END || (to == (uint8_t)PW_DFU_UPLOAD_IDLE));
    if ((to == (uint8_t)PW_DFU_DNLOAD_SYNC) || (to == (uint8_t)PW_DFU_DNBUSY)) {
        CHECK_EQ(request(PW_DFU_DNLOAD, 0, 2048, image_b), 0);
    } else if (manifests || ((to == (uint8_t)PW_DFU_DNLOAD_IDLE) && (event == (uint8_t)PW_DFU_ON_DNLOAD_END))) {
        CHECK(send_blocks(image_b, size_b));
    } else if (to == (uint8_t)PW_DFU_DNLOAD_IDLE) {
        CHECK_EQ(request(PW_DFU_DNLOAD, 0, 2048, image_b), 0);
        CHECK_EQ(settle().state, PW_DFU_DNLOAD_IDLE);
    } else if (to == (uint8_t)PW_DFU_UPLOAD_IDLE) {
        CHECK_EQ(request(PW_DFU_UPLOAD, 0, 2048, NULL), 2048);
    } else if (to == (uint8_t)PW_DFU_ERROR) {
        CHECK_EQ(request(PW_DFU_CLRSTATUS, 0, 0, NULL), -1);
    } else {
        CHECK_EQ(to, PW_DFU_IDLE);
    }
    if (manifests) {
        CHECK_EQ(request(PW_DFU_DNLOAD, 3, 0, NULL), 0);
    }
    if ((to == (uint8_t)PW_DFU_DNBUSY) || (to == (uint8_t)PW_DFU_MANIFEST)) {
        (void)get_status();
    } else if (over && manifests) {
        (void)get_status(); /* manifestation begins with it */
        wait_ticks(2500u * MS);
    } else if (over) {
        wait_ticks(200u * MS);
    } else {
        /* at once */
    }
    CHECK_EQ(dfu.state, to);
}

/* Lets an event happen; whether it was answered with STALL. */
static bool happens(uint8_t event)
{
    int answered = 0;
    uint16_t number = (uint16_t)((dfu.state == (uint8_t)PW_DFU_UPLOAD_IDLE) ? 1u : 0u);
    switch (event) {
    case PW_DFU_ON_DNLOAD:
        number = (uint16_t)(dfu.received / 2048u);
        answered = request(PW_DFU_DNLOAD, number, 2048, &image_b[2048u * number]);
        break;
    case PW_DFU_ON_UPLOAD_END:
        if (number == 1u) {
            CHECK_EQ(request(PW_DFU_UPLOAD, 1, 2048, NULL), 2048);
            number = 2;
        }
        answered = request(PW_DFU_UPLOAD, number, 2048, NULL);
        CHECK(answered < 2048);
        break;
    case PW_DFU_ON_POLL_TIMEOUT:
        wait_ticks(2500u * MS);
        break;
    case PW_DFU_ON_FAILURE:
        sim.mute = true;
        wait_ticks(200u * MS);
        break;
    case PW_DFU_ON_BUS_RESET:
        CHECK(pw_dfu_bus_reset(&dfu));
        break;
    case PW_DFU_ON_UPLOAD:
        answered = request(PW_DFU_UPLOAD, number, 2048, NULL);
        break;
    case PW_DFU_ON_DNLOAD_END:
        answered = request(PW_DFU_DNLOAD, 3, 0, NULL);
        break;
    case PW_DFU_ON_REFUSED:
        answered = request(7, 0, 0, NULL);
        break;
    case PW_DFU_ON_GETSTATUS:
    case PW_DFU_ON_GETSTATUS_BUSY:
        answered = request(PW_DFU_GETSTATUS, 0, 6, NULL);
        break;
    case PW_DFU_ON_DETACH:
        answered = request(PW_DFU_DETACH, 1000, 0, NULL);
        break;
    case PW_DFU_ON_CLRSTATUS:
        answered = request(PW_DFU_CLRSTATUS, 0, 0, NULL);
        break;
    case PW_DFU_ON_GETSTATE:
        answered = request(PW_DFU_GETSTATE, 0, 1, NULL);
        break;
    default:
        answered = request(PW_DFU_ABORT, 0, 0, NULL);
        break;
    }
    return answered < 0;
}

static void test_transitions(void)
{
    uint32_t driven = 0;
    for (size_t i = 0; i < VEC_COUNT(vec_dfu_transitions); i++) {
        const struct vec_dfu_transition *v = &vec_dfu_transitions[i];
        const bool works = (v->state == (uint8_t)PW_DFU_DNLOAD_SYNC) || (v->state == (uint8_t)PW_DFU_DNBUSY) ||
                           (v->state == (uint8_t)PW_DFU_MANIFEST);
        bool stalls;
        check_case = "dfu_transitions";
        CHECK_EQ(pw_dfu_after(v->state, (enum pw_dfu_event)v->event, &stalls), v->next);
        CHECK_EQ(stalls, v->stalls);
        if ((v->state >= (uint8_t)PW_DFU_IDLE) && (v->state != (uint8_t)PW_DFU_MANIFEST_WAIT_RESET) &&
            (v->event != (uint8_t)PW_DFU_ON_REATTACHED) && (works || (v->event != (uint8_t)PW_DFU_ON_FAILURE))) {
            check_case = "dfu_transitions, driven";
            lead_to(v->state, v->event);
            CHECK_EQ(happens(v->event), v->stalls);
            CHECK_EQ(dfu.state, v->next);
            CHECK_EQ(sim.misused, 0);
            driven++;
        }
    }
    CHECK_EQ(driven, (8u * 13u) + 3u);
}

/* What GETSTATUS says of an image that is refused (DFU-012), and that nothing was erased for a bad header. */
static void test_refused_images(void)
{
    for (size_t i = 0; i < VEC_COUNT(vec_refused_images); i++) {
        const struct vec_refused_image *v = &vec_refused_images[i];
        const uint32_t size = v->size - 16u;
        const bool head = v->reason <= (uint8_t)PW_IMAGE_OFFSET;
        check_case = v->name;
        if (v->reason == (uint8_t)PW_IMAGE_SUFFIX) {
            continue; /* of files */
        }
        begin(true);
        if (size == 0u) {
            CHECK_EQ(request(PW_DFU_DNLOAD, 0, 0, NULL), -1);
            expect(PW_DFU_ERROR, PW_DFU_STALLEDPKT, 0);
        } else if (v->reason == (uint8_t)PW_IMAGE_TOTAL) { /* DFU-009 comes first */
            CHECK_EQ(request(PW_DFU_DNLOAD, 0, (uint16_t)size, v->bytes), -1);
            expect(PW_DFU_ERROR, PW_DFU_ADDRESS, 0);
        } else if (head) {
            const bool stalls = v->reason == (uint8_t)PW_IMAGE_LENGTH;
            CHECK_EQ(request(PW_DFU_DNLOAD, 0, (uint16_t)size, v->bytes), stalls ? -1 : 0);
            expect(PW_DFU_ERROR, (enum pw_dfu_status)v->dfu_status, v->dfu_string);
        } else {
            CHECK(send_blocks(v->bytes, size));
            CHECK_EQ(request(PW_DFU_DNLOAD, 1, 0, NULL), 0);
            CHECK_EQ(get_status().poll_ms, 2500);
            wait_ticks(2500u * MS);
            expect(PW_DFU_ERROR, (enum pw_dfu_status)v->dfu_status, v->dfu_string);
        }
        CHECK(pw_dfu_string(&dfu, v->dfu_string) != NULL);
        CHECK(is_empty(PW_BANK_B));
        CHECK_EQ(sim.operations != 0u, !head && (v->reason != (uint8_t)PW_IMAGE_TOTAL));
        CHECK_EQ(request(PW_DFU_CLRSTATUS, 0, 0, NULL), 0);
        expect(PW_DFU_IDLE, PW_DFU_OK, 0);
        CHECK(send_image(image_b, size_b));
    }
    CHECK(pw_dfu_string(&dfu, 16) == NULL);
    CHECK(pw_dfu_string(&dfu, 31) == NULL);
    CHECK(pw_dfu_string(&dfu, 4) == NULL);
}

/* Downloads ---------------------------------------------------------------------------------------------------- */

static void test_download(void)
{
    struct pw_boot boot;
    struct pw_record record;
    check_case = "download";
    begin(true);
    CHECK_EQ(pw_dfu_due(&dfu), PW_NEVER);
    CHECK(send_image(image_b, size_b));
    expect(PW_DFU_IDLE, PW_DFU_OK, 0);
    CHECK_EQ(pw_dfu_due(&dfu), PW_NEVER);
    CHECK_EQ(sim.erasures, 3);   /* the record, and two of the image */
    CHECK_EQ(sim.programs, 8u + 8u + 5u + 1u);
    CHECK_BYTES(&sim.bytes[0x301000], image_b, size_b);
    CHECK(pw_record_get(&record, &sim.bytes[0x300000]));
    CHECK_EQ(record.generation, 8);
    CHECK_EQ(record.started, UINT32_MAX);
    CHECK_EQ(record.confirmed, UINT32_MAX);
    CHECK(pw_dfu_bus_reset(&dfu));
    CHECK(pw_dfu_leaves(&dfu));
    CHECK_EQ(request(PW_DFU_GETSTATUS, 0, 6, NULL), -1);
    CHECK(pw_boot(&sim_port, &boot));
    CHECK_EQ(boot.bank, PW_BANK_B);
    CHECK_EQ(boot.faults, 0);
    check_case = "download over the factory image";
    begin(false);
    CHECK(send_image(image_b, size_b));
    CHECK(pw_record_get(&record, &sim.bytes[0x200000]));
    CHECK_EQ(record.generation, 0);
    CHECK(send_image(image_a, size_a)); /* another one instead */
    CHECK(pw_boot(&sim_port, &boot));
    CHECK_EQ(boot.firmware[2], 1);
    check_case = "generation of a bank that may not boot";
    begin(false);
    sim_put(PW_BANK_B, image_b, size_b, UINT32_MAX, 0, UINT32_MAX);
    CHECK(send_image(image_a, size_a));
    CHECK(pw_record_get(&record, &sim.bytes[0x200000]));
    CHECK_EQ(record.generation, 0);
    CHECK_EQ(sim.misused, 0);
}

static void test_largest(void)
{
    struct pw_boot boot;
    const uint32_t size = make_image(largest, 11, PW_IMAGE_SEGMENT, 9);
    uint32_t same = 0;
    check_case = "largest image";
    CHECK_EQ(size, PW_IMAGE_LARGEST);
    begin(true);
    sim.erase_ticks = 50u * MS;
    CHECK(send_image(largest, size));
    CHECK_EQ(sim.erasures, 178);
    for (uint32_t n = 0; n < 353u; n++) {
        const uint32_t left = size - (n * 2048u);
        const uint32_t bytes = (left < 2048u) ? left : 2048u;
        CHECK_EQ(request(PW_DFU_UPLOAD, (uint16_t)n, 2048, NULL), bytes);
        same += (memcmp(dfu_in, &largest[n * 2048u], bytes) == 0) ? 1u : 0u;
    }
    CHECK_EQ(same, 353);
    CHECK_EQ(state(), PW_DFU_IDLE);
    CHECK(pw_boot(&sim_port, &boot));
    CHECK_EQ(boot.size, size);
}

/* DFU-008 */
static void test_times(void)
{
    check_case = "times";
    for (uint32_t early = 0; early < 2u; early++) {
        begin(true);
        sim.step = 0;
        sim.erase_ticks = 10;
        sim.program_ticks = 10;
        CHECK_EQ(request(PW_DFU_DNLOAD, 0, 2048, image_b), 0);
        sim.now += 500;
        CHECK_EQ(get_status().poll_ms, 128);
        for (uint32_t i = 0; i < 1000u; i++) {
            sim.now += 10;
            pw_dfu_poll(&dfu);
        }
        CHECK_EQ(pw_dfu_due(&dfu), PW_NEVER); /* the work is over, its time is not */
        CHECK_EQ(dfu.state, PW_DFU_DNBUSY);
        sim.now += (128u * MS) - 10000u - early; /* one tick too early, or in time */
        CHECK_EQ(state(), (early == 1u) ? 0xFFu : (uint8_t)PW_DFU_DNLOAD_SYNC);
        expect((early == 1u) ? PW_DFU_ERROR : PW_DFU_DNLOAD_IDLE, (early == 1u) ? PW_DFU_STALLEDPKT : PW_DFU_OK, 0);
    }
    CHECK_EQ(request(PW_DFU_DNLOAD, 1, 2048, &image_b[2048]), -1); /* one of them is in ERROR, where it stays */
    begin(true);
    sim.erase_ticks = 400u * MS; /* as slow as flash gets: the same answer again */
    CHECK_EQ(request(PW_DFU_DNLOAD, 0, 2048, image_b), 0);
    for (uint32_t i = 0; i < 6u; i++) {
        CHECK_EQ(get_status().poll_ms, 128);
        wait_ticks(128u * MS);
    }
    CHECK_EQ(settle().state, PW_DFU_DNLOAD_IDLE);
    CHECK_EQ(request(PW_DFU_DNLOAD, 1, 2048, &image_b[2048]), 0);
    CHECK_EQ(get_status().poll_ms, 8);
    wait_ticks(200u * MS);
    expect(PW_DFU_DNLOAD_IDLE, PW_DFU_OK, 0);
    wait_ticks(200u * MS);
    CHECK_EQ(request(PW_DFU_DNLOAD, 2, (uint16_t)(size_b - 4096u), &image_b[4096]), 0);
    wait_ticks(500u * MS); /* the work is over before the first question */
    expect(PW_DFU_DNLOAD_IDLE, PW_DFU_OK, 0);
    CHECK_EQ(sim.misused, 0);
}

/* DFU-009, DFU-014, and requests that are malformed. */
static void test_refusals(void)
{
    static const struct pw_setup bad[] = {
        { 0xA1, PW_DFU_DNLOAD, 0, 0, 2048 }, { 0x21, PW_DFU_UPLOAD, 0, 0, 2048 }, { 0x21, PW_DFU_GETSTATUS, 0, 0, 0 },
        { 0x21, PW_DFU_ABORT, 1, 0, 0 }, { 0x21, PW_DFU_ABORT, 0, 0, 1 }, { 0xA1, PW_DFU_GETSTATE, 1, 0, 1 },
        { 0x21, PW_DFU_DETACH, 0, 0, 0 }, { 0x21, 9, 0, 0, 0 }
    };
    const struct pw_setup other = { 0x21, PW_DFU_DETACH, 0, 1, 0 };
    check_case = "malformed requests";
    begin(true);
    CHECK_EQ(pw_dfu_request(&dfu, &other, NULL, dfu_in), -1); /* of another interface */
    CHECK_EQ(state(), PW_DFU_IDLE);
    for (size_t i = 0; i < VEC_COUNT(bad); i++) {
        CHECK_EQ(pw_dfu_request(&dfu, &bad[i], image_b, dfu_in), -1);
        expect(PW_DFU_ERROR, PW_DFU_STALLEDPKT, 0);
        CHECK_EQ(request(PW_DFU_CLRSTATUS, 0, 0, NULL), 0);
    }
    check_case = "blocks";
    CHECK_EQ(request(PW_DFU_DNLOAD, 1, 2048, image_b), -1);
    expect(PW_DFU_ERROR, PW_DFU_ADDRESS, 0);
    CHECK_EQ(request(PW_DFU_CLRSTATUS, 0, 0, NULL), 0);
    CHECK_EQ(request(PW_DFU_DNLOAD, 0, 2049, image_b), -1);
    expect(PW_DFU_ERROR, PW_DFU_ADDRESS, 0);
    CHECK_EQ(request(PW_DFU_CLRSTATUS, 0, 0, NULL), 0);
    CHECK_EQ(request(PW_DFU_DNLOAD, 0, 2047, image_b), -1);
    expect(PW_DFU_ERROR, PW_DFU_ADDRESS, 0);
    CHECK_EQ(request(PW_DFU_DNLOAD, 0, 0, image_b), -1);
    expect(PW_DFU_ERROR, PW_DFU_ADDRESS, 0); /* that of the first failure */
    CHECK_EQ(request(PW_DFU_CLRSTATUS, 0, 0, NULL), 0);
    CHECK_EQ(sim.operations, 0);
    CHECK_EQ(request(PW_DFU_DNLOAD, 0, 2048, image_b), 0);
    CHECK_EQ(settle().state, PW_DFU_DNLOAD_IDLE);
    CHECK_EQ(request(PW_DFU_DNLOAD, 1, 0, NULL), -1);
    expect(PW_DFU_ERROR, PW_DFU_NOTDONE, 0);
    CHECK_EQ(request(PW_DFU_CLRSTATUS, 0, 0, NULL), 0);
    CHECK(send_blocks(image_b, size_b));
    CHECK_EQ(request(PW_DFU_DNLOAD, 3, 1, image_b), -1);
    expect(PW_DFU_ERROR, PW_DFU_ADDRESS, 0);
    CHECK(is_empty(PW_BANK_B));
}

static void test_upload(void)
{
    check_case = "upload";
    begin(true);
    sim_put(PW_BANK_B, image_b, size_b, 8, 0, UINT32_MAX); /* may not boot: A would */
    CHECK_EQ(request(PW_DFU_UPLOAD, 1, 2048, NULL), -1);
    expect(PW_DFU_ERROR, PW_DFU_ADDRESS, 0);
    CHECK_EQ(request(PW_DFU_CLRSTATUS, 0, 0, NULL), 0);
    CHECK_EQ(request(PW_DFU_UPLOAD, 0, 2047, NULL), -1);
    expect(PW_DFU_ERROR, PW_DFU_ADDRESS, 0);
    CHECK_EQ(request(PW_DFU_CLRSTATUS, 0, 0, NULL), 0);
    CHECK_EQ(request(PW_DFU_UPLOAD, 0, 2048, NULL), 2048);
    CHECK_BYTES(dfu_in, image_a, 2048);
    CHECK_EQ(request(PW_DFU_UPLOAD, 0, 2048, NULL), -1);
    CHECK_EQ(request(PW_DFU_CLRSTATUS, 0, 0, NULL), 0);
    CHECK(send_image(image_b, size_b)); /* now B would */
    CHECK_EQ(request(PW_DFU_UPLOAD, 0, 2048, NULL), 2048);
    CHECK_BYTES(dfu_in, image_b, 2048);
    CHECK_EQ(request(PW_DFU_UPLOAD, 1, 2048, NULL), 2048);
    CHECK_EQ(request(PW_DFU_UPLOAD, 2, 2048, NULL), size_b - 4096u);
    CHECK_BYTES(dfu_in, &image_b[4096], size_b - 4096u);
    expect(PW_DFU_IDLE, PW_DFU_OK, 0);
    CHECK_EQ(request(PW_DFU_DNLOAD, 0, 2048, image_b), 0); /* given up: A again */
    CHECK_EQ(settle().state, PW_DFU_DNLOAD_IDLE);
    CHECK_EQ(request(PW_DFU_ABORT, 0, 0, NULL), 0);
    CHECK_EQ(request(PW_DFU_UPLOAD, 0, 2048, NULL), 2048);
    CHECK_BYTES(dfu_in, image_a, 2048);
    CHECK_EQ(request(PW_DFU_ABORT, 0, 0, NULL), 0);
    CHECK_EQ(state(), PW_DFU_IDLE);
    check_case = "upload while an image is on trial"; /* A would boot, and the factory image without A */
    begin(true);
    sim_put(PW_BANK_B, image_b, size_b, 8, 0, UINT32_MAX);
    pw_dfu_begin(&dfu, &sim_port, &(const struct pw_boot){ .bank = PW_BANK_B });
    CHECK_EQ(request(PW_DFU_UPLOAD, 0, 2048, NULL), 2048);
    CHECK_BYTES(dfu_in, image_a, 2048);
    CHECK_EQ(request(PW_DFU_ABORT, 0, 0, NULL), 0);
    CHECK_EQ(request(PW_DFU_DNLOAD, 0, 2048, image_b), 0);
    CHECK_EQ(settle().state, PW_DFU_DNLOAD_IDLE);
    CHECK_EQ(request(PW_DFU_ABORT, 0, 0, NULL), 0);
    CHECK_EQ(request(PW_DFU_UPLOAD, 0, 2048, NULL), size_f);
    check_case = "upload beside a damaged image";
    begin(true);
    sim_put(PW_BANK_B, image_b, size_b, 8, 0, 0);
    sim.bytes[0x301000] ^= 1u;
    pw_dfu_begin(&dfu, &sim_port, &(const struct pw_boot){ .bank = PW_BANK_A });
    CHECK_EQ(request(PW_DFU_UPLOAD, 0, 2048, NULL), 2048);
    CHECK_BYTES(dfu_in, image_a, 2048);
    check_case = "upload of a short image";
    begin(false);
    sim_put(PW_BANK_A, image_a, size_a, 0, 0, 0);
    sim_put(PW_BANK_B, image_b, size_b, 1, 0, 0);
    sim.bytes[0x301000] ^= 1u;
    sim.bytes[0x201000] ^= 1u;
    {
        const struct pw_boot nothing = { 0 }; /* so everything is looked at */
        pw_dfu_begin(&dfu, &sim_port, &nothing);
    }
    CHECK_EQ(request(PW_DFU_UPLOAD, 0, 2048, NULL), size_f);
    CHECK_BYTES(dfu_in, image_f, size_f);
    CHECK_EQ(state(), PW_DFU_UPLOAD_IDLE);
    CHECK_EQ(request(PW_DFU_UPLOAD, 1, 2048, NULL), 0);
    CHECK_EQ(state(), PW_DFU_IDLE);
    sim.bytes[0x100000] = 0;
    CHECK_EQ(request(PW_DFU_UPLOAD, 0, 2048, NULL), 0); /* nothing would boot */
    CHECK_EQ(request(PW_DFU_ABORT, 0, 0, NULL), 0);
    sim.mute = true;
    CHECK_EQ(request(PW_DFU_UPLOAD, 0, 2048, NULL), -1);
    sim.mute = false;
    expect(PW_DFU_ERROR, PW_DFU_WRITE, 0);
    begin(true);
    CHECK_EQ(request(PW_DFU_UPLOAD, 0, 2048, NULL), 2048);
    sim.mute = true;
    CHECK_EQ(request(PW_DFU_UPLOAD, 1, 2048, NULL), -1);
    expect(PW_DFU_ERROR, PW_DFU_WRITE, 0);
    CHECK_EQ(sim.misused, 0);
}

int main(void)
{
    test_replies_and_blocks();
    test_transitions();
    test_refused_images();
    test_download();
    test_largest();
    test_times();
    test_refusals();
    test_upload();
    return check_end();
}
