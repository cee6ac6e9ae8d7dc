/* Chapter DFU: requests and their answers. */
#include "dfu.h"

#include <string.h>

#define TYPE_OUT 0x21u
#define TYPE_IN 0xA1u
#define MANIFEST_MS 2500u   /* DFU-008 */
#define ERASE_MS 60u
#define PROGRAM_MS 1u
#define STRINGS 16u         /* number of a string without the reason: DFU-012 */
#define STALLED (-1)

/* Answers and blocks ------------------------------------------------------------------------------------------- */

void pw_dfu_reply_put(uint8_t bytes[6], const struct pw_dfu_reply *reply)
{
    bytes[0] = reply->status;
    pw_put16(&bytes[1], reply->poll_ms & 0xFFFFu);
    bytes[3] = (uint8_t)((reply->poll_ms >> 16) & 0xFFu);
    bytes[4] = reply->state;
    bytes[5] = reply->string;
}

enum pw_dfu_status pw_dfu_block(uint32_t number, uint32_t length, uint32_t received, uint32_t total)
{
    const uint32_t left = total - received;
    const uint32_t wanted = (left < PW_DFU_BLOCK) ? left : PW_DFU_BLOCK;
    enum pw_dfu_status status = PW_DFU_OK;
    if (length == 0u) {
        status = (left == 0u) ? PW_DFU_OK : PW_DFU_NOTDONE;
    } else if (((number * PW_DFU_BLOCK) != received) || (length != wanted)) {
        status = PW_DFU_ADDRESS;
    } else {
        /* the block that is wanted */
    }
    return status;
}

uint32_t pw_dfu_block_ms(uint32_t number)
{
    const uint32_t begins_sector = ((number * PW_DFU_BLOCK) % PW_FLASH_SECTOR == 0u) ? 1u : 0u;
    const uint32_t record = (number == 0u) ? 1u : 0u;
    return (ERASE_MS * (begins_sector + record)) + (PROGRAM_MS * (PW_DFU_BLOCK / PW_FLASH_PAGE));
}

static const char *const reasons[] = {
    [PW_IMAGE_SUFFIX] = "no DFU suffix, or its checksum is wrong",
    [PW_IMAGE_LENGTH] = "shorter than header and table",
    [PW_IMAGE_MAGIC] = "not a firmware image",
    [PW_IMAGE_VERSION] = "another version of the container",
    [PW_IMAGE_CHECKSUM] = "the checksum of header and table is wrong",
    [PW_IMAGE_RESERVED] = "a reserved byte is not 0, or a version is reserved",
    [PW_IMAGE_HARDWARE] = "for other hardware",
    [PW_IMAGE_TARGETS] = "a target is missing, there twice, unknown or out of order",
    [PW_IMAGE_SIZE] = "a segment is empty or too large",
    [PW_IMAGE_OFFSET] = "gap or overlap between segments, or a total that they do not make",
    [PW_IMAGE_TOTAL] = "more or fewer bytes than the header says",
    [PW_IMAGE_PADDING] = "bytes between segments are not 0",
    [PW_IMAGE_HASH] = "the CRC-32 or SHA-256 of a segment is wrong",
    [PW_IMAGE_SIGNATURE] = "signed wrongly, without a key, or by nobody whom the device trusts"
};

const char *pw_dfu_string(const struct pw_dfu *dfu, uint8_t index)
{
    const char *text = NULL;
    (void)dfu;
    if ((index > STRINGS) && (index <= (STRINGS + (uint32_t)PW_IMAGE_SIGNATURE))) {
        text = reasons[index - STRINGS];
    }
    return text;
}

/* Requests ----------------------------------------------------------------------------------------------------- */

/* What a request turns out to be. */
struct request {
    enum pw_dfu_event event;
    enum pw_dfu_status status; /* of a refusal */
    enum pw_image_reason reason; /* of an image that begins */
};

static void refuse(struct request *request, enum pw_dfu_status status)
{
    request->event = PW_DFU_ON_REFUSED;
    request->status = status;
}

/* The first block: of the reasons why its image may be bad, LENGTH refuses the block itself (DFU-009). */
static enum pw_dfu_status judge_first(const struct pw_setup *setup, const uint8_t *out, enum pw_image_reason *reason)
{
    enum pw_dfu_status status = PW_DFU_ADDRESS;
    if ((setup->value == 0u) && (setup->length <= PW_DFU_BLOCK)) {
        *reason = pw_image_head(out, setup->length);
        if (*reason == PW_IMAGE_LENGTH) {
            status = PW_DFU_FILE;
        } else if (*reason == PW_IMAGE_ACCEPTED) {
            status = pw_dfu_block(0, setup->length, 0, pw_image_total(out));
        } else {
            status = PW_DFU_OK;
        }
    }
    return status;
}

static void judge_download(const struct pw_dfu *dfu, const struct pw_setup *setup, const uint8_t *out,
                           struct request *request)
{
    enum pw_dfu_status status = PW_DFU_OK;
    request->event = (setup->length > 0u) ? PW_DFU_ON_DNLOAD : PW_DFU_ON_DNLOAD_END;
    if (dfu->state == (uint8_t)PW_DFU_DNLOAD_IDLE) {
        status = pw_dfu_block(setup->value, setup->length, dfu->received, dfu->total);
    } else if ((dfu->state == (uint8_t)PW_DFU_IDLE) && (setup->length > 0u)) {
        status = judge_first(setup, out, &request->reason);
    } else {
        /* the state refuses it */
    }
    if (status != PW_DFU_OK) {
        refuse(request, status);
    }
}

/* The bytes that an UPLOAD answers; in DFU_IDLE the image is not looked for yet, and nothing depends on it. */
static uint32_t upload_bytes(const struct pw_dfu *dfu)
{
    const uint32_t at = dfu->upload_number * PW_DFU_BLOCK;
    const uint32_t left = (at < dfu->upload_size) ? (dfu->upload_size - at) : 0u;
    return (left < PW_DFU_BLOCK) ? left : PW_DFU_BLOCK;
}

static void judge_upload(const struct pw_dfu *dfu, const struct pw_setup *setup, struct request *request)
{
    const bool goes_on = dfu->state == (uint8_t)PW_DFU_UPLOAD_IDLE;
    const uint32_t number = goes_on ? dfu->upload_number : 0u;
    const bool refused = (setup->value != number) || (setup->length != PW_DFU_BLOCK);
    request->event = (goes_on && (upload_bytes(dfu) < PW_DFU_BLOCK)) ? PW_DFU_ON_UPLOAD_END : PW_DFU_ON_UPLOAD;
    if (refused && (goes_on || (dfu->state == (uint8_t)PW_DFU_IDLE))) {
        refuse(request, PW_DFU_ADDRESS);
    }
}

static struct request judge(const struct pw_dfu *dfu, const struct pw_setup *setup, const uint8_t *out)
{
    struct request request = { PW_DFU_ON_REFUSED, PW_DFU_STALLEDPKT, PW_IMAGE_ACCEPTED };
    const bool plain = setup->value == 0u;
    const bool bare = plain && (setup->length == 0u);
    if ((setup->type == TYPE_OUT) && (setup->request == (uint8_t)PW_DFU_DNLOAD)) {
        judge_download(dfu, setup, out, &request);
    } else if ((setup->type == TYPE_OUT) && (setup->request == (uint8_t)PW_DFU_CLRSTATUS) && bare) {
        request.event = PW_DFU_ON_CLRSTATUS;
    } else if ((setup->type == TYPE_OUT) && (setup->request == (uint8_t)PW_DFU_ABORT) && bare) {
        request.event = PW_DFU_ON_ABORT;
    } else if ((setup->type == TYPE_IN) && (setup->request == (uint8_t)PW_DFU_UPLOAD)) {
        judge_upload(dfu, setup, &request);
    } else if ((setup->type == TYPE_IN) && (setup->request == (uint8_t)PW_DFU_GETSTATUS) && plain) {
        request.event = (dfu->step == (uint8_t)PW_STEP_NONE) ? PW_DFU_ON_GETSTATUS : PW_DFU_ON_GETSTATUS_BUSY;
    } else if ((setup->type == TYPE_IN) && (setup->request == (uint8_t)PW_DFU_GETSTATE) && plain) {
        request.event = PW_DFU_ON_GETSTATE;
    } else {
        /* DETACH, and what the class does not know */
    }
    return request;
}

static void download_forget(struct pw_dfu *dfu)
{
    dfu->status = PW_DFU_OK;
    dfu->reason = PW_IMAGE_ACCEPTED;
    dfu->received = 0;
    dfu->total = 0;
}

static void download(struct pw_dfu *dfu, const struct pw_setup *setup, const uint8_t *out, enum pw_image_reason reason)
{
    const bool first = setup->value == 0u;
    if (reason != PW_IMAGE_ACCEPTED) {
        pw_dfu_fail_image(dfu, reason);
    } else {
        (void)memcpy(dfu->block, out, setup->length);
        if (first) {
            dfu->total = pw_image_total(dfu->block);
            dfu->received = 0;
        }
        dfu->block_at = dfu->received;
        dfu->block_size = setup->length;
        dfu->received += setup->length;
        pw_dfu_work(dfu, first ? PW_STEP_OVERWRITE : PW_STEP_ERASE, pw_dfu_block_ms(setup->value));
    }
}

/* DFU-014: what would boot next is the first image in the loader's order that is intact. The flash may still be busy
   with what ERROR did not stop; then this waits. */
static bool upload_find(struct pw_dfu *dfu)
{
    struct pw_banks banks;
    const bool readable = pw_flash_banks(dfu->port, &banks);
    dfu->upload_number = 0;
    dfu->upload_size = 0;
    for (uint32_t i = 0; (i < banks.count) && (dfu->upload_size == 0u); i++) {
        const uint8_t bank = banks.order[i];
        if (banks.has[bank] && ((dfu->intact & PW_BANK_BIT(bank)) != 0u)) {
            dfu->upload_address = PW_BANK_IMAGE(bank);
            dfu->upload_size = banks.records[bank].size;
        }
    }
    return readable;
}

static int upload(struct pw_dfu *dfu, bool first, uint8_t *in)
{
    const struct pw_port *port = dfu->port;
    int answered = STALLED;
    bool good = !first || upload_find(dfu);
    if (good) {
        const uint32_t size = upload_bytes(dfu);
        const uint32_t at = dfu->upload_number * PW_DFU_BLOCK;
        good = (size == 0u) || port->flash_read(port->self, dfu->upload_address + at, in, size);
        answered = (int)size;
        dfu->upload_number++;
    }
    if (!good) {
        answered = STALLED;
        pw_dfu_fail(dfu, PW_DFU_WRITE, PW_IMAGE_ACCEPTED);
    }
    return answered;
}

/* At most as much as was asked for. */
static int answer(const struct pw_setup *setup, uint8_t *in, const uint8_t *bytes, size_t size)
{
    const size_t sent = (setup->length < size) ? setup->length : size;
    (void)memcpy(in, bytes, sent);
    return (int)sent;
}

static int status_answer(struct pw_dfu *dfu, const struct pw_setup *setup, uint8_t *in)
{
    struct pw_dfu_reply reply = { dfu->status, 0, dfu->state, 0 };
    uint8_t bytes[6];
    if (pw_dfu_is_busy(dfu->state)) {
        reply.poll_ms = dfu->busy_ms;
        dfu->busy_until = dfu->port->now(dfu->port->self) + ((uint64_t)dfu->busy_ms * PW_TICKS_PER_MS);
    }
    if (dfu->reason != (uint8_t)PW_IMAGE_ACCEPTED) {
        reply.string = (uint8_t)(STRINGS + dfu->reason);
    }
    pw_dfu_reply_put(bytes, &reply);
    return answer(setup, in, bytes, sizeof bytes);
}

/* A request that is not refused; the state is the new one, `was` the one before. */
static int carry_out(struct pw_dfu *dfu, const struct request *request, uint8_t was, const struct pw_setup *setup,
                     const uint8_t *out, uint8_t *in)
{
    int answered = 0;
    switch (request->event) {
    case PW_DFU_ON_DNLOAD:
        download(dfu, setup, out, request->reason);
        break;
    case PW_DFU_ON_DNLOAD_END:
        pw_dfu_work(dfu, PW_STEP_MANIFEST, MANIFEST_MS);
        break;
    case PW_DFU_ON_UPLOAD:
    case PW_DFU_ON_UPLOAD_END:
        answered = upload(dfu, was == (uint8_t)PW_DFU_IDLE, in);
        break;
    case PW_DFU_ON_GETSTATUS:
    case PW_DFU_ON_GETSTATUS_BUSY:
        answered = status_answer(dfu, setup, in);
        break;
    case PW_DFU_ON_GETSTATE:
        answered = answer(setup, in, &dfu->state, 1);
        break;
    case PW_DFU_ON_CLRSTATUS:
    case PW_DFU_ON_ABORT:
        download_forget(dfu);
        break;
    case PW_DFU_ON_DETACH:
    case PW_DFU_ON_REFUSED:
    case PW_DFU_ON_REATTACHED:
    case PW_DFU_ON_POLL_TIMEOUT:
    case PW_DFU_ON_FAILURE:
    case PW_DFU_ON_BUS_RESET:
    default:
        answered = STALLED; /* does not come here */
        break;
    }
    return answered;
}

int pw_dfu_request(struct pw_dfu *dfu, const struct pw_setup *setup, const uint8_t *out, uint8_t *in)
{
    int answered = STALLED;
    if (!dfu->leaving && (setup->index == 0u)) {
        bool stalls;
        pw_dfu_time(dfu);
        const struct request request = judge(dfu, setup, out);
        const uint8_t was = dfu->state;
        const uint8_t next = pw_dfu_after(was, request.event, &stalls);
        if (stalls) {
            const bool refused = request.event == PW_DFU_ON_REFUSED;
            pw_dfu_fail(dfu, refused ? request.status : PW_DFU_STALLEDPKT,
                        (refused && (request.status == PW_DFU_FILE)) ? request.reason : PW_IMAGE_ACCEPTED);
        } else {
            dfu->state = next;
            answered = carry_out(dfu, &request, was, setup, out, in);
        }
    }
    return answered;
}

/* The device and its bus --------------------------------------------------------------------------------------- */

void pw_dfu_begin(struct pw_dfu *dfu, const struct pw_port *port, const struct pw_boot *running)
{
    struct pw_banks banks;
    bool found = false;
    (void)memset(dfu, 0, sizeof *dfu);
    dfu->port = port;
    dfu->state = PW_DFU_IDLE;
    dfu->bank = (running->bank == (uint8_t)PW_BANK_A) ? (uint8_t)PW_BANK_B : (uint8_t)PW_BANK_A;
    if (running->bank != (uint8_t)PW_BANK_NONE) {
        dfu->intact = PW_BANK_BIT(running->bank); /* the loader has just found it so */
    }
    /* What would boot next, and what would if the bank of the download were empty. */
    (void)pw_flash_banks(port, &banks);
    for (uint32_t i = 0; !found && (i < banks.count); i++) {
        const uint8_t bank = banks.order[i];
        const bool known = (dfu->intact & PW_BANK_BIT(bank)) != 0u;
        const bool intact = known || (banks.has[bank] && pw_flash_intact(port, bank, &banks.records[bank]));
        if (intact) {
            dfu->intact |= PW_BANK_BIT(bank);
            found = bank != dfu->bank;
        }
    }
}

void pw_dfu_configured(struct pw_dfu *dfu) { dfu->configured = true; }

bool pw_dfu_bus_reset(struct pw_dfu *dfu)
{
    if (dfu->configured && !dfu->leaving) {
        dfu->leaving = true;
        dfu->leave_by = dfu->port->now(dfu->port->self) + PW_FLASH_LIMIT;
        dfu->step = PW_STEP_NONE; /* nothing more is begun */
        pw_dfu_happens(dfu, PW_DFU_ON_BUS_RESET);
    }
    return dfu->leaving;
}

bool pw_dfu_leaves(const struct pw_dfu *dfu)
{
    const struct pw_port *port = dfu->port;
    return dfu->leaving && (!port->flash_busy(port->self) || (port->now(port->self) >= dfu->leave_by));
}
