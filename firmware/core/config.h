/* Sizes and times of a device, fixed at compile time. Override one with -DPW_QUEUE_CHANGES=8, or by PW_CONFIG_FILE. */
#ifndef PW_CONFIG_H
#define PW_CONFIG_H

#ifdef PW_CONFIG_FILE
#include PW_CONFIG_FILE
#endif

/* What the specification fixes; a board with fewer says so by its faults (REQ-008), not by other sizes. */
#define PW_BOARDS 5u
#define PW_PROCESSORS 10u
#define PW_PORT_BITS 32u
#define PW_CHANNELS 320u
#define PW_TICKS 50u              /* of a period: TIM-001 */
#define PW_TICKS_PER_MS 2000u
#define PW_PERIODS_PER_MS 40u
#define PW_SLOTS 256u             /* CHN-028 */
#define PW_ENTRIES 1024u
#define PW_SAMPLES 4096u
#define PW_WIDTHS 26u             /* 0 to 25 ticks: PUL-001 */
#define PW_BLOCK 512u             /* bytes of a block: BLK-001 */
#define PW_PAYLOAD 480u
#define PW_SLICE 48u              /* bytes of the pulses of a processor: CHN-003 */
#define PW_ACK 32u                /* bytes of an acknowledgement: ACK-002 */
#define PW_STATUS 64u             /* bytes of a status record: REQ-003 */
#define PW_ANSWER 640u            /* bytes of the longest answer to a request: REQ-004 */
#define PW_MESSAGE 64u            /* tokens of the longest message of the chain without its END: CHN-016 */

/* What a firmware author chooses. */
#ifndef PW_QUEUE_CHANGES
#define PW_QUEUE_CHANGES 32u      /* changes that can be queued, at least 4: BLK-024; 512 bytes each */
#endif
#ifndef PW_QUEUE_RECORDS
#define PW_QUEUE_RECORDS 64u      /* records that wait for 81 IN, at least 16: ACK-001 */
#endif
#ifndef PW_QUEUE_STORES
#define PW_QUEUE_STORES 2u        /* stores that wait to go onto the chain: BLK-024 */
#endif
#ifndef PW_LINES
#define PW_LINES 2u               /* serial lines: line 0 is CDC-ACM, the others are UARTs */
#endif
#ifndef PW_SORT_TICKS
#define PW_SORT_TICKS 35u         /* to judge and sort an update, at most 50: BUD-003 */
#endif
#ifndef PW_TOKENS_PER_PERIOD
#define PW_TOKENS_PER_PERIOD 1250u /* of the first link: BUD-002; 500 on two wires */
#endif
#define PW_TWO_WIRES (PW_TOKENS_PER_PERIOD < 1250u) /* an update does not fit into one period */
#ifndef PW_PERIODS_PER_UPDATE
#define PW_PERIODS_PER_UPDATE (PW_TWO_WIRES ? 2u : 1u) /* BLK-023 */
#endif
#ifndef PW_WATCHDOG_MS
#define PW_WATCHDOG_MS 100u       /* SAF-003 */
#endif
#ifndef PW_DRIVE_LIMIT
#define PW_DRIVE_LIMIT 320u       /* SAF-006 */
#endif
#ifndef PW_FEATURES
#define PW_FEATURES 0x7Fu         /* VER-005 */
#endif

/* What the plan of the queue (blk_plan.c) cannot hold. */
#if PW_TOKENS_PER_PERIOD < 500u
#error "PW_TOKENS_PER_PERIOD must be at least 500: ten slices and ten commits take 680 tokens, and two periods at most"
#endif
#if PW_PERIODS_PER_UPDATE < (PW_TWO_WIRES ? 2u : 1u)
#error "PW_PERIODS_PER_UPDATE must be at least 1, and at least 2 if PW_TOKENS_PER_PERIOD is below 1250 (two wires)"
#endif
#if PW_SORT_TICKS > PW_TICKS
#error "PW_SORT_TICKS must be at most 50: a change for the fifth period after its arrival must be in time (BLK-005)"
#endif

#endif
