/* A factory image as whoever makes a device would write it. Its segments are no programs: this port runs none. */
#include "factory.h"

#include <string.h>

#include "fwu.h"

#define SEGMENTS 2u
#define SEGMENT_SIZE 6001u /* as many blocks of DFU as a real one needs, and padding */
#define ROOM (4u * PW_FLASH_SECTOR)
#define TABLE_ENDS (PW_IMAGE_HEADER + (SEGMENTS * PW_IMAGE_ENTRY))

/* Writes entry and bytes of a segment; returns where the next one begins. */
static uint32_t segment_put(uint8_t *image, uint32_t index, uint8_t target, uint32_t at, const char *text)
{
    const uint32_t size = SEGMENT_SIZE;
    const size_t length = strlen(text);
    uint8_t *entry = &image[PW_IMAGE_HEADER + (index * PW_IMAGE_ENTRY)];
    struct pw_sha256 sum;
    for (size_t i = 0; i < size; i++) {
        image[at + i] = (uint8_t)text[i % length];
    }
    entry[0] = target;
    pw_put32(&entry[4], at);
    pw_put32(&entry[8], size);
    pw_put32(&entry[12], pw_crc32(0, &image[at], size));
    pw_sha256_begin(&sum);
    pw_sha256_add(&sum, &image[at], size);
    pw_sha256_end(&sum, &entry[16]);
    return (at + size + 3u) & ~(uint32_t)3u;
}

/* Returns the size of the image. */
static uint32_t image_put(uint8_t *image, const uint8_t firmware[3])
{
    uint32_t at = TABLE_ENDS;
    (void)memset(image, 0, ROOM);
    at = segment_put(image, 0, PW_ALL_PROCESSORS, at, "factory program of the processors");
    at = segment_put(image, 1, PW_CONTROLLER, at, "factory program of the controller");
    at += PW_IMAGE_SIGNED;
    (void)memcpy(image, "PWFW", 4);
    image[4] = 1;
    image[5] = SEGMENTS;
    pw_put16(&image[6], PW_HARDWARE_FIVE_BOARDS);
    (void)memcpy(&image[8], firmware, 3);
    image[11] = 1; /* protocol */
    pw_put32(&image[12], at);
    pw_put32(&image[28], pw_crc32(pw_crc32(0, image, 28), &image[PW_IMAGE_HEADER], TABLE_ENDS - PW_IMAGE_HEADER));
    (void)memset(&image[at], 0xFF, ROOM - at);
    return at;
}

void factory_image(uint8_t *flash, const uint8_t firmware[3])
{
    uint8_t *bank = &flash[PW_BANK_ADDRESS(PW_BANK_FACTORY)];
    uint8_t *image = &flash[PW_BANK_IMAGE(PW_BANK_FACTORY)];
    struct pw_record record = { 0 };
    struct pw_sha256 sum;
    (void)memset(flash, 0xFF, FACTORY_FLASH);
    record.size = image_put(image, firmware);
    pw_sha256_begin(&sum);
    pw_sha256_add(&sum, image, record.size);
    pw_sha256_end(&sum, record.digest);
    pw_record_put(bank, &record);
    (void)memset(&bank[PW_RECORD_WRITTEN], 0, PW_RECORD - PW_RECORD_WRITTEN); /* started and confirmed */
}
