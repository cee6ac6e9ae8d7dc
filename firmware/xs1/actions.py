# ruff: noqa: SIM109  # numba compiles a comparison with each of a few codes, not a search
# mypy: disable-error-code="no-any-return"
"""Instructions that act on resources, threads and the kernel, for the core's kernel.

They are executed in order of time, one at a time, whichever way the other instructions go.
"""

from __future__ import annotations

from typing import Any

from .channels import absorb, clear, poke, room_after, send, take, token_at, word_after, word_is_there
from .compiled import part
from .ports import attach, drained_after, input_after, input_is_ready, output_after, restart, touch, update
from .resources import (
    disable,
    due_event,
    enable,
    find,
    free_thread,
    is_drained,
    own,
    pause,
    signed,
    slot,
    take_event,
    timer_after,
)
from .state import (
    AFTER,
    ALWAYS,
    AWAITED,
    BUFFERED,
    CHANNEL,
    CHANNEL_0,
    CHANNEL_ENDS,
    CHANNEL_ROW,
    CLAIM,
    CLOCK,
    CLOCK_0,
    CLOCK_OF,
    CLOCK_ROW,
    CLOCKS,
    CONDITION,
    CONTROL,
    COUNTER,
    DESTINATION,
    DIVIDE,
    DONE,
    DRIVEN,
    ECALL,
    ED,
    EEBLE,
    ENABLED,
    ENTRIES,
    ENVIRONMENT,
    ET,
    EVENTABLE,
    EVENTS,
    FALLING,
    FAULT,
    FAULT_DATA,
    FOR_CLAIM,
    FOR_DRAIN,
    FOR_EVENT,
    FOR_INPUT,
    FOR_JOIN,
    FOR_LINK,
    FOR_LOCK,
    FOR_OUTPUT,
    FOR_THREADS,
    FOR_TIME,
    FOR_TOKEN,
    FOR_WORD,
    FREE,
    FROM_PORT,
    FULL,
    GONE,
    GRANTED,
    HALF,
    HALVES,
    HELD,
    HOLD,
    ILLEGAL_INSTRUCTION,
    ILLEGAL_PC,
    ILLEGAL_PS,
    ILLEGAL_RESOURCE,
    IN_PACKET,
    INENB,
    INTERRUPT,
    INVERTED,
    JUMP,
    KCALL,
    KEP,
    KSP,
    LATER,
    LINK_ERROR,
    LOAD_STORE,
    LOCK,
    LOCK_0,
    LOCK_ROW,
    LOCKS,
    MASTER,
    MESSAGE_OF,
    NEED,
    NETWORK,
    NEVER,
    NEXT,
    NODE,
    NOWHERE,
    ON,
    ORDER,
    OUTPUT,
    OWNER,
    PAUSE,
    PAUSED,
    PC,
    PINS,
    PORT,
    PORT_0,
    PORT_DATA,
    PORT_ROW,
    PORT_TIME,
    PORTS,
    PROCESSOR_REGISTERS,
    RAM,
    READY,
    REGISTER_ROW,
    RESOURCE,
    RESOURCE_ROW,
    RUNNING,
    RUNS,
    SED,
    SENT,
    SHIFT,
    SHIFT_COUNT,
    SOURCE,
    SP,
    SPC,
    SR,
    SSR,
    STAMP,
    STARTED,
    STATE,
    STOPPED,
    SYNC,
    SYNC_0,
    SYNCHRONISERS,
    THREAD,
    THREAD_0,
    THREAD_ROW,
    THREADS,
    TIMED,
    TIMER,
    TIMER_0,
    TIMER_DATA,
    TIMER_ROW,
    TIMERS,
    TO,
    TOKENS,
    TRANSFER,
    TRANSFER_WIDTH,
    TRAP,
    TURNING,
    TYPE_CHANNEL,
    TYPE_CONFIG,
    TYPE_LOCK,
    TYPE_PS,
    TYPE_SYNC,
    TYPE_THREAD,
    TYPE_TIMER,
    USED,
    USED_THREADS,
    VALID,
    VECTOR,
    WAITING,
    WHY,
    WIDTH,
    codes,
)

__all__ = ["act"]

I_TSETR, I_TINITPC, I_GETST, I_TINITDP, I_OUTT, I_TINITSP = codes("tsetr tinitpc getst tinitdp outt tinitsp")
I_SETD, I_TINITCP, I_TSETMR, I_EET, I_EEF, I_GETTS, I_SETPT = codes("setd tinitcp tsetmr eet eef getts setpt")
I_OUTCT, I_OUTCTI, I_GETR, I_INCT, I_INT, I_ENDIN, I_OUT = codes("outct outcti getr inct int endin out")
I_OUTSHR, I_IN, I_INSHR, I_PEEK, I_TESTCT, I_SETPSC = codes("outshr in inshr peek testct setpsc")
I_TESTWCT, I_CHKCT, I_CHKCTI, I_EDU, I_EEU, I_WAITET = codes("testwct chkct chkcti edu eeu waitet")
I_WAITEF, I_FREER, I_MJOIN, I_TSTART, I_MSYNC, I_SETEV = codes("waitef freer mjoin tstart msync setev")
I_KCALL, I_SETV, I_ECALLF, I_ECALLT, I_CLRPT, I_SYNCR = codes("kcall setv ecallf ecallt clrpt syncr")
I_WAITEU, I_CLRE, I_SSYNC, I_FREET, I_KRET, I_SETKEP = codes("waiteu clre ssync freet kret setkep")
I_LDSPC, I_STSPC, I_LDSSR, I_STSSR, I_STSED, I_STET = codes("ldspc stspc ldssr stssr stsed stet")
I_GETED, I_GETET, I_GETID, I_GETKEP, I_GETKSP, I_LDSED = codes("geted getet getid getkep getksp ldsed")
I_LDET, I_SETCI, I_KCALLI, I_CLRSR, I_SETSR, I_KENTSP = codes("ldet setci kcalli clrsr setsr kentsp")
I_KRESTSP, I_OUTPW, I_INPW, I_SETCLK, I_TINITLR, I_GETPS = codes("krestsp outpw inpw setclk tinitlr getps")
I_SETPS, I_SETRDY, I_GETD, I_TESTLCL, I_SETTW, I_SETC = codes("setps setrdy getd testlcl settw setc")
I_SETN, I_GETN = codes("setn getn")

CLK_REF = 1


@part
def _fault(s: Any, kind: int, data: int) -> int:
    s[FAULT] = kind
    s[FAULT_DATA] = data
    return TRAP


@part
def _used(s: Any, e: int) -> bool:
    return e >= 0 and s[RESOURCE + e * RESOURCE_ROW + USED] != 0


@part
def _port(s: Any, regs: Any, pins: Any, log: Any, identifier: int, t: int, now: int) -> int:
    """The number of a port in use, which is brought up to now for a thread that becomes its owner; else -1."""
    e = find(identifier)
    if not PORT_0 <= e < PORT_0 + PORTS or not _used(s, e):
        return -1
    update(s, regs, pins, log, e - PORT_0, now)
    own(s, e, t)
    return e - PORT_0


@part
def _begin_use(s: Any, e: int, t: int, environment: int) -> None:
    """Mark a resource as used, without events."""
    disable(s, e)
    r = RESOURCE + e * RESOURCE_ROW
    s[r + USED] = 1
    s[r + OWNER] = t
    s[r + INTERRUPT] = 0
    s[r + VECTOR] = 0
    s[r + ENVIRONMENT] = environment


@part
def _allocate(s: Any, inbox: Any, kind: int, t: int, now: int) -> int:
    """GETR: the identifier of the first free resource of a kind, or 0."""
    first, count = -1, 0
    if kind == TYPE_TIMER:
        first, count = TIMER_0, TIMERS
    elif kind == TYPE_CHANNEL:
        first, count = CHANNEL_0, CHANNEL_ENDS
    elif kind == TYPE_SYNC:
        first, count = SYNC_0, SYNCHRONISERS
    elif kind == TYPE_THREAD:
        first, count = THREAD_0, THREADS
    elif kind == TYPE_LOCK:
        first, count = LOCK_0, LOCKS
    for number in range(count):
        e = first + number
        if s[RESOURCE + e * RESOURCE_ROW + USED] == 0:
            identifier = number << 8 | kind
            if kind == TYPE_CHANNEL:
                identifier |= s[NODE] << 16
            _begin_use(s, e, t, identifier)
            if kind == TYPE_TIMER:
                s[TIMER + number * TIMER_ROW + AFTER] = 0
                s[TIMER + number * TIMER_ROW + TIMER_DATA] = 0
            elif kind == TYPE_CHANNEL:
                clear(s, inbox, number, now)
            elif kind == TYPE_SYNC:
                s[MASTER + number] = t
            elif kind == TYPE_LOCK:
                s[LOCK + number * LOCK_ROW + HELD] = 0
                s[LOCK + number * LOCK_ROW + GRANTED] = -1
            elif kind == TYPE_THREAD:
                s[STATE + number] = STOPPED
                s[READY + number] = NEVER
                s[THREAD + number * THREAD_ROW + SYNC] = -1
                s[THREAD + number * THREAD_ROW + EVENTS] = 0
                s[USED_THREADS] += 1
            return identifier
    return 0


@part
def _free(s: Any, e: int) -> bool:
    """FREER: whether the resource could be freed."""
    if not _used(s, e) or PORT_0 <= e < PORT_0 + PORTS or CLOCK_0 <= e < CLOCK_0 + CLOCKS:
        return False
    if e >= THREAD_0:
        if s[STATE + e - THREAD_0] != STOPPED:
            return False
        free_thread(s, e - THREAD_0)
        return True
    if CHANNEL_0 <= e < PORT_0:
        b = CHANNEL + (e - CHANNEL_0) * CHANNEL_ROW
        if s[b + TOKENS] != 0 or s[b + CLAIM] != NOWHERE or s[b + IN_PACKET] != 0:
            return False
    if e < EVENTABLE:
        disable(s, e)
    s[RESOURCE + e * RESOURCE_ROW + USED] = 0
    return True


@part
def _start(s: Any, t: int, now: int) -> None:
    """Let a stopped or paused thread run from now on."""
    s[READY + t] = slot(s, t, now)
    s[STATE + t] = RUNNING


@part
def _all_stopped(s: Any, sync: int) -> bool:
    """Whether all threads of a synchroniser, but its master, wait in SSYNC."""
    for u in range(THREADS):
        if s[STATE + u] != FREE and s[THREAD + u * THREAD_ROW + SYNC] == sync and s[STATE + u] != STOPPED:
            return False
    return True


@part
def _release(s: Any, sync: int, ends: bool, now: int) -> None:
    """Let all threads of a synchroniser go on, or end them."""
    for u in range(THREADS):
        if s[STATE + u] == STOPPED and s[THREAD + u * THREAD_ROW + SYNC] == sync:
            if ends:
                free_thread(s, u)
            else:
                _start(s, u, now)


@part
def _synchronise(s: Any, t: int, now: int) -> None:
    """SSYNC: stop, until the master and the other threads have come."""
    s[STATE + t] = STOPPED
    s[READY + t] = NEVER
    sync = s[THREAD + t * THREAD_ROW + SYNC]
    if sync < 0 or not _all_stopped(s, sync):
        return
    master = s[MASTER + sync]
    b = THREAD + master * THREAD_ROW
    waits = s[STATE + master] == PAUSED and s[b + ON] == SYNC_0 + sync
    if waits and (s[b + WHY] == FOR_THREADS or s[b + WHY] == FOR_JOIN):
        _release(s, sync, s[b + WHY] == FOR_JOIN, now)
        s[b + PC] += 1  # MSYNC and MJOIN have one half word
        _start(s, master, now)


@part
def _transmit(s: Any, outbox: Any, inbox: Any, t: int, c: int, value: int, count: int, now: int) -> int:
    """OUT, OUTT and OUTCT of a channel end."""
    own(s, CHANNEL_0 + c, t)
    result = send(s, outbox, inbox, c, value, count, now)
    if result == -3:
        return DONE
    if result == -2:
        s[MESSAGE_OF] = c
        return SENT
    if result == -1:
        return _fault(s, LINK_ERROR, s[NODE] << 16 | c << 8 | TYPE_CHANNEL)
    b, to = THREAD + t * THREAD_ROW, s[CHANNEL + c * CHANNEL_ROW + TO]
    s[b + SOURCE] = c
    s[b + NEED] = count
    if result == FOR_LINK:
        pause(s, t, result, CHANNEL_0 + c, room_after(s, c, count))
    else:
        pause(s, t, result, CHANNEL_0 + to, NEVER)
        if result == FOR_CLAIM:
            s[READY + t] = now + 1
    return PAUSE


@part
def _output(s: Any, pins: Any, p: int, t: int, value: int, entries: int, now: int) -> int:
    """OUT, OUTSHR and OUTPW of a port."""
    b = PORT + p * PORT_ROW
    if s[b + OUTPUT] != 0:
        if s[b + FULL] != 0:
            pause(s, t, FOR_OUTPUT, PORT_0 + p, output_after(s, pins, b, now))
            return PAUSE
    else:
        s[b + VALID] = 1
        s[b + TURNING] = 0
        s[b + HOLD] = 0
    s[b + TRANSFER] = value & (1 << s[b + TRANSFER_WIDTH]) - 1
    s[b + FULL] = 1
    s[b + OUTPUT] = 1
    if entries > 0:
        s[b + SHIFT_COUNT] = entries
    return DONE


@part
def _input(s: Any, pins: Any, p: int, t: int, entries: int, now: int) -> int:
    """IN, INSHR and INPW of a port, whose data is then in FAULT_DATA."""
    b = PORT + p * PORT_ROW
    if s[b + OUTPUT] == 0 and input_is_ready(s, b):
        s[FAULT_DATA] = s[b + TRANSFER]
        if s[b + VALID] == s[b + SHIFT_COUNT]:  # ENDIN left samples, which are all there
            s[b + SHIFT_COUNT] = s[b + ENTRIES]
            s[b + TRANSFER] = s[b + SHIFT]
            s[b + VALID] = 0
            s[b + STAMP] = s[b + COUNTER]
        else:
            s[b + FULL] = 0
        s[b + HOLD] = 0
        s[b + AWAITED] = 0
        s[b + TIMED] = 0
        return DONE
    if s[b + OUTPUT] != 0:
        s[b + TURNING] = 1
    elif entries > 0:
        s[b + SHIFT_COUNT] = entries
    s[b + AWAITED] = 1
    pause(s, t, FOR_INPUT, PORT_0 + p, input_after(s, pins, p, now))
    return PAUSE


@part
def _entries(s: Any, b: int, bits: int) -> int:
    """How many times its width a buffered port transfers for some bits; 0 if it cannot."""
    width = s[b + WIDTH]
    if s[b + BUFFERED] == 0 or bits < width or bits > s[b + TRANSFER_WIDTH] or bits % width != 0:
        return 0
    return bits // width


@part
def _use_port(s: Any, regs: Any, pins: Any, log: Any, p: int, t: int, on: bool, now: int) -> None:
    """SETC of a port with INUSE_ON or INUSE_OFF."""
    update(s, regs, pins, log, p, now)
    b, e = PORT + p * PORT_ROW, PORT_0 + p
    width = s[b + WIDTH]
    number = p
    if p >= 30:
        number = p - 30
    elif p >= 26:
        number = p - 26
    elif p >= 22:
        number = p - 22
    elif p >= 16:
        number = p - 16
    _begin_use(s, e, t, width << 16 | number << 8)
    for field in (
        BUFFERED, PORT_DATA, OUTPUT, INVERTED, FALLING, TRANSFER, FULL, SHIFT, VALID, PORT_TIME, TIMED, COUNTER, STAMP,
        HOLD, TURNING, AWAITED,
    ):  # fmt: skip
        s[b + field] = 0
    s[b + CONDITION] = ALWAYS
    s[b + TRANSFER_WIDTH] = width
    s[b + ENTRIES] = 1
    s[b + SHIFT_COUNT] = 1
    attach(s, regs, pins, log, p, now)
    s[RESOURCE + e * RESOURCE_ROW + USED] = 1 if on else 0


@part
def _configure(s: Any, regs: Any, pins: Any, log: Any, e: int, value: int, t: int, now: int) -> bool:
    """SETC: whether the resource has this setting."""
    is_port, is_clock = PORT_0 <= e < PORT_0 + PORTS, CLOCK_0 <= e < CLOCK_0 + CLOCKS
    p, c = e - PORT_0, e - CLOCK_0
    b, k = PORT + p * PORT_ROW, CLOCK + c * CLOCK_ROW
    if value == 0 or value == 8:  # INUSE
        if is_port:
            _use_port(s, regs, pins, log, p, t, value == 8, now)
        elif is_clock:
            touch(s, regs, pins, log, c, now)
            s[RESOURCE + e * RESOURCE_ROW + USED] = value >> 3
            s[k + RUNS] = 0
            s[k + FROM_PORT] = -1
            s[k + DIVIDE] = 0
            s[k + HALF] = 2
        return is_port or is_clock
    if not _used(s, e):
        return False
    if is_port:
        update(s, regs, pins, log, p, now)
    if e < EVENTABLE:
        own(s, e, t)
    mode, setting = value & 7, value >> 3
    if mode == 1:  # COND
        if e < CHANNEL_0 and setting <= LATER:
            s[TIMER + e * TIMER_ROW + AFTER] = setting
            return True
        if is_port and setting <= 3 and setting != LATER:
            s[b + CONDITION] = setting
            return True
        return False
    if mode == 2:  # IE_MODE
        if e >= EVENTABLE or setting > 1:
            return False
        s[RESOURCE + e * RESOURCE_ROW + INTERRUPT] = setting
        return True
    if mode == 3:  # DRIVE
        return is_port and setting <= 2
    if mode != 7:
        return False
    kind, setting = value >> 12, setting & 0x1FF
    if kind == 0 and setting == 2 and is_port:  # CLRBUF
        s[b + FULL] = 0
        s[b + HOLD] = 0
        s[b + VALID] = 0
        return True
    if kind == 0 and setting < 2 and is_clock:  # STOPR, STARTR
        touch(s, regs, pins, log, c, now)
        s[k + RUNS] = setting
        s[k + STARTED] = now
        restart(s, regs, pins, log, c, now)
        for q in range(PORTS):
            if s[PORT + q * PORT_ROW + CLOCK_OF] == c:
                if setting == 1:
                    s[PORT + q * PORT_ROW + COUNTER] = 0
                poke(s, PORT_0 + q, now)
        return True
    if kind == 2 and setting < 2 and is_port:  # BUF
        if setting == 0 and s[b + TRANSFER_WIDTH] != s[b + WIDTH]:
            return False
        s[b + BUFFERED] = setting
        return True
    if kind == 4 and setting < 2 and is_port:  # SDELAY
        s[b + FALLING] = setting
        return True
    if kind == 6 and setting < 2 and is_port:  # INV
        if setting == 1 and s[b + WIDTH] != 1:
            return False
        s[b + INVERTED] = setting
        return True
    if kind == 7 and is_port:  # PIN_DELAY
        return setting <= 5
    if (kind == 8 or kind == 9) and is_clock:  # FALL_DELAY, RISE_DELAY
        return s[k + RUNS] == 0
    # MS, RDY and PORT: only without ready signals and other kinds of ports, which are not modelled
    return is_port and setting == 0 and (kind == 1 or kind == 3 or kind == 5)


@part
def _set_clock(s: Any, regs: Any, pins: Any, log: Any, e: int, source: int, t: int, now: int) -> bool:
    """SETCLK: whether the resource can have this clock."""
    if not _used(s, e):
        return False
    if PORT_0 <= e < PORT_0 + PORTS:
        c = find(source) - CLOCK_0
        if not 0 <= c < CLOCKS:
            return False
        update(s, regs, pins, log, e - PORT_0, now)
        own(s, e, t)
        b = PORT + (e - PORT_0) * PORT_ROW
        s[b + CLOCK_OF] = c
        s[b + COUNTER] = 0
        attach(s, regs, pins, log, e - PORT_0, now)
        poke(s, e, now)
        return True
    c = e - CLOCK_0
    if not 0 <= c < CLOCKS:
        return False
    q = -1
    if source != CLK_REF:
        q = find(source) - PORT_0
        if not 0 <= q < PORTS or not _used(s, PORT_0 + q) or s[PORT + q * PORT_ROW + WIDTH] != 1:
            return False
        if s[CLOCK + c * CLOCK_ROW + DIVIDE] != 0:
            return False
    touch(s, regs, pins, log, c, now)
    s[CLOCK + c * CLOCK_ROW + FROM_PORT] = q
    s[CLOCK + c * CLOCK_ROW + STARTED] = now
    restart(s, regs, pins, log, c, now)
    return True


@part
def _set_data(s: Any, regs: Any, pins: Any, log: Any, e: int, value: int, t: int, now: int) -> bool:
    """SETD: whether the resource has data that can be set so."""
    if not _used(s, e):
        return False
    if e < CHANNEL_0:
        own(s, e, t)
        s[TIMER + e * TIMER_ROW + TIMER_DATA] = value
        return True
    if e < PORT_0:
        b = CHANNEL + (e - CHANNEL_0) * CHANNEL_ROW
        if s[b + IN_PACKET] != 0 or (value & 0xFF != TYPE_CHANNEL and value & 0xFF != TYPE_CONFIG):
            return False
        own(s, e, t)
        s[b + DESTINATION] = value
        return True
    if e < PORT_0 + PORTS:
        update(s, regs, pins, log, e - PORT_0, now)
        own(s, e, t)
        b = PORT + (e - PORT_0) * PORT_ROW
        s[b + PORT_DATA] = value & (1 << s[b + WIDTH]) - 1
        return True
    c = e - CLOCK_0
    b = CLOCK + c * CLOCK_ROW
    if not 0 <= c < CLOCKS or s[b + FROM_PORT] >= 0:
        return False
    touch(s, regs, pins, log, c, now)
    s[b + DIVIDE] = value & 0xFF
    s[b + HALF] = max(4 * (value & 0xFF), 2)
    s[b + STARTED] = now
    restart(s, regs, pins, log, c, now)
    return True


@part
def _processor_state(identifier: int) -> int:
    """The place of a register of the processor state, or -1."""
    number = identifier >> 8
    if identifier & 0xFF != TYPE_PS or number >= PROCESSOR_REGISTERS:
        return -1
    if number <= 0xD or 0x10 <= number <= 0x18 or 0x20 <= number <= 0x27 or number >= 0x30:
        return number
    return -1


@part
def _is_address(address: int) -> bool:
    return address & 0xFFFF0003 == RAM


@part
def act(
    s: Any, regs: Any, memory: Any, processor: Any, inbox: Any, outbox: Any, pins: Any, log: Any, t: int, now: int,
    op: int, a: int, b: int, imm: int, half: int,
) -> int:  # fmt: skip
    """Execute an instruction that acts on a resource, a thread or the kernel.

    Parameters
    ----------
    s, regs, inbox, outbox, pins, log : arrays
        As `core` describes them.
    memory : (16384,) uint32
    processor : (PROCESSOR_REGISTERS,) int64
        Registers of the processor state.
    t, now : int
        Thread and cycle.
    op, a, b, imm : int
        Code and operands.
    half : int
        The half word after the instruction.

    Returns
    -------
    int
        DONE; PAUSE, to try again later; TRAP, for the reason in the state; JUMP, to a place in the state; SENT, if a
        message is complete; GONE, if the thread does not run any more.
    """
    k, row = t * REGISTER_ROW, THREAD + t * THREAD_ROW
    va, vb = signed(regs[k + a]), signed(regs[k + b])
    # Ports, and what else IN and OUT do
    if op == I_OUT:
        e = find(vb)
        if not _used(s, e):
            return _fault(s, ILLEGAL_RESOURCE, vb)
        if PORT_0 <= e < PORT_0 + PORTS:
            update(s, regs, pins, log, e - PORT_0, now)
            own(s, e, t)
            return _output(s, pins, e - PORT_0, t, va, 0, now)
        if CHANNEL_0 <= e < PORT_0:
            return _transmit(s, outbox, inbox, t, e - CHANNEL_0, va, 4, now)
        if LOCK_0 <= e < LOCK_0 + LOCKS:
            chosen = -1
            for u in range(THREADS):
                w = THREAD + u * THREAD_ROW
                waits = s[STATE + u] == PAUSED and s[w + WHY] == FOR_LOCK and s[w + ON] == e
                if waits and (chosen < 0 or s[w + ORDER] < s[THREAD + chosen * THREAD_ROW + ORDER]):
                    chosen = u
            lock = LOCK + (e - LOCK_0) * LOCK_ROW
            if chosen < 0:
                s[lock + HELD] = 0
            else:
                s[lock + GRANTED] = chosen
                s[READY + chosen] = min(s[READY + chosen], now)
            return DONE
        return _fault(s, ILLEGAL_RESOURCE, vb)
    if op == I_IN:
        e = find(vb)
        if not _used(s, e):
            return _fault(s, ILLEGAL_RESOURCE, vb)
        if e < CHANNEL_0:
            own(s, e, t)
            again = timer_after(s, e, now)
            if again > now:
                pause(s, t, FOR_TIME, e, again)
                return PAUSE
            regs[k + a] = now >> 2
            return DONE
        if e < PORT_0:
            d = e - CHANNEL_0
            own(s, e, t)
            absorb(s, inbox, d, now)
            place = word_is_there(s, d)
            if place < 0:
                pause(s, t, FOR_WORD, e, word_after(s, inbox, d, now))
                return PAUSE
            if place > 0:
                return _fault(s, ILLEGAL_RESOURCE, vb)
            value = 0
            for place in range(4):
                value = value << 8 | token_at(s, d, place)
            regs[k + a] = value
            take(s, inbox, d, 4, now)
            return DONE
        if e < PORT_0 + PORTS:
            update(s, regs, pins, log, e - PORT_0, now)
            own(s, e, t)
            result = _input(s, pins, e - PORT_0, t, 0, now)
            if result == DONE:
                regs[k + a] = s[FAULT_DATA]
            return result
        if e < LOCK_0 + LOCKS:
            lock = LOCK + (e - LOCK_0) * LOCK_ROW
            if s[lock + GRANTED] == t:
                s[lock + GRANTED] = -1
            elif s[lock + HELD] == 0:
                s[lock + HELD] = 1
            else:
                pause(s, t, FOR_LOCK, e, NEVER)
                return PAUSE
            regs[k + a] = vb
            return DONE
        return _fault(s, ILLEGAL_RESOURCE, vb)
    # Tokens
    if op == I_OUTT or op == I_OUTCT or op == I_OUTCTI:
        identifier = vb if op == I_OUTT else va
        e = find(identifier)
        if not CHANNEL_0 <= e < PORT_0 or not _used(s, e):
            return _fault(s, ILLEGAL_RESOURCE, identifier)
        token = va & 0xFF
        if op == I_OUTCT:
            token = CONTROL | vb & 0xFF
        elif op == I_OUTCTI:
            token = CONTROL | imm
        return _transmit(s, outbox, inbox, t, e - CHANNEL_0, token, 1, now)
    if op == I_INT or op == I_INCT or op == I_TESTCT or op == I_CHKCT or op == I_CHKCTI:
        identifier = va if op == I_CHKCT or op == I_CHKCTI else vb
        e = find(identifier)
        if not CHANNEL_0 <= e < PORT_0 or not _used(s, e):
            return _fault(s, ILLEGAL_RESOURCE, identifier)
        d = e - CHANNEL_0
        own(s, e, t)
        absorb(s, inbox, d, now)
        if s[CHANNEL + d * CHANNEL_ROW + TOKENS] == 0:
            pause(s, t, FOR_TOKEN, e, now + 1)
            return PAUSE
        token = token_at(s, d, 0)
        if op == I_TESTCT:
            regs[k + a] = 1 if token >= CONTROL else 0
            return DONE
        if op == I_INT or op == I_INCT:
            if (token >= CONTROL) != (op == I_INCT):
                return _fault(s, ILLEGAL_RESOURCE, identifier)
            regs[k + a] = token & 0xFF
        elif token != CONTROL | (imm if op == I_CHKCTI else vb):
            return _fault(s, ILLEGAL_RESOURCE, identifier)
        take(s, inbox, d, 1, now)
        return DONE
    if op == I_TESTWCT:
        e = find(vb)
        if not CHANNEL_0 <= e < PORT_0 or not _used(s, e):
            return _fault(s, ILLEGAL_RESOURCE, vb)
        own(s, e, t)
        absorb(s, inbox, e - CHANNEL_0, now)
        place = word_is_there(s, e - CHANNEL_0)
        if place < 0:
            pause(s, t, FOR_WORD, e, word_after(s, inbox, e - CHANNEL_0, now))
            return PAUSE
        regs[k + a] = place
        return DONE
    # Events
    if op == I_WAITEU or op == I_WAITET or op == I_WAITEF:
        if (op == I_WAITET and va == 0) or (op == I_WAITEF and va != 0):
            return DONE
        regs[k + SR] |= EEBLE
        e, again = due_event(s, regs, inbox, pins, log, t, now)
        if e >= 0:
            s[row + PC] = half - 1
            take_event(s, regs, t, e)
            return JUMP
        pause(s, t, FOR_EVENT, -1, again)
        return PAUSE
    if op == I_EEU or op == I_EDU or op == I_EET or op == I_EEF or op == I_SETV or op == I_SETEV:
        identifier = vb if op == I_EET or op == I_EEF else va
        e = find(identifier)
        if not 0 <= e < EVENTABLE or not _used(s, e):
            return _fault(s, ILLEGAL_RESOURCE, identifier)
        if e >= PORT_0:
            update(s, regs, pins, log, e - PORT_0, now)
        own(s, e, t)
        r = RESOURCE + e * RESOURCE_ROW
        if op == I_SETV:
            s[r + VECTOR] = signed(regs[k + 11]) >> 1 & 0x7FFF
        elif op == I_SETEV:
            s[r + ENVIRONMENT] = signed(regs[k + 11]) & 0xFFFF | RAM
        elif op == I_EEU or (op == I_EET and va != 0) or (op == I_EEF and va == 0):
            enable(s, e)
        else:
            disable(s, e)
        return DONE
    if op == I_CLRE:
        regs[k + SR] = signed(regs[k + SR]) & ~(EEBLE | INENB)
        for e in range(EVENTABLE):
            r = RESOURCE + e * RESOURCE_ROW
            if s[r + ENABLED] != 0 and s[r + OWNER] == t and s[r + INTERRUPT] == 0:
                disable(s, e)
        return DONE
    if op == I_SETSR:
        regs[k + SR] |= imm & 0xFF
        return DONE
    if op == I_CLRSR:
        regs[k + SR] = signed(regs[k + SR]) & ~imm
        return DONE
    # Any resource
    if op == I_GETR:
        regs[k + a] = _allocate(s, inbox, imm, t, now)
        return DONE
    if op == I_FREER:
        return DONE if _free(s, find(va)) else _fault(s, ILLEGAL_RESOURCE, va)
    if op == I_SETC or op == I_SETCI:
        value = imm if op == I_SETCI else vb
        e = find(va)
        return DONE if e >= 0 and _configure(s, regs, pins, log, e, value, t, now) else _fault(s, ILLEGAL_RESOURCE, va)
    if op == I_SETD:
        return DONE if _set_data(s, regs, pins, log, find(vb), va, t, now) else _fault(s, ILLEGAL_RESOURCE, vb)
    if op == I_SETRDY:  # ready signals are not modelled
        return _fault(s, ILLEGAL_RESOURCE, vb)
    if op == I_SETCLK:
        return DONE if _set_clock(s, regs, pins, log, find(vb), va, t, now) else _fault(s, ILLEGAL_RESOURCE, vb)
    if op == I_GETD:
        e = find(vb)
        if not _used(s, e):
            return _fault(s, ILLEGAL_RESOURCE, vb)
        if e < CHANNEL_0:
            regs[k + a] = s[TIMER + e * TIMER_ROW + TIMER_DATA]
        elif e < PORT_0:
            regs[k + a] = s[CHANNEL + (e - CHANNEL_0) * CHANNEL_ROW + DESTINATION]
        elif e < PORT_0 + PORTS:
            regs[k + a] = s[PORT + (e - PORT_0) * PORT_ROW + PORT_DATA]
        else:
            return _fault(s, ILLEGAL_RESOURCE, vb)
        return DONE
    if op == I_SETN or op == I_GETN or op == I_TESTLCL:
        e = find(vb)
        if not CHANNEL_0 <= e < PORT_0 or not _used(s, e):
            return _fault(s, ILLEGAL_RESOURCE, vb)
        c = CHANNEL + (e - CHANNEL_0) * CHANNEL_ROW
        if op == I_SETN:
            s[c + NETWORK] = va & 3
        elif op == I_GETN:
            regs[k + a] = s[c + NETWORK]
        else:
            local = s[c + DESTINATION] & 0xFF == TYPE_CHANNEL and s[c + DESTINATION] >> 16 == s[NODE]
            regs[k + a] = 1 if local else 0
        return DONE
    # Ports only
    if (
        op == I_OUTSHR or op == I_INSHR or op == I_OUTPW or op == I_INPW or op == I_PEEK or op == I_GETTS
        or op == I_SETPT or op == I_SETPSC or op == I_ENDIN or op == I_SETTW
    ):  # fmt: skip
        p = _port(s, regs, pins, log, vb, t, now)
        if p < 0:
            return _fault(s, ILLEGAL_RESOURCE, vb)
        q = PORT + p * PORT_ROW
        whole = s[q + TRANSFER_WIDTH]
        if op == I_OUTSHR:
            result = _output(s, pins, p, t, va, 0, now)
            if result == DONE:
                regs[k + a] = va >> whole
            return result
        if op == I_INSHR:
            result = _input(s, pins, p, t, 0, now)
            if result == DONE:
                regs[k + a] = va >> whole | s[FAULT_DATA] << (32 - whole)
            return result
        if op == I_OUTPW or op == I_INPW or op == I_SETPSC:
            entries = _entries(s, q, va if op == I_SETPSC else imm)
            if entries == 0:
                return _fault(s, ILLEGAL_RESOURCE, vb)
            if op == I_OUTPW:
                return _output(s, pins, p, t, va, entries, now)
            if op == I_INPW:
                result = _input(s, pins, p, t, entries, now)
                if result == DONE:
                    regs[k + a] = s[FAULT_DATA]
                return result
        if op == I_SETPT or op == I_SETPSC:
            if s[q + OUTPUT] != 0 and s[q + FULL] != 0:
                pause(s, t, FOR_OUTPUT, PORT_0 + p, output_after(s, pins, q, now))
                return PAUSE
            if op == I_SETPSC:
                s[q + SHIFT_COUNT] = va // s[q + WIDTH]
            else:
                s[q + PORT_TIME] = va & 0xFFFF
                s[q + TIMED] = 1
                s[q + HOLD] = 0
            return DONE
        if op == I_PEEK:
            value = s[q + DRIVEN]
            if s[q + OUTPUT] == 0:
                value = signed(s[q + PINS])
            regs[k + a] = value ^ s[q + INVERTED]
        elif op == I_GETTS:
            regs[k + a] = s[q + STAMP]
        elif op == I_SETTW:
            width = s[q + WIDTH]
            if va < width or (va != width and va != 8 and va != 32) or va % width != 0:
                return _fault(s, ILLEGAL_RESOURCE, vb)
            s[q + TRANSFER_WIDTH] = va
            s[q + ENTRIES] = va // width
            s[q + SHIFT_COUNT] = va // width
        else:
            if s[q + OUTPUT] != 0 or s[q + BUFFERED] == 0:
                return _fault(s, ILLEGAL_RESOURCE, vb)
            entries = s[q + VALID]
            if s[q + FULL] != 0:
                if entries != 0:
                    s[q + SHIFT_COUNT] = entries
                entries += s[q + ENTRIES]
            else:
                s[q + VALID] = 0
                s[q + SHIFT_COUNT] = s[q + ENTRIES]
                s[q + STAMP] = s[q + COUNTER]
                s[q + TRANSFER] = s[q + SHIFT]
                s[q + FULL] = 1
            regs[k + a] = entries * s[q + WIDTH]
        return DONE
    if op == I_CLRPT or op == I_SYNCR:
        p = _port(s, regs, pins, log, va, t, now)
        if p < 0:
            return _fault(s, ILLEGAL_RESOURCE, va)
        q = PORT + p * PORT_ROW
        if op == I_CLRPT:
            s[q + TIMED] = 0
            s[q + HOLD] = 0
        elif not is_drained(s, q):
            pause(s, t, FOR_DRAIN, PORT_0 + p, drained_after(s, pins, q, now))
            return PAUSE
        return DONE
    # Threads
    if op == I_GETST:
        e = find(vb)
        if not SYNC_0 <= e < SYNC_0 + SYNCHRONISERS or not _used(s, e):
            return _fault(s, ILLEGAL_RESOURCE, vb)
        identifier = _allocate(s, inbox, TYPE_THREAD, t, now)
        if identifier != 0:
            s[THREAD + (identifier >> 8) * THREAD_ROW + SYNC] = e - SYNC_0
        regs[k + a] = identifier
        return DONE
    if (
        op == I_TINITPC or op == I_TINITSP or op == I_TINITDP or op == I_TINITCP or op == I_TINITLR or op == I_TSTART
        or op == I_TSETR
    ):  # fmt: skip
        identifier = va if op == I_TSTART else vb
        if op == I_TSETR:
            identifier = signed(regs[k + imm])
        u = find(identifier) - THREAD_0
        if u < 0 or not _used(s, THREAD_0 + u):
            return _fault(s, ILLEGAL_RESOURCE, identifier)
        if op == I_TSETR:
            regs[u * REGISTER_ROW + a] = vb
            return DONE
        if s[STATE + u] != STOPPED or (op == I_TSTART and s[THREAD + u * THREAD_ROW + SYNC] >= 0):
            return _fault(s, ILLEGAL_RESOURCE, identifier)
        if op == I_TSTART:
            _start(s, u, now)
        elif op == I_TINITPC:
            start = (va - RAM) >> 1
            s[THREAD + u * THREAD_ROW + PC] = start if va & 1 == 0 and 0 <= start < HALVES else HALVES
            s[THREAD + u * THREAD_ROW + NEXT] = -1
        else:
            register = SP
            if op == I_TINITDP:
                register = SP - 1
            elif op == I_TINITCP:
                register = SP - 2
            elif op == I_TINITLR:
                register = SP + 1
            regs[u * REGISTER_ROW + register] = va
        return DONE
    if op == I_TSETMR:
        sync = s[row + SYNC]
        regs[(t if sync < 0 else s[MASTER + sync]) * REGISTER_ROW + a] = vb
        return DONE
    if op == I_MSYNC or op == I_MJOIN:
        e = find(va)
        if not SYNC_0 <= e < SYNC_0 + SYNCHRONISERS or not _used(s, e):
            return _fault(s, ILLEGAL_RESOURCE, va)
        s[MASTER + e - SYNC_0] = t
        if _all_stopped(s, e - SYNC_0):
            _release(s, e - SYNC_0, op == I_MJOIN, now)
            return DONE
        pause(s, t, FOR_JOIN if op == I_MJOIN else FOR_THREADS, e, NEVER)
        return PAUSE
    if op == I_SSYNC:
        s[row + PC] = half
        _synchronise(s, t, now)
        return GONE
    if op == I_FREET:
        free_thread(s, t)
        return GONE
    if op == I_GETID:
        regs[k + 11] = t
        return DONE
    # The kernel
    if op == I_ECALLT or op == I_ECALLF:
        return _fault(s, ECALL, 0) if (va != 0) == (op == I_ECALLT) else DONE
    if op == I_KCALL or op == I_KCALLI:
        return _fault(s, KCALL, va if op == I_KCALL else imm)
    if op == I_KRET:
        start = signed(regs[k + SPC])
        regs[k + SR] = signed(regs[k + SSR]) & ~WAITING
        regs[k + ED] = regs[k + SED]
        if start & 1 or not RAM <= start < RAM + 2 * HALVES:
            return _fault(s, ILLEGAL_PC, start)
        s[row + PC] = (start - RAM) >> 1
        s[row + NEXT] = -1
        return JUMP
    if op == I_SETKEP:
        regs[k + KEP] = signed(regs[k + 11]) & ~0x7F
        return DONE
    if op == I_GETED or op == I_GETET or op == I_GETKEP or op == I_GETKSP:
        source = ED
        if op == I_GETET:
            source = ET
        elif op == I_GETKEP:
            source = KEP
        elif op == I_GETKSP:
            source = KSP
        regs[k + 11] = regs[k + source]
        return DONE
    if (
        op == I_LDSPC or op == I_LDSSR or op == I_LDSED or op == I_LDET or op == I_STSPC or op == I_STSSR
        or op == I_STSED or op == I_STET
    ):  # fmt: skip
        register, words = SPC, 1
        if op == I_LDSSR or op == I_STSSR:
            register, words = SSR, 2
        elif op == I_LDSED or op == I_STSED:
            register, words = SED, 3
        elif op == I_LDET or op == I_STET:
            register, words = ET, 4
        address = (signed(regs[k + SP]) + 4 * words) & 0xFFFFFFFF
        if not _is_address(address):
            return _fault(s, LOAD_STORE, address)
        place = (address - RAM) >> 2
        if op == I_LDSPC or op == I_LDSSR or op == I_LDSED or op == I_LDET:
            regs[k + register] = memory[place]
        else:
            memory[place] = regs[k + register]
        return DONE
    if op == I_KENTSP:
        address = signed(regs[k + KSP])
        if not _is_address(address):
            return _fault(s, LOAD_STORE, address)
        memory[(address - RAM) >> 2] = regs[k + SP]
        regs[k + SP] = address - imm
        return DONE
    if op == I_KRESTSP:
        address = (signed(regs[k + SP]) + imm) & 0xFFFFFFFF
        if not _is_address(address):
            return _fault(s, LOAD_STORE, address)
        regs[k + SP] = memory[(address - RAM) >> 2]
        regs[k + KSP] = address
        return DONE
    if op == I_GETPS or op == I_SETPS:
        place = _processor_state(vb)
        if place < 0 or (op == I_SETPS and place == 0):
            return _fault(s, ILLEGAL_PS, vb)
        if op == I_GETPS:
            regs[k + a] = processor[place]
        else:
            processor[place] = va
        return DONE
    return _fault(s, ILLEGAL_INSTRUCTION, 0)
