/* The controller: it judges blocks and requests, keeps time and state, and plans what goes onto the chain.
   It knows no doors: USB and serial lines (usb.h, ser.h) bring it blocks and requests and fetch its records. */
#ifndef PW_DEVICE_H
#define PW_DEVICE_H

#include "ack.h"
#include "blk.h"
#include "chn.h"
#include "port.h"
#include "pul.h"
#include "sta.h"

#define PW_NEVER UINT64_MAX
#define PW_DOOR_USB 0u
#define PW_DOOR_LINE(line) (1u + (line)) /* door of serial line 0, 1, ... */
#define PW_DOORS (1u + PW_LINES)

/* What a device is; it does not change while it is powered. */
struct pw_about {
    uint8_t unique_id[8];
    uint8_t firmware[3];
    uint8_t bank;               /* that its firmware came from: enum pw_bank */
    uint16_t faults;            /* PW_FAULT_FLASH if the loader says so */
    uint16_t product;           /* of USB at run time: USB-001 */
    const char *product_name;   /* ASCII */
    const char *serial_number;  /* ASCII, 1 to 64 characters: USB-001 */
    const uint16_t *wiring;     /* of 320 transducers: REQ-004 */
    uint8_t columns, rows;
    uint16_t pitch_um;
};

/* What a device does after its answers are sent. */
enum pw_leave { PW_STAY, PW_LEAVE_RESET, PW_LEAVE_REVERT, PW_LEAVE_DFU };

/* A SETUP packet (SER-007). */
struct pw_setup {
    uint8_t type;
    uint8_t request;
    uint16_t value;
    uint16_t index;
    uint16_t length;
};

/* How a request ends. LATER: ask pw_device_answer until it is something else. */
enum pw_answer { PW_ANSWERED, PW_STALLED, PW_LATER };

/* A change that was accepted, until it has taken effect. */
struct pw_change {
    uint64_t period;
    uint64_t ends;    /* of a sequence: the first period after its last repeat; otherwise PW_NEVER */
    uint8_t kind;     /* enum pw_kind */
    uint8_t action;   /* enum pw_action */
    uint8_t flags;    /* enum pw_flag */
    bool on_chain;    /* its first token has left: CHN-029 */
    bool committed;   /* so have its commits or programs */
    bool silent;      /* no event: silence by the device itself, or what was on the chain before it */
    uint8_t door;     /* that it came through: the others are told what it does (ACK-006) */
    uint16_t first, count, hold, repeats;
    uint8_t slices[PW_PROCESSORS][PW_SLICE]; /* of an UPDATE */
};

/* What an accepted sequence or modulation uses of the stores, until that has ended (BLK-022). */
struct pw_use {
    uint64_t until; /* the period from which it is used no longer */
    bool modulation;
    uint16_t first, count;
    uint8_t slots[PW_SLOTS / 8u]; /* of a sequence, as bits */
};

/* A store on its way to the processors. */
struct pw_store {
    uint8_t kind; /* enum pw_kind */
    uint16_t first, count;
    uint16_t sent; /* loads that have left */
    uint16_t loads;
    uint8_t data[PW_PAYLOAD]; /* of a SLOT: ten slices in the order of the chain */
};

#define PW_CHANGES (PW_QUEUE_CHANGES + 4u)
#define PW_USES (2u * PW_CHANGES)

struct pw_processor_state {
    bool there;
    uint8_t unanswered;   /* questions in a row */
    uint64_t asked_again; /* tick before which nothing is asked: CHN-030 */
    uint32_t commits;     /* that had been sent to it when it was asked */
    uint32_t absent;      /* of them, those that it neither carried out nor missed, by its report: CHN-016 */
    bool known;           /* whether a report has come */
    uint16_t lasting;     /* faults whose cause lasts, by its report */
    struct pw_report report; /* the last one; its faults stay until they are cleared */
};

struct pw_device {
    const struct pw_port *port;
    const struct pw_about *about;
    /* Time: ticks of the device, 0 at the beginning of period 0. */
    uint64_t origin;  /* tick of the port at that moment */
    uint64_t now;     /* the last tick that was worked on */
    uint64_t worked;  /* the last period that was worked on */
    uint64_t sync_period;
    uint32_t sync_pulses;
    /* Start of the chain (CHN-022). */
    bool serving;     /* numbering is over: the device answers */
    bool broken;      /* CHN-021 */
    uint8_t numbered;
    uint64_t number_since; /* tick of the port */
    /* State and settings. */
    enum pw_state state;
    uint16_t faults;
    uint16_t persisting; /* faults whose cause lasts */
    bool watchdog_fired;
    bool suspended;   /* the bus that had configured the device is */
    uint64_t last_sign; /* tick of the last sign of life */
    uint16_t watchdog_ms;
    uint16_t drive_limit;
    enum pw_leave leaving;
    uint64_t leave_at; /* tick; DFU-002 */
    /* Numbering and counts. */
    bool any_number;
    uint32_t last_number;
    uint32_t accepted, refused, late, lost, dropped_frames;
    uint8_t last_refusal;
    /* Changes in the order of their periods: a ring. */
    struct pw_change changes[PW_CHANGES];
    uint32_t first_change, change_count;
    uint64_t last_period; /* of the last accepted change, or of the last silence */
    bool last_program;    /* whether it has programs alone */
    bool rated;           /* an UPDATE named a period since ENABLE: BLK-023 */
    uint64_t rated_period;
    /* What plays. */
    bool plays, plays_sequence, modulates;
    uint64_t since_period;
    uint64_t sequence_ends;
    /* Stores. */
    uint8_t entries[PW_ENTRIES][4]; /* periods 0: never stored */
    uint32_t slot_power[PW_SLOTS];  /* UINT32_MAX: never stored */
    uint8_t sampled[PW_SAMPLES / 8u];
    struct pw_use uses[PW_USES];
    uint32_t use_count;
    struct pw_store stores[PW_QUEUE_STORES];
    uint32_t first_store, store_count;
    /* The chain. */
    bool modulation_sent; /* a modulation plays or waits there */
    bool stops_sent;      /* the last silence had programs that stop one */
    uint32_t tokens_over; /* of the last period with work, that leave in the next */
    uint32_t commits;     /* that each processor was sent */
    struct pw_processor_state processors[PW_PROCESSORS];
    uint64_t collect_at; /* tick */
    uint8_t collect_next;
    /* One PULSES request at a time. */
    bool reading;
    uint8_t reading_door, reading_attempt;
    uint8_t reading_next; /* the processor to ask next */
    uint16_t reading_length, reading_came; /* processors that have answered, as bits */
    uint64_t reading_period, reading_until; /* the period of the last answer; the tick at which an attempt ends */
    struct pw_playing read[PW_PROCESSORS];
    /* Status records of its own accord, newest only, for each door (ACK-006). */
    uint8_t listening, telling; /* doors, as bits */
    struct pw_status told[PW_DOORS];
};

/* The calls of a port ------------------------------------------------------------------------------- */

/* Power-up or RESET: the outputs are off, and the numbering of the chain begins. */
void pw_device_begin(struct pw_device *self, const struct pw_port *port, const struct pw_about *about);
/* Work on everything that is due. Call it in each period, or when pw_device_due says so: from the main loop, which the
   period's interrupt wakes, or from that interrupt if all other calls of this device come from it too. Nothing guards
   against two calls at once. */
void pw_device_poll(struct pw_device *self);
/* The tick of the port at which something is due; it changes with every call. */
uint64_t pw_device_due(const struct pw_device *self);
/* Whether the device may attach to USB and answer on its lines (TIM-002). */
bool pw_device_serving(const struct pw_device *self);
/* A message for the controller, without route header and END. */
void pw_device_chain(struct pw_device *self, uint8_t channel_end, const uint8_t *body, size_t size);
/* What the device wants to do now that its answers are sent: the port then restarts it. */
enum pw_leave pw_device_leaving(struct pw_device *self);

/* The calls of doors ------------------------------------------------------------------------------------------- */

/* Whether a block can be judged now; otherwise USB answers NAK (BLK-009), and a line lets it wait (SER-011). */
bool pw_device_has_room(const struct pw_device *self);
/* The tick of the device (not of the port) that it is. */
uint64_t pw_device_tick(struct pw_device *self);
/* Judge a block that had arrived at a tick, and carry it out. Only while there is room. Fills the acknowledgement. */
void pw_device_block(struct pw_device *self, uint8_t door, const uint8_t *bytes, size_t size, uint64_t arrived,
                     struct pw_ack *ack);
/* Carry out a request of chapter REQ. `answer` has room for PW_ANSWER bytes; at most setup->length of them are set. */
enum pw_answer pw_device_request(struct pw_device *self, uint8_t door, const struct pw_setup *setup, uint8_t *answer,
                                 uint16_t *answer_size);
/* The end of a request of this door that was answered LATER. */
enum pw_answer pw_device_answer(struct pw_device *self, uint8_t door, uint8_t *answer, uint16_t *answer_size);
/* `test` of the console (CON-008): the reason, or -1 if the queue has no room. */
int pw_device_test(struct pw_device *self, uint8_t door, uint16_t transducer);
/* An event of the bus: BUS_RESET, SUSPEND, RESUME (STA-002). BUS_RESET also lets any number come next (NUM-004). */
void pw_device_bus(struct pw_device *self, enum pw_event event);
/* DETACH (DFU-002): false if the state has no such transition. The device leaves later: pw_device_leaving. */
bool pw_device_detach(struct pw_device *self, uint8_t door);
/* Whether a door wants status records of the device's own accord: USB while configured, a line among frames. */
void pw_device_listen(struct pw_device *self, uint8_t door, bool listens);
/* The newest of them for a door, once; send it after the acknowledgements that wait (ACK-006). */
bool pw_device_tells(struct pw_device *self, uint8_t door, uint8_t record[PW_STATUS]);
/* A line dropped a frame (SER-006). */
void pw_device_dropped_frame(struct pw_device *self);
/* What STATUS says now. */
void pw_device_status(struct pw_device *self, struct pw_status *status);

#endif
