/* The seam between the core and a board: what the core asks for. Everything else is given to the core by calls. */
#ifndef PW_PORT_H
#define PW_PORT_H

#include "bytes.h"

struct pw_port {
    void *self; /* handed to every function */
    /* Ticks of 0.5 us since power-up; never goes back. */
    uint64_t (*now)(void *self);
    /* Send one message on the first link, route header first; the port adds END. False if it could not leave within
       STALL_MS: the chain is broken then (CHN-021). An answer is given to pw_device_chain, now or later. */
    bool (*chain)(void *self, const uint8_t *message, size_t size);
    /* Raise the sync line for one tick, now (CHN-026). */
    void (*sync)(void *self);
    /* Let a light on a board blink for five seconds (REQ-012). */
    void (*identify)(void *self, uint8_t board);
    /* The serial NOR flash of FWU-016. `erase` and `program` begin the work and return at once; `flash_busy` says
       whether it goes on; each is called only while it does not. False: the flash does not answer or refused. */
    bool (*flash_read)(void *self, uint32_t address, uint8_t *data, size_t size);
    bool (*flash_erase)(void *self, uint32_t address); /* one sector of 4096 bytes */
    bool (*flash_program)(void *self, uint32_t address, const uint8_t *data, size_t size); /* within one page of 256 */
    bool (*flash_busy)(void *self);
    /* Whether a trusted key has signed the `size` bytes of flash from `address` on (FWU-012): key_id names it. NULL on
       a board that trusts no keys, which accepts every signature. */
    bool (*flash_signed)(void *self, const uint8_t key_id[8], uint32_t address, uint32_t size,
                         const uint8_t signature[64]);
    /* Whether the last erasure or programming ended in failure, as a flash says in its status register. NULL if yours
       says nothing: then what was written is judged by reading it back alone. */
    bool (*flash_failed)(void *self);
    /* Start all processors of the chain anew, together with the controller (CHN-021): they lose their numbers, and
       their outputs are low. pw_device_begin calls it. NULL on a board that restarts them with the controller. */
    void (*restart_processors)(void *self);
    /* Send the next processor, which has no number yet, its program (FWU-021): pw_boot_program gives the bytes. False
       if it has not started; the core tries three times. NULL if the processors have a program of their own. */
    bool (*program)(void *self, uint8_t processor);
};

#endif
