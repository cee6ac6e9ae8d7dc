/* A chain processor's program: what its parts share. Names of clauses are those of the specification.

   Four threads share the memory:

   port     port.s: puts a word on the pins each tick; takes the next table when a period ends
   receive  receive.s: takes messages, judges length and CRC-32, and puts them into two rings
   play     play.c, raster.s: slices, commits, programs, periods, faults of its own, silence; it never waits for a link
   handle   handle.c: loads, questions and answers, the number, the switch; it may wait for a link

   A variable that threads share is written by one of them only, and is a word; a lock guards `told`, which is more.
   (`heard` is written by two: either value is of the same moment.) */
#ifndef PW_PROCESSOR_H
#define PW_PROCESSOR_H

#include <stdbool.h>
#include <stdint.h>

/* PUL, CHN-003, CHN-012 */
#define TICKS 50u
#define WIDTHS 26u
#define PHASES 100u
#define CODES 4096u
#define SAMPLE_VALUES 256u
#define SLICE_WORDS 12u
#define SLOTS 256u
#define ENTRIES 1024u
#define SAMPLES 4096u

/* CHN-009 and what the receiving thread makes of it: the kind of a message. receive.s repeats the numbers. */
enum { SLICE = 1, COMMIT, LOAD, PROGRAM, COLLECT, NUMBER, REPORT, PLAYING, IDENTITY };
enum { MEMORY_SLOTS = 1, MEMORY_ENTRIES, MEMORY_SAMPLES };
#define CONTROLLER_NODE 0xFFu
#define UNNUMBERED_NODE 0xFFFFu
#define PROCESSORS 10u

/* SAF-008 */
enum { FAULT_CHAIN = 1, FAULT_SYNC = 4, FAULT_TEMPERATURE = 8, FAULT_SUPPLY = 16, FAULT_OVERRUN = 32 };
#define TOO_HOT_C 85

/* Times of timers: 10 ns, modulo 2^32. */
#define PERIOD_TIME 2500u
#define MS_TIME 100000u
#define DEAF_TIME (50u * MS_TIME) /* CHN-018 */
#define SYNC_PERIODS 4096u        /* CHN-026 */
#define TICK_TIME 50

/* Times before a boundary; the tests of the firmware measure how long everything takes.

   DECIDE_TIME: when the next period is decided without a modulation.
   DECIDE_MODULATED_TIME: the same with one.
   BEGIN_MODULATED_TIME: until when the program of the first modulation is taken. The period is then decided at once.
   HAND_OVER_TIME: until when a table may be handed over. The port's thread takes it a little later (TAKE_TIME of
   port.s). The difference is a margin, for what lies between the look at the time and the change of the pointer. */
#define DECIDE_TIME 1074u
#define DECIDE_MODULATED_TIME 1334u
#define BEGIN_MODULATED_TIME 1220u
#define HAND_OVER_TIME 70u

/* A message as the receiving thread leaves it. Numbers are as in the message, but for these:
   PROGRAM, COLLECT, NUMBER: body[0] is their first byte, and what follows begins in body[1].
   SLICE: crc is that of its words, to be continued by those of the commit. */
struct message {
    uint32_t body[14];
    uint32_t kind;
    struct message *next; /* in the ring */
};
#define MESSAGE_CRC 12u /* its place in the body of a slice */
#define PLAY_MESSAGES 8u
#define HANDLE_MESSAGES 13u

/* Resources. start.s gets them. */
extern uint32_t play_timer, play_clock, play_inbox, play_ready;
extern uint32_t handle_timer, handle_clock, handle_inbox, handle_ready;
extern uint32_t receive_play, receive_play_ready, receive_handle, receive_handle_ready;
extern uint32_t config_end, answer_end, started_from, started_to;
extern uint32_t sync_port, supply_port, temperature_port, state_lock;

/* Shared memory. */
extern uint32_t unique_id[2];
extern uint32_t number;            /* UNNUMBERED_NODE before it has one; by handle */
extern uint32_t load_crc;          /* CRC after the route header of a load; these three by handle, for receive */
extern uint32_t program_crc;       /* after that of a program and a first byte of 0 */
extern uint32_t collect_crc;       /* likewise of a question */
extern uint32_t damaged_received;  /* by receive */
extern uint32_t heard;             /* the time of the last question, by receive; by play when it begins anew */
extern struct message play_ring[PLAY_MESSAGES], handle_ring[HANDLE_MESSAGES];
extern uint32_t slots[SLOTS][SLICE_WORDS];
extern uint32_t entries[ENTRIES]; /* slot, and periods << 16 */
extern uint8_t samples[SAMPLES];
extern uint32_t no_edges[TICKS];   /* edges while a table is made; 0 between */
extern uint32_t tables[3][TICKS];
extern uint32_t silent_table[TICKS];
extern const uint32_t *next_table; /* by play: from the next boundary on */
extern uint32_t first_time, first_stamp; /* by port: of the first pulse on the sync line */
extern uint8_t pulse_begins[CODES], pulse_ends[CODES]; /* tick, for each packed pulse; 0 and 0 for what is none */
extern uint8_t widths[SAMPLE_VALUES * WIDTHS + 6u];    /* under each sample; a code reaches 6 past the last row */
extern const uint8_t firmware_version[4];

/* What a report tells. By play, with the lock; `before` counts until the time `at`, `after` from then on. */
struct plays {
    uint64_t since;
    const uint32_t *slice;
    uint32_t carried_out;
};
struct told {
    struct plays before, after;
    uint32_t at;
    uint32_t missed;
    uint32_t damaged;  /* those that play found */
    uint32_t events;   /* how much more often CHAIN was raised than messages were damaged or missed */
    uint32_t overruns;
    uint32_t faults;   /* that last */
    int32_t drift;
    uint32_t temperature;
    uint32_t settled;  /* before is as after */
};
extern struct told told;
extern uint32_t time_runs; /* by play: the first pulse came; a flag, as the next */
extern uint32_t unsynced;  /* by handle: a question came before it */

/* Parts in assembly. */

/* events.s repeats their numbers. */
enum { EVENT_TIME, EVENT_MESSAGE, EVENT_STARTED, EVENT_SYNC, EVENT_TEMPERATURE, EVENT_SUPPLY };
void play_events(void);              /* sets the events of the playing thread up */
uint32_t play_wait(uint32_t time);   /* waits until a time, or for something to do */
void handle_events(void);
uint32_t handle_wait(uint32_t time); /* EVENT_TIME or EVENT_MESSAGE */

/* Edges of the pulses of a slice, and from them the first 2 words of a table; returns the levels after these. The row
   of widths is that of a sample, or null to leave pulses as they are. (PUL-004 to PUL-006) */
uint32_t raster_begin(const uint32_t *slice, const uint8_t *row, uint32_t *edges, uint32_t *table);
/* The other 48 words; edges are 0 afterwards. */
void raster_end(uint32_t *edges, uint32_t *table, uint32_t levels);
void slice_copy(uint32_t *to, const uint32_t *from);

/* Parts in C. */

void memories_begin(void); /* tables and rings, before the threads start */
void play(void);   /* threads; they do not return */
void handle(void);
void play_begin(void);
void play_message(const struct message *message);
uint32_t play_wake(void);
void play_time(void);
void play_started(void);
void play_sync(void);
void play_temperature(uint32_t value);
void play_supply(uint32_t value);
void handle_begin(void);
void handle_message(const struct message *message);
void handle_identity(void); /* sends the identity that waits, as soon as it is known whether this is the last */

#endif
