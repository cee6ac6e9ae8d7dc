"""Where the state of a core lies in its arrays, which kernels and `core` share.

Nearly all of it is one array of int64, so that a kernel has few arguments: rows of threads, resources, timers, channel
ends, ports, clock blocks, locks and synchronisers follow each other, each row with the fields named here. Registers
are uint32, a row of `REGISTER_ROW` for each thread. Times are core cycles.

A resource has one index, whatever its kind: 10 timers, 32 channel ends, 32 ports (one for each identifier), 4 locks,
7 synchronisers, 6 clock blocks and 8 threads, in this order. The first three kinds can have events.
"""

from __future__ import annotations

from .instructions import BY_NAME


def codes(names: str) -> list[int]:
    """Codes of some instructions, for the names that a kernel gives them."""
    return [BY_NAME[name] for name in names.split()]


NEVER = 1 << 62
"""A time that does not come."""

RAM, HALVES = 0x10000, 0x8000
"""The first address of memory, and how many half words it has."""

THREADS, TIMERS, CHANNEL_ENDS, PORTS, LOCKS, SYNCHRONISERS, CLOCKS = 8, 10, 32, 32, 4, 7, 6

PROCESSOR_REGISTERS = 0xA0
"""Of the processor state; those that a debugger uses do nothing."""

# Indices of resources
TIMER_0 = 0
CHANNEL_0 = TIMER_0 + TIMERS
PORT_0 = CHANNEL_0 + CHANNEL_ENDS
LOCK_0 = PORT_0 + PORTS
SYNC_0 = LOCK_0 + LOCKS
CLOCK_0 = SYNC_0 + SYNCHRONISERS
THREAD_0 = CLOCK_0 + CLOCKS
RESOURCES = THREAD_0 + THREADS
EVENTABLE = LOCK_0
"""Number of resources that can have events: those with a smaller index."""

PORT_WIDTHS = (*16 * [1], *6 * [4], *4 * [8], *4 * [16], *2 * [32])

# Types in identifiers of resources
(
    TYPE_PORT, TYPE_TIMER, TYPE_CHANNEL, TYPE_SYNC, TYPE_THREAD, TYPE_LOCK, TYPE_CLOCK,
) = range(7)  # fmt: skip
TYPE_PS, TYPE_CONFIG = 0x0B, 0x0C

# Registers of a thread, after r0 to r11
CP, DP, SP, LR, SR, SSR, SPC, SED, ET, ED, KEP, KSP = range(12, 24)
REGISTER_ROW = 32

# Bits of SR
EEBLE, IEBLE, INENB, ININT, INK, WAITING = 1, 2, 4, 8, 16, 64

# Types of exceptions
(
    _, LINK_ERROR, ILLEGAL_PC, ILLEGAL_INSTRUCTION, ILLEGAL_RESOURCE, LOAD_STORE, ILLEGAL_PS, ARITHMETIC, ECALL,
) = range(9)  # fmt: skip
KCALL = 15

# The array of int64: first what the scheduler reads for each thread
READY = 0
"""When a running thread issues next, or when a paused one looks again whether it may go on."""
STATE = READY + THREADS
FREE, RUNNING, PAUSED, STOPPED, TRAPPED = range(5)
"""A stopped thread waits in SSYNC, or to be started."""

# Then single values
COMMON = STATE + THREADS
(
    CYCLE, ISSUE, LOCKSTEP, USED_THREADS, LAST, NODE, SEQUENCE, PESSIMISTIC, PROFILED, AHEAD, LINK_CYCLES, HELD_UP,
    LOGGED, COUNT, FAULT, FAULT_DATA, FAULT_THREAD, FAULT_PC, FAULT_CYCLE, MESSAGE_OF, UNDECODED_AT,
) = range(COMMON, COMMON + 21)  # fmt: skip

# Then rows
THREAD = COMMON + 32
PC, WHY, ON, NEED, SOURCE, SYNC, ORDER, FETCHED, NEXT, EVENTS, ISSUED = range(11)
"""Of a thread: half word of its next instruction; why and on which resource it pauses, for how many tokens, from which
channel end; its synchroniser or -1; its place in queues; what it has fetched; how many resources have their events
enabled for it."""
THREAD_ROW = 16

LIST = THREAD + THREADS * THREAD_ROW
"""Of each thread the resources whose events are enabled for it, in ascending order."""
LIST_ROW = EVENTABLE

RESOURCE = LIST + THREADS * LIST_ROW
USED, OWNER, ENABLED, INTERRUPT, VECTOR, ENVIRONMENT = range(6)
RESOURCE_ROW = 8

TIMER = RESOURCE + RESOURCES * RESOURCE_ROW
AFTER, TIMER_DATA = range(2)
TIMER_ROW = 2

CHANNEL = TIMER + TIMERS * TIMER_ROW
(
    DESTINATION, IN_PACKET, TO, CLAIM, FIRST, TOKENS, INBOX_FIRST, INBOX_SEEN, INBOX_END, OUTBOX_END, BEGAN, LEFT,
    NETWORK,
) = range(13)  # fmt: skip
BUFFER = 16
"""Of a channel end: to which resource it sends; whether it is amid a packet, and to where; who is amid a packet to it;
its buffer of `BUFFER_SIZE` tokens; places in the inbox and the outbox."""
CHANNEL_ROW = 24
BUFFER_SIZE = 8
NOWHERE, ELSEWHERE, THROWN_AWAY = -1, -2, -3
"""Where packets go, if to no channel end here."""
OUTSIDE = 32
"""Claims a channel end for a packet from outside."""
CONTROL = 256

PORT = CHANNEL + CHANNEL_ENDS * CHANNEL_ROW
(
    WIDTH, CLOCK_OF, BUFFERED, TRANSFER_WIDTH, CONDITION, PORT_DATA, OUTPUT, INVERTED, FALLING, TRANSFER, FULL, SHIFT,
    ENTRIES, SHIFT_COUNT, VALID, PORT_TIME, TIMED, COUNTER, STAMP, HOLD, EDGE, LEVEL, PINS, PINS_FIRST, PINS_END,
    TURNING, WATCHED, DRIVEN, AWAITED,
) = range(29)  # fmt: skip
"""Of a port: as the architecture names them; `EDGE` is the last edge of its clock that has taken effect."""
PORT_ROW = 32
ALWAYS, LATER, EQUAL, UNEQUAL = range(4)
"""Conditions."""

CLOCK = PORT + PORTS * PORT_ROW
RUNS, FROM_PORT, DIVIDE, HALF, STARTED = range(5)
CLOCK_ROW = 8

LOCK = CLOCK + CLOCKS * CLOCK_ROW
HELD, GRANTED = range(2)
LOCK_ROW = 2

MASTER = LOCK + LOCKS * LOCK_ROW
"""Of each synchroniser."""

SIZE = MASTER + SYNCHRONISERS

# Why a thread pauses
(
    FOR_EVENT, FOR_TIME, FOR_TOKEN, FOR_WORD, FOR_CLAIM, FOR_ROOM, FOR_LINK, FOR_LOCK, FOR_OUTPUT, FOR_INPUT, FOR_DRAIN,
    FOR_THREADS, FOR_JOIN,
) = range(13)  # fmt: skip

# What an instruction did
(DONE, PAUSE, TRAP, JUMP, SENT, GONE, OTHER) = range(7)

# Why the kernel returns
REACHED, MESSAGE, UNHANDLED, LOG_FULL, UNDECODED = range(5)

# Codes of decoded half words that are no instruction
NOT_DECODED, OUTSIDE_RAM = 254, 253
LONG = 1 << 28
"""In a decoded instruction: two half words."""

DIVISION = 32
"""A division issues this many times as slowly as other instructions."""

LOG_MARGIN = 4096
"""Changes that one step may add to the log: 32 ports with a full shift register and a full buffer make 2048."""
