/* Any bytes for each reader: blocks, frames, messages of the chain, heads of images, boot records. What is accepted
   encodes back to the same bytes. */
#include <stdlib.h>
#include <string.h>

#include "blk.h"
#include "chn.h"
#include "fwu.h"
#include "ser.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void require(bool good)
{
    if (!good) {
        abort();
    }
}

static void read_block(const uint8_t *data, size_t size)
{
    uint8_t bytes[PW_BLOCK] = {0};
    struct pw_block block;
    (void)pw_block_check(data, size, &block);
    memcpy(bytes, data, size < PW_BLOCK ? size : PW_BLOCK);
    pw_put32(bytes + 28, 0);
    pw_put32(bytes + 28, pw_crc32(0, bytes, PW_BLOCK));
    if (pw_block_check(bytes, PW_BLOCK, &block) == PW_ACCEPTED) {
        require(block.kind >= PW_UPDATE && block.kind <= PW_NO_OP);
        require(pw_block_number(bytes, PW_BLOCK) == block.sequence);
    }
}

static void read_frame(const uint8_t *data, size_t size)
{
    uint8_t bytes[PW_FRAME_MOST];
    uint8_t again[PW_FRAME_MOST];
    struct pw_frame frame;
    if (size > sizeof bytes) {
        return;
    }
    memcpy(bytes, data, size);
    if (memchr(bytes, 0, size) == NULL && pw_frame_decode(&frame, bytes, size)) {
        require(pw_frame_encode(again, frame.kind, frame.body, frame.size) == size + 1u);
        require(memcmp(again, data, size) == 0 && again[size] == 0u); /* no content has two encodings: SER-003 */
    }
}

static void read_message(const uint8_t *data, size_t size)
{
    uint8_t again[PW_MESSAGE];
    struct pw_load load;
    struct pw_program program;
    struct pw_report report;
    struct pw_playing playing;
    struct pw_identity identity;
    if (pw_load_get(&load, 3, data, size)) {
        require(pw_load_put(again, 3, &load) == size + 3u && memcmp(again + 3, data, size) == 0);
    }
    if (pw_program_get(&program, 3, data, size)) {
        require(pw_program_put(again, 3, &program) == size + 3u && memcmp(again + 3, data, size) == 0);
    }
    if (pw_report_get(&report, data, size)) {
        require(pw_report_put(again, &report) == size + 3u && memcmp(again + 3, data, size) == 0);
    }
    if (pw_playing_get(&playing, data, size)) {
        require(pw_playing_put(again, &playing) == size + 3u && memcmp(again + 3, data, size) == 0);
    }
    if (pw_identity_get(&identity, data, size)) {
        require(pw_identity_put(again, &identity) == size + 3u && memcmp(again + 3, data, size) == 0);
    }
}

static void read_image(const uint8_t *data, size_t size)
{
    struct pw_record record;
    uint8_t again[PW_RECORD_WRITTEN];
    if (pw_image_head(data, size) == PW_IMAGE_ACCEPTED) {
        require(pw_image_total(data) <= PW_IMAGE_LARGEST);
    }
    if (size >= PW_RECORD && pw_record_get(&record, data)) {
        pw_record_put(again, &record);
        require(memcmp(again, data, sizeof again) == 0);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size == 0u) {
        return 0;
    }
    switch (data[0] % 4u) {
    case 0:
        read_block(data + 1, size - 1u);
        break;
    case 1:
        read_frame(data + 1, size - 1u);
        break;
    case 2:
        read_message(data + 1, size - 1u);
        break;
    default:
        read_image(data + 1, size - 1u);
        break;
    }
    return 0;
}
