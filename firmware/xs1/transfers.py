# ruff: noqa: SIM109  # numba compiles a comparison with each of a few codes, not a search
# mypy: disable-error-code="no-any-return"
"""Instructions that move data through ports, channel ends and timers, or take locks, for the core's kernel."""

from __future__ import annotations

from typing import Any

from . import state as st
from .channels import absorb, room_after, send, take, token_at, word_after, word_is_there
from .compiled import part
from .ports import drained_after, input_after, input_is_ready, output_after, update
from .resources import fault, find, is_drained, own, pause, signed, timer_after, used

__all__ = ["transfer"]

I_OUT, I_IN, I_OUTT, I_OUTCT, I_OUTCTI, I_INT = st.codes("out in outt outct outcti int")
I_INCT, I_TESTCT, I_CHKCT, I_CHKCTI, I_TESTWCT, I_OUTSHR = st.codes("inct testct chkct chkcti testwct outshr")
I_INSHR, I_OUTPW, I_INPW, I_PEEK, I_GETTS, I_SETPT = st.codes("inshr outpw inpw peek getts setpt")
I_SETPSC, I_ENDIN, I_SETTW, I_CLRPT, I_SYNCR = st.codes("setpsc endin settw clrpt syncr")


@part
def _port(s: Any, regs: Any, pins: Any, log: Any, identifier: int, t: int, now: int) -> int:
    """The number of a port in use, which is brought up to now for a thread that becomes its owner; else -1."""
    e = find(identifier)
    if not st.PORT_0 <= e < st.PORT_0 + st.PORTS or not used(s, e):
        return -1
    update(s, regs, pins, log, e - st.PORT_0, now)
    own(s, e, t)
    return e - st.PORT_0


@part
def _transmit(s: Any, outbox: Any, inbox: Any, t: int, c: int, value: int, count: int, now: int) -> int:
    """OUT, OUTT and OUTCT of a channel end."""
    own(s, st.CHANNEL_0 + c, t)
    result = send(s, outbox, inbox, c, value, count, now)
    if result == -3:
        return st.DONE
    if result == -2:
        s[st.MESSAGE_OF] = c
        return st.SENT
    if result == -1:
        return fault(s, st.LINK_ERROR, s[st.NODE] << 16 | c << 8 | st.TYPE_CHANNEL)
    b, to = st.THREAD + t * st.THREAD_ROW, s[st.CHANNEL + c * st.CHANNEL_ROW + st.TO]
    s[b + st.SOURCE] = c
    s[b + st.NEED] = count
    if result == st.FOR_LINK:
        pause(s, t, result, st.CHANNEL_0 + c, room_after(s, c, count))
    else:
        pause(s, t, result, st.CHANNEL_0 + to, st.NEVER)
        if result == st.FOR_CLAIM:
            s[st.READY + t] = now + 1
    return st.PAUSE


@part
def _output(s: Any, pins: Any, p: int, t: int, value: int, entries: int, now: int) -> int:
    """OUT, OUTSHR and OUTPW of a port."""
    b = st.PORT + p * st.PORT_ROW
    if s[b + st.OUTPUT] != 0:
        if s[b + st.FULL] != 0:
            pause(s, t, st.FOR_OUTPUT, st.PORT_0 + p, output_after(s, pins, b, now))
            return st.PAUSE
    else:
        s[b + st.VALID] = 1
        s[b + st.TURNING] = 0
        s[b + st.HOLD] = 0
    s[b + st.TRANSFER] = value & (1 << s[b + st.TRANSFER_WIDTH]) - 1
    s[b + st.FULL] = 1
    s[b + st.OUTPUT] = 1
    if entries > 0:
        s[b + st.SHIFT_COUNT] = entries
    return st.DONE


@part
def _input(s: Any, pins: Any, p: int, t: int, entries: int, now: int) -> int:
    """IN, INSHR and INPW of a port, whose data is then in FAULT_DATA."""
    b = st.PORT + p * st.PORT_ROW
    if s[b + st.OUTPUT] == 0 and input_is_ready(s, b):
        s[st.FAULT_DATA] = s[b + st.TRANSFER]
        if s[b + st.VALID] == s[b + st.SHIFT_COUNT]:  # ENDIN left samples, which are all there
            s[b + st.SHIFT_COUNT] = s[b + st.ENTRIES]
            s[b + st.TRANSFER] = s[b + st.SHIFT]
            s[b + st.VALID] = 0
            s[b + st.STAMP] = s[b + st.COUNTER]
        else:
            s[b + st.FULL] = 0
        s[b + st.HOLD] = 0
        s[b + st.AWAITED] = 0
        s[b + st.TIMED] = 0
        return st.DONE
    if s[b + st.OUTPUT] != 0:
        s[b + st.TURNING] = 1
    elif entries > 0:
        s[b + st.SHIFT_COUNT] = entries
    s[b + st.AWAITED] = 1
    pause(s, t, st.FOR_INPUT, st.PORT_0 + p, input_after(s, pins, p, now))
    return st.PAUSE


@part
def _entries(s: Any, b: int, bits: int) -> int:
    """How many times its width a buffered port transfers for some bits; 0 if it cannot."""
    width = s[b + st.WIDTH]
    if s[b + st.BUFFERED] == 0 or bits < width or bits > s[b + st.TRANSFER_WIDTH] or bits % width != 0:
        return 0
    return bits // width


@part
def transfer(
    s: Any, regs: Any, inbox: Any, outbox: Any, pins: Any, log: Any, t: int, now: int,
    op: int, a: int, b: int, imm: int,
) -> int:  # fmt: skip
    """Execute what inputs, outputs or looks at data; `OTHER` if the instruction is none of these."""
    k = t * st.REGISTER_ROW
    va, vb = signed(regs[k + a]), signed(regs[k + b])
    # Ports, and what else IN and OUT do
    if op == I_OUT:
        e = find(vb)
        if not used(s, e):
            return fault(s, st.ILLEGAL_RESOURCE, vb)
        if st.PORT_0 <= e < st.PORT_0 + st.PORTS:
            update(s, regs, pins, log, e - st.PORT_0, now)
            own(s, e, t)
            return _output(s, pins, e - st.PORT_0, t, va, 0, now)
        if st.CHANNEL_0 <= e < st.PORT_0:
            return _transmit(s, outbox, inbox, t, e - st.CHANNEL_0, va, 4, now)
        if st.LOCK_0 <= e < st.LOCK_0 + st.LOCKS:
            chosen = -1
            for u in range(st.THREADS):
                w = st.THREAD + u * st.THREAD_ROW
                waits = s[st.STATE + u] == st.PAUSED and s[w + st.WHY] == st.FOR_LOCK and s[w + st.ON] == e
                if waits and (chosen < 0 or s[w + st.ORDER] < s[st.THREAD + chosen * st.THREAD_ROW + st.ORDER]):
                    chosen = u
            lock = st.LOCK + (e - st.LOCK_0) * st.LOCK_ROW
            if chosen < 0:
                s[lock + st.HELD] = 0
            else:
                s[lock + st.GRANTED] = chosen
                s[st.READY + chosen] = min(s[st.READY + chosen], now)
            return st.DONE
        return fault(s, st.ILLEGAL_RESOURCE, vb)
    if op == I_IN:
        e = find(vb)
        if not used(s, e):
            return fault(s, st.ILLEGAL_RESOURCE, vb)
        if e < st.CHANNEL_0:
            own(s, e, t)
            again = timer_after(s, e, now)
            if again > now:
                pause(s, t, st.FOR_TIME, e, again)
                return st.PAUSE
            regs[k + a] = now >> 2
            return st.DONE
        if e < st.PORT_0:
            d = e - st.CHANNEL_0
            own(s, e, t)
            absorb(s, inbox, d, now)
            place = word_is_there(s, d)
            if place < 0:
                pause(s, t, st.FOR_WORD, e, word_after(s, inbox, d, now))
                return st.PAUSE
            if place > 0:
                return fault(s, st.ILLEGAL_RESOURCE, vb)
            value = 0
            for place in range(4):
                value = value << 8 | token_at(s, d, place)
            regs[k + a] = value
            take(s, inbox, d, 4, now)
            return st.DONE
        if e < st.PORT_0 + st.PORTS:
            update(s, regs, pins, log, e - st.PORT_0, now)
            own(s, e, t)
            result = _input(s, pins, e - st.PORT_0, t, 0, now)
            if result == st.DONE:
                regs[k + a] = s[st.FAULT_DATA]
            return result
        if e < st.LOCK_0 + st.LOCKS:
            lock = st.LOCK + (e - st.LOCK_0) * st.LOCK_ROW
            if s[lock + st.GRANTED] == t:
                s[lock + st.GRANTED] = -1
            elif s[lock + st.HELD] == 0:
                s[lock + st.HELD] = 1
            else:
                pause(s, t, st.FOR_LOCK, e, st.NEVER)
                return st.PAUSE
            regs[k + a] = vb
            return st.DONE
        return fault(s, st.ILLEGAL_RESOURCE, vb)
    # Tokens
    if op == I_OUTT or op == I_OUTCT or op == I_OUTCTI:
        identifier = vb if op == I_OUTT else va
        e = find(identifier)
        if not st.CHANNEL_0 <= e < st.PORT_0 or not used(s, e):
            return fault(s, st.ILLEGAL_RESOURCE, identifier)
        token = va & 0xFF
        if op == I_OUTCT:
            token = st.CONTROL | vb & 0xFF
        elif op == I_OUTCTI:
            token = st.CONTROL | imm
        return _transmit(s, outbox, inbox, t, e - st.CHANNEL_0, token, 1, now)
    if op == I_INT or op == I_INCT or op == I_TESTCT or op == I_CHKCT or op == I_CHKCTI:
        identifier = va if op == I_CHKCT or op == I_CHKCTI else vb
        e = find(identifier)
        if not st.CHANNEL_0 <= e < st.PORT_0 or not used(s, e):
            return fault(s, st.ILLEGAL_RESOURCE, identifier)
        d = e - st.CHANNEL_0
        own(s, e, t)
        absorb(s, inbox, d, now)
        if s[st.CHANNEL + d * st.CHANNEL_ROW + st.TOKENS] == 0:
            pause(s, t, st.FOR_TOKEN, e, now + 1)
            return st.PAUSE
        token = token_at(s, d, 0)
        if op == I_TESTCT:
            regs[k + a] = 1 if token >= st.CONTROL else 0
            return st.DONE
        if op == I_INT or op == I_INCT:
            if (token >= st.CONTROL) != (op == I_INCT):
                return fault(s, st.ILLEGAL_RESOURCE, identifier)
            regs[k + a] = token & 0xFF
        elif token != st.CONTROL | (imm if op == I_CHKCTI else vb):
            return fault(s, st.ILLEGAL_RESOURCE, identifier)
        take(s, inbox, d, 1, now)
        return st.DONE
    if op == I_TESTWCT:
        e = find(vb)
        if not st.CHANNEL_0 <= e < st.PORT_0 or not used(s, e):
            return fault(s, st.ILLEGAL_RESOURCE, vb)
        own(s, e, t)
        absorb(s, inbox, e - st.CHANNEL_0, now)
        place = word_is_there(s, e - st.CHANNEL_0)
        if place < 0:
            pause(s, t, st.FOR_WORD, e, word_after(s, inbox, e - st.CHANNEL_0, now))
            return st.PAUSE
        regs[k + a] = place
        return st.DONE
    # Ports only
    if (
        op == I_OUTSHR or op == I_INSHR or op == I_OUTPW or op == I_INPW or op == I_PEEK or op == I_GETTS
        or op == I_SETPT or op == I_SETPSC or op == I_ENDIN or op == I_SETTW
    ):  # fmt: skip
        p = _port(s, regs, pins, log, vb, t, now)
        if p < 0:
            return fault(s, st.ILLEGAL_RESOURCE, vb)
        q = st.PORT + p * st.PORT_ROW
        whole = s[q + st.TRANSFER_WIDTH]
        if op == I_OUTSHR:
            result = _output(s, pins, p, t, va, 0, now)
            if result == st.DONE:
                regs[k + a] = va >> whole
            return result
        if op == I_INSHR:
            result = _input(s, pins, p, t, 0, now)
            if result == st.DONE:
                regs[k + a] = va >> whole | s[st.FAULT_DATA] << (32 - whole)
            return result
        if op == I_OUTPW or op == I_INPW or op == I_SETPSC:
            entries = _entries(s, q, va if op == I_SETPSC else imm)
            if entries == 0:
                return fault(s, st.ILLEGAL_RESOURCE, vb)
            if op == I_OUTPW:
                return _output(s, pins, p, t, va, entries, now)
            if op == I_INPW:
                result = _input(s, pins, p, t, entries, now)
                if result == st.DONE:
                    regs[k + a] = s[st.FAULT_DATA]
                return result
        if op == I_SETPT or op == I_SETPSC:
            if s[q + st.OUTPUT] != 0 and s[q + st.FULL] != 0:
                pause(s, t, st.FOR_OUTPUT, st.PORT_0 + p, output_after(s, pins, q, now))
                return st.PAUSE
            if op == I_SETPSC:
                s[q + st.SHIFT_COUNT] = va // s[q + st.WIDTH]
            else:
                s[q + st.PORT_TIME] = va & 0xFFFF
                s[q + st.TIMED] = 1
                s[q + st.HOLD] = 0
            return st.DONE
        if op == I_PEEK:
            value = s[q + st.DRIVEN]
            if s[q + st.OUTPUT] == 0:
                value = signed(s[q + st.PINS])
            regs[k + a] = value ^ s[q + st.INVERTED]
        elif op == I_GETTS:
            regs[k + a] = s[q + st.STAMP]
        elif op == I_SETTW:
            width = s[q + st.WIDTH]
            if va < width or (va != width and va != 8 and va != 32) or va % width != 0:
                return fault(s, st.ILLEGAL_RESOURCE, vb)
            s[q + st.TRANSFER_WIDTH] = va
            s[q + st.ENTRIES] = va // width
            s[q + st.SHIFT_COUNT] = va // width
        else:
            if s[q + st.OUTPUT] != 0 or s[q + st.BUFFERED] == 0:
                return fault(s, st.ILLEGAL_RESOURCE, vb)
            entries = s[q + st.VALID]
            if s[q + st.FULL] != 0:
                if entries != 0:
                    s[q + st.SHIFT_COUNT] = entries
                entries += s[q + st.ENTRIES]
            else:
                s[q + st.VALID] = 0
                s[q + st.SHIFT_COUNT] = s[q + st.ENTRIES]
                s[q + st.STAMP] = s[q + st.COUNTER]
                s[q + st.TRANSFER] = s[q + st.SHIFT]
                s[q + st.FULL] = 1
            regs[k + a] = entries * s[q + st.WIDTH]
        return st.DONE
    if op == I_CLRPT or op == I_SYNCR:
        p = _port(s, regs, pins, log, va, t, now)
        if p < 0:
            return fault(s, st.ILLEGAL_RESOURCE, va)
        q = st.PORT + p * st.PORT_ROW
        if op == I_CLRPT:
            s[q + st.TIMED] = 0
            s[q + st.HOLD] = 0
        elif not is_drained(s, q):
            pause(s, t, st.FOR_DRAIN, st.PORT_0 + p, drained_after(s, pins, q, now))
            return st.PAUSE
        return st.DONE
    return st.OTHER
