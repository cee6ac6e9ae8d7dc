# ruff: noqa: SIM109  # numba compiles a comparison with each of a few codes, not a search
# mypy: disable-error-code="no-any-return"
"""Instructions that allocate, free and set up resources, for the core's kernel."""

from __future__ import annotations

from typing import Any

from . import state as st
from .channels import clear, poke
from .compiled import part
from .ports import attach, restart, touch, update
from .resources import disable, fault, find, free_thread, own, signed, used

__all__ = ["allocate", "set_up"]

I_GETR, I_FREER, I_SETC, I_SETCI, I_SETD, I_SETRDY = st.codes("getr freer setc setci setd setrdy")
I_SETCLK, I_GETD, I_SETN, I_GETN, I_TESTLCL = st.codes("setclk getd setn getn testlcl")

CLK_REF = 1
_CLEARED = (
    st.BUFFERED, st.PORT_DATA, st.OUTPUT, st.INVERTED, st.FALLING, st.TRANSFER, st.FULL, st.SHIFT, st.VALID,
    st.PORT_TIME, st.TIMED, st.COUNTER, st.STAMP, st.HOLD, st.TURNING, st.AWAITED,
)  # fmt: skip
"""Fields of a port that are 0 when it is turned on."""


@part
def _begin_use(s: Any, e: int, t: int, environment: int) -> None:
    """Mark a resource as used, without events."""
    disable(s, e)
    r = st.RESOURCE + e * st.RESOURCE_ROW
    s[r + st.USED] = 1
    s[r + st.OWNER] = t
    s[r + st.INTERRUPT] = 0
    s[r + st.VECTOR] = 0
    s[r + st.ENVIRONMENT] = environment


@part
def allocate(s: Any, inbox: Any, kind: int, t: int, now: int) -> int:
    """GETR: the identifier of the first free resource of a kind, or 0."""
    first, count = -1, 0
    if kind == st.TYPE_TIMER:
        first, count = st.TIMER_0, st.TIMERS
    elif kind == st.TYPE_CHANNEL:
        first, count = st.CHANNEL_0, st.CHANNEL_ENDS
    elif kind == st.TYPE_SYNC:
        first, count = st.SYNC_0, st.SYNCHRONISERS
    elif kind == st.TYPE_THREAD:
        first, count = st.THREAD_0, st.THREADS
    elif kind == st.TYPE_LOCK:
        first, count = st.LOCK_0, st.LOCKS
    for number in range(count):
        e = first + number
        if s[st.RESOURCE + e * st.RESOURCE_ROW + st.USED] == 0:
            identifier = number << 8 | kind
            if kind == st.TYPE_CHANNEL:
                identifier |= s[st.NODE] << 16
            _begin_use(s, e, t, identifier)
            if kind == st.TYPE_TIMER:
                s[st.TIMER + number * st.TIMER_ROW + st.AFTER] = 0
                s[st.TIMER + number * st.TIMER_ROW + st.TIMER_DATA] = 0
            elif kind == st.TYPE_CHANNEL:
                clear(s, inbox, number, now)
            elif kind == st.TYPE_SYNC:
                s[st.MASTER + number] = t
            elif kind == st.TYPE_LOCK:
                s[st.LOCK + number * st.LOCK_ROW + st.HELD] = 0
                s[st.LOCK + number * st.LOCK_ROW + st.GRANTED] = -1
            elif kind == st.TYPE_THREAD:
                s[st.STATE + number] = st.STOPPED
                s[st.READY + number] = st.NEVER
                s[st.THREAD + number * st.THREAD_ROW + st.SYNC] = -1
                s[st.THREAD + number * st.THREAD_ROW + st.EVENTS] = 0
                s[st.USED_THREADS] += 1
            return identifier
    return 0


@part
def _free(s: Any, e: int) -> bool:
    """FREER: whether the resource could be freed."""
    if not used(s, e) or st.PORT_0 <= e < st.PORT_0 + st.PORTS or st.CLOCK_0 <= e < st.CLOCK_0 + st.CLOCKS:
        return False
    if e >= st.THREAD_0:
        if s[st.STATE + e - st.THREAD_0] != st.STOPPED:
            return False
        free_thread(s, e - st.THREAD_0)
        return True
    if st.CHANNEL_0 <= e < st.PORT_0:
        b = st.CHANNEL + (e - st.CHANNEL_0) * st.CHANNEL_ROW
        if s[b + st.TOKENS] != 0 or s[b + st.CLAIM] != st.NOWHERE or s[b + st.IN_PACKET] != 0:
            return False
    if e < st.EVENTABLE:
        disable(s, e)
    s[st.RESOURCE + e * st.RESOURCE_ROW + st.USED] = 0
    return True


@part
def _use_port(s: Any, regs: Any, pins: Any, log: Any, p: int, t: int, on: bool, now: int) -> None:
    """SETC of a port with INUSE_ON or INUSE_OFF."""
    update(s, regs, pins, log, p, now)
    b, e = st.PORT + p * st.PORT_ROW, st.PORT_0 + p
    width = s[b + st.WIDTH]
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
    for field in _CLEARED:
        s[b + field] = 0
    s[b + st.CONDITION] = st.ALWAYS
    s[b + st.TRANSFER_WIDTH] = width
    s[b + st.ENTRIES] = 1
    s[b + st.SHIFT_COUNT] = 1
    attach(s, regs, pins, log, p, now)
    s[st.RESOURCE + e * st.RESOURCE_ROW + st.USED] = 1 if on else 0


@part
def _configure(s: Any, regs: Any, pins: Any, log: Any, e: int, value: int, t: int, now: int) -> bool:
    """SETC: whether the resource has this setting."""
    is_port, is_clock = st.PORT_0 <= e < st.PORT_0 + st.PORTS, st.CLOCK_0 <= e < st.CLOCK_0 + st.CLOCKS
    p, c = e - st.PORT_0, e - st.CLOCK_0
    b, k = st.PORT + p * st.PORT_ROW, st.CLOCK + c * st.CLOCK_ROW
    if value == 0 or value == 8:  # INUSE
        if is_port:
            _use_port(s, regs, pins, log, p, t, value == 8, now)
        elif is_clock:
            touch(s, regs, pins, log, c, now)
            s[st.RESOURCE + e * st.RESOURCE_ROW + st.USED] = value >> 3
            s[k + st.RUNS] = 0
            s[k + st.FROM_PORT] = -1
            s[k + st.DIVIDE] = 0
            s[k + st.HALF] = 2
        return is_port or is_clock
    if not used(s, e):
        return False
    if is_port:
        update(s, regs, pins, log, p, now)
    if e < st.EVENTABLE:
        own(s, e, t)
    mode, setting = value & 7, value >> 3
    if mode == 1:  # COND
        if e < st.CHANNEL_0 and setting <= st.LATER:
            s[st.TIMER + e * st.TIMER_ROW + st.AFTER] = setting
            return True
        if is_port and setting <= 3 and setting != st.LATER:
            s[b + st.CONDITION] = setting
            return True
        return False
    if mode == 2:  # IE_MODE
        if e >= st.EVENTABLE or setting > 1:
            return False
        s[st.RESOURCE + e * st.RESOURCE_ROW + st.INTERRUPT] = setting
        return True
    if mode == 3:  # DRIVE
        return is_port and setting <= 2
    if mode != 7:
        return False
    kind, setting = value >> 12, setting & 0x1FF
    if kind == 0 and setting == 2 and is_port:  # CLRBUF
        s[b + st.FULL] = 0
        s[b + st.HOLD] = 0
        s[b + st.VALID] = 0
        return True
    if kind == 0 and setting < 2 and is_clock:  # STOPR, STARTR
        touch(s, regs, pins, log, c, now)
        s[k + st.RUNS] = setting
        s[k + st.STARTED] = now
        restart(s, regs, pins, log, c, now)
        for q in range(st.PORTS):
            if s[st.PORT + q * st.PORT_ROW + st.CLOCK_OF] == c:
                if setting == 1:
                    s[st.PORT + q * st.PORT_ROW + st.COUNTER] = 0
                poke(s, st.PORT_0 + q, now)
        return True
    if kind == 2 and setting < 2 and is_port:  # BUF
        if setting == 0 and s[b + st.TRANSFER_WIDTH] != s[b + st.WIDTH]:
            return False
        s[b + st.BUFFERED] = setting
        return True
    if kind == 4 and setting < 2 and is_port:  # SDELAY
        s[b + st.FALLING] = setting
        return True
    if kind == 6 and setting < 2 and is_port:  # INV
        if setting == 1 and s[b + st.WIDTH] != 1:
            return False
        s[b + st.INVERTED] = setting
        return True
    if kind == 7 and is_port:  # PIN_DELAY
        return setting <= 5
    if (kind == 8 or kind == 9) and is_clock:  # FALL_DELAY, RISE_DELAY
        return s[k + st.RUNS] == 0
    # MS, RDY and PORT: only without ready signals and other kinds of ports, which are not modelled
    return is_port and setting == 0 and (kind == 1 or kind == 3 or kind == 5)


@part
def _set_clock(s: Any, regs: Any, pins: Any, log: Any, e: int, source: int, t: int, now: int) -> bool:
    """SETCLK: whether the resource can have this clock."""
    if not used(s, e):
        return False
    if st.PORT_0 <= e < st.PORT_0 + st.PORTS:
        c = find(source) - st.CLOCK_0
        if not 0 <= c < st.CLOCKS:
            return False
        update(s, regs, pins, log, e - st.PORT_0, now)
        own(s, e, t)
        b = st.PORT + (e - st.PORT_0) * st.PORT_ROW
        s[b + st.CLOCK_OF] = c
        s[b + st.COUNTER] = 0
        attach(s, regs, pins, log, e - st.PORT_0, now)
        poke(s, e, now)
        return True
    c = e - st.CLOCK_0
    if not 0 <= c < st.CLOCKS:
        return False
    q = -1
    if source != CLK_REF:
        q = find(source) - st.PORT_0
        if not 0 <= q < st.PORTS or not used(s, st.PORT_0 + q) or s[st.PORT + q * st.PORT_ROW + st.WIDTH] != 1:
            return False
        if s[st.CLOCK + c * st.CLOCK_ROW + st.DIVIDE] != 0:
            return False
    touch(s, regs, pins, log, c, now)
    s[st.CLOCK + c * st.CLOCK_ROW + st.FROM_PORT] = q
    s[st.CLOCK + c * st.CLOCK_ROW + st.STARTED] = now
    restart(s, regs, pins, log, c, now)
    return True


@part
def _set_data(s: Any, regs: Any, pins: Any, log: Any, e: int, value: int, t: int, now: int) -> bool:
    """SETD: whether the resource has data that can be set so."""
    if not used(s, e):
        return False
    if e < st.CHANNEL_0:
        own(s, e, t)
        s[st.TIMER + e * st.TIMER_ROW + st.TIMER_DATA] = value
        return True
    if e < st.PORT_0:
        b = st.CHANNEL + (e - st.CHANNEL_0) * st.CHANNEL_ROW
        if s[b + st.IN_PACKET] != 0 or (value & 0xFF != st.TYPE_CHANNEL and value & 0xFF != st.TYPE_CONFIG):
            return False
        own(s, e, t)
        s[b + st.DESTINATION] = value
        return True
    if e < st.PORT_0 + st.PORTS:
        update(s, regs, pins, log, e - st.PORT_0, now)
        own(s, e, t)
        b = st.PORT + (e - st.PORT_0) * st.PORT_ROW
        s[b + st.PORT_DATA] = value & (1 << s[b + st.WIDTH]) - 1
        return True
    c = e - st.CLOCK_0
    b = st.CLOCK + c * st.CLOCK_ROW
    if not 0 <= c < st.CLOCKS or s[b + st.FROM_PORT] >= 0:
        return False
    touch(s, regs, pins, log, c, now)
    s[b + st.DIVIDE] = value & 0xFF
    s[b + st.HALF] = max(4 * (value & 0xFF), 2)
    s[b + st.STARTED] = now
    restart(s, regs, pins, log, c, now)
    return True


@part
def set_up(
    s: Any, regs: Any, inbox: Any, pins: Any, log: Any, t: int, now: int, op: int, a: int, b: int, imm: int,
) -> int:  # fmt: skip
    """Execute what allocates, frees or sets up a resource; `OTHER` if the instruction is none of these."""
    k = t * st.REGISTER_ROW
    va, vb = signed(regs[k + a]), signed(regs[k + b])
    # Any resource
    if op == I_GETR:
        regs[k + a] = allocate(s, inbox, imm, t, now)
        return st.DONE
    if op == I_FREER:
        return st.DONE if _free(s, find(va)) else fault(s, st.ILLEGAL_RESOURCE, va)
    if op == I_SETC or op == I_SETCI:
        value = imm if op == I_SETCI else vb
        e = find(va)
        return (
            st.DONE
            if e >= 0 and _configure(s, regs, pins, log, e, value, t, now)
            else fault(s, st.ILLEGAL_RESOURCE, va)
        )
    if op == I_SETD:
        return st.DONE if _set_data(s, regs, pins, log, find(vb), va, t, now) else fault(s, st.ILLEGAL_RESOURCE, vb)
    if op == I_SETRDY:  # ready signals are not modelled
        return fault(s, st.ILLEGAL_RESOURCE, vb)
    if op == I_SETCLK:
        return st.DONE if _set_clock(s, regs, pins, log, find(vb), va, t, now) else fault(s, st.ILLEGAL_RESOURCE, vb)
    if op == I_GETD:
        e = find(vb)
        if not used(s, e):
            return fault(s, st.ILLEGAL_RESOURCE, vb)
        if e < st.CHANNEL_0:
            regs[k + a] = s[st.TIMER + e * st.TIMER_ROW + st.TIMER_DATA]
        elif e < st.PORT_0:
            regs[k + a] = s[st.CHANNEL + (e - st.CHANNEL_0) * st.CHANNEL_ROW + st.DESTINATION]
        elif e < st.PORT_0 + st.PORTS:
            regs[k + a] = s[st.PORT + (e - st.PORT_0) * st.PORT_ROW + st.PORT_DATA]
        else:
            return fault(s, st.ILLEGAL_RESOURCE, vb)
        return st.DONE
    if op == I_SETN or op == I_GETN or op == I_TESTLCL:
        e = find(vb)
        if not st.CHANNEL_0 <= e < st.PORT_0 or not used(s, e):
            return fault(s, st.ILLEGAL_RESOURCE, vb)
        c = st.CHANNEL + (e - st.CHANNEL_0) * st.CHANNEL_ROW
        if op == I_SETN:
            s[c + st.NETWORK] = va & 3
        elif op == I_GETN:
            regs[k + a] = s[c + st.NETWORK]
        else:
            local = s[c + st.DESTINATION] & 0xFF == st.TYPE_CHANNEL and s[c + st.DESTINATION] >> 16 == s[st.NODE]
            regs[k + a] = 1 if local else 0
        return st.DONE
    return st.OTHER
