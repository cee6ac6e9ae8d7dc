/* Chapter FWU: firmware images, boot records and the loader.
   The functions of the loader wait while the flash is busy; port->now has to go on meanwhile. */
#ifndef PW_FWU_H
#define PW_FWU_H

#include "bytes.h"
#include "codes.h"
#include "config.h"
#include "port.h"
#include "sums.h"

#define PW_IMAGE_HEADER 32u           /* FWU-002 */
#define PW_IMAGE_ENTRY 48u            /* FWU-006 */
#define PW_IMAGE_SEGMENT 65536u       /* the largest: FWU-008 */
#define PW_IMAGE_LARGEST 721520u
#define PW_IMAGE_SIGNED 64u           /* bytes of a signature: FWU-011 */
#define PW_HARDWARE_FIVE_BOARDS 1u    /* FWU-005 */
#define PW_FLASH_SECTOR 4096u         /* FWU-016 */
#define PW_FLASH_PAGE 256u
#define PW_FLASH_LIMIT 20000000u      /* ticks, 10 s: DFU-008; the loader gives up a flash then too */
#define PW_BANK_SIZE 0x100000u
#define PW_BANK_ADDRESS(bank) ((uint32_t)(bank) * PW_BANK_SIZE)
#define PW_BANK_IMAGE(bank) (PW_BANK_ADDRESS(bank) + PW_FLASH_SECTOR)
#define PW_RECORD 56u                 /* FWU-017 */
#define PW_RECORD_WRITTEN 48u         /* without the two marks */
#define PW_FIRST_BLOCK 2048u          /* of an image: it holds header and table (DFU-010) */

/* Images ------------------------------------------------------------------------------------------------------- */

/* The checks LENGTH to OFFSET of FWU-015 by the first `size` bytes of an image, or by all of them. */
enum pw_image_reason pw_image_head(const uint8_t *bytes, size_t size);
/* `total`; only of a head that is ACCEPTED. */
uint32_t pw_image_total(const uint8_t *head);

/* The check of a whole image as it stands in flash. */
struct pw_image {
    const struct pw_port *port;
    const uint8_t *head;
    uint32_t address, size;
    uint32_t at;      /* bytes from the beginning that were read */
    uint8_t segment;  /* whose bytes are next, or are after the next padding */
    bool bad_padding, bad_hash;
    uint32_t part_crc;
    struct pw_sha256 part, whole;
    uint8_t signature[PW_IMAGE_SIGNED];
    /* When it is over: */
    bool unreadable;  /* the flash did not answer */
    uint8_t reason;   /* enum pw_image_reason */
    uint8_t digest[32]; /* SHA-256 of all of it, if it is ACCEPTED */
};
/* `block` has room for PW_FIRST_BLOCK bytes and stays untouched until the check is over. */
void pw_image_begin(struct pw_image *image, const struct pw_port *port, uint32_t address, uint32_t size,
                    uint8_t *block);
/* Reads one page at most; returns whether there is more to do. Not while the flash is busy. */
bool pw_image_step(struct pw_image *image);

/* Boot records ------------------------------------------------------------------------------------------------- */

struct pw_record {
    uint32_t generation, size;
    uint8_t digest[32];
    uint32_t started, confirmed;
};
/* False: no record, the bank is empty. */
bool pw_record_get(struct pw_record *record, const uint8_t bytes[PW_RECORD]);
void pw_record_put(uint8_t bytes[PW_RECORD_WRITTEN], const struct pw_record *record);
bool pw_record_may_boot(const struct pw_record *record); /* FWU-020 */
/* The banks that a loader tries (FWU-019), by the records of A and B: NULL if there is none. Returns how many. */
uint32_t pw_boot_order(const struct pw_record *a, const struct pw_record *b, uint8_t order[3]);

/* Flash: these wait ------------------------------------------------------------------------------------------- */

/* Waits until the flash has nothing to do; false if that takes longer than PW_FLASH_LIMIT. */
bool pw_flash_wait(const struct pw_port *port);
/* The record of a bank. A flash that does not answer is no empty bank. */
enum pw_found { PW_FOUND_RECORD, PW_FOUND_NONE, PW_FOUND_UNREADABLE };
enum pw_found pw_flash_record(const struct pw_port *port, uint8_t bank, struct pw_record *record);
/* All records, by bank, and the order of the banks; false if one cannot be read. */
struct pw_banks {
    bool has[4];
    struct pw_record records[4];
    uint8_t order[3];
    uint32_t count;
};
bool pw_flash_banks(const struct pw_port *port, struct pw_banks *banks);
/* Whether the image of a bank has the SHA-256 that the record names. */
bool pw_flash_intact(const struct pw_port *port, uint8_t bank, const struct pw_record *record);

/* The loader --------------------------------------------------------------------------------------------------- */

/* What the loader started. */
struct pw_boot {
    uint8_t bank;       /* enum pw_bank; PW_BANK_NONE if there was nothing to start */
    uint8_t firmware[3];
    uint16_t faults;    /* PW_FAULT_FLASH: FWU-019 */
    uint32_t address;   /* of the image in flash */
    uint32_t size;
};
/* FWU-019, FWU-020: finds what is to be started, and writes `started` if it is on trial. False: nothing boots, not even
   the factory image. */
bool pw_boot(const struct pw_port *port, struct pw_boot *boot);
/* The program of a processor, as its boot program takes it (FWU-021): size, segment and CRC-32, piece by piece. False:
   the flash does not answer, or `send` has said false. */
bool pw_boot_program(const struct pw_port *port, const struct pw_boot *boot, uint8_t processor,
                     bool (*send)(void *context, const uint8_t *bytes, size_t size), void *context);
/* FWU-022, before pw_boot. */
void pw_boot_revert(const struct pw_port *port);
/* FWU-020: what runs has come up. Begins to write `confirmed` if it is not yet, and does not wait for it. True if
   nothing is left to do; otherwise call it again some ms later. */
bool pw_boot_confirm(const struct pw_port *port, const struct pw_boot *boot);

#endif
