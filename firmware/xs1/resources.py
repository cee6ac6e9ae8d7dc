# numba compiles a comparison with each of a few reasons, not a search
# mypy: disable-error-code="no-any-return"
"""Threads' dealings with resources, for the core's kernel: finding them, waiting for them, their events.

A paused thread has a time at which it looks again, which is exact where it can be computed, and is brought forward by
whoever changes what it waits for. It takes no slot of the scheduler until its instruction can go on.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from . import state as st
from .channels import absorb, may_send, room_after, word_after, word_is_there
from .compiled import part
from .ports import drained_after, input_after, input_is_ready, output_after, update

__all__ = [
    "disable", "due_event", "enable", "enter", "fault", "find", "find_port", "free_thread", "is_drained", "own",
    "pause", "settle", "signed", "slot", "take_event", "timer_after", "used", "wake",
]  # fmt: skip


@part
def find_port(identifier: int) -> int:
    """The number of a port; -1 if there is none with this identifier."""
    if identifier & 0xFF != st.TYPE_PORT:
        return -1
    width, number = identifier >> 16, identifier >> 8 & 0xFF
    if width == 32 and number < 2:
        return 30 + number
    if width == 1 and number < 16:
        return number
    if width == 4 and number < 6:
        return 16 + number
    if width == 8 and number < 4:
        return 22 + number
    if width == 16 and number < 4:
        return 26 + number
    return -1


@part
def find(identifier: int) -> int:
    """The index of a resource, in use or not; -1 if there is none with this identifier."""
    kind, number = identifier & 0xFF, identifier >> 8 & 0xFF
    if kind == st.TYPE_PORT:
        port = find_port(identifier)
        return st.PORT_0 + port if port >= 0 else -1
    if kind == st.TYPE_CHANNEL and number < st.CHANNEL_ENDS:
        return st.CHANNEL_0 + number
    if kind == st.TYPE_TIMER and number < st.TIMERS:
        return st.TIMER_0 + number
    if kind == st.TYPE_LOCK and number < st.LOCKS:
        return st.LOCK_0 + number
    if kind == st.TYPE_SYNC and number < st.SYNCHRONISERS:
        return st.SYNC_0 + number
    if kind == st.TYPE_CLOCK and number < st.CLOCKS:
        return st.CLOCK_0 + number
    if kind == st.TYPE_THREAD and number < st.THREADS:
        return st.THREAD_0 + number
    return -1


@part
def _any_slot(s: Any, t: int, now: int, period: int) -> int:
    """The first cycle from now on whose slot among so many no running thread but `t` has."""
    free = False
    while not free:
        free = True
        for u in range(st.THREADS):
            if s[st.STATE + u] == st.RUNNING and u != t and (s[st.READY + u] - now) % period == 0:
                free = False
        now += 0 if free else 1
    return now


@part
def slot(s: Any, t: int, now: int) -> int:
    """When a thread that does not run may issue.

    If every thread in use can have a slot of its own among `ISSUE` cycles, it is the first cycle, from now on, whose
    slot no running thread has; else it is now, and the thread that waits longest comes first.
    """
    period = s[st.ISSUE]
    now = max(now, s[st.THREAD + t * st.THREAD_ROW + st.ISSUED] + period)
    if s[st.USED_THREADS] > period:
        return now
    if now <= s[st.LAST]:
        now = s[st.LAST] + 1
    if period != 4:
        return _any_slot(s, t, now, period)
    taken = 0
    for u in range(st.THREADS):
        if s[st.STATE + u] == st.RUNNING and u != t:
            taken |= 1 << (s[st.READY + u] & 3)
    while taken >> (now & 3) & 1:
        now += 1
    return now


@part
def free_thread(s: Any, t: int) -> None:
    """End a thread. If all that remain can have slots of their own, they get them."""
    s[st.STATE + t] = st.FREE
    s[st.READY + t] = st.NEVER
    s[st.RESOURCE + (st.THREAD_0 + t) * st.RESOURCE_ROW + st.USED] = 0
    for e in range(st.TIMER_0, st.LOCK_0):
        if s[st.RESOURCE + e * st.RESOURCE_ROW + st.OWNER] == t:
            disable(s, e)
    s[st.USED_THREADS] -= 1
    if s[st.USED_THREADS] == s[st.ISSUE]:
        settle(s)


@part
def settle(s: Any) -> None:
    """Give each running thread a slot of its own, in the order in which they are ready."""
    period = s[st.ISSUE]
    taken, done = 0, 0
    for _ in range(st.THREADS):
        first = -1
        for u in range(st.THREADS):
            if (
                s[st.STATE + u] == st.RUNNING
                and not done >> u & 1
                and (first < 0 or s[st.READY + u] < s[st.READY + first])
            ):
                first = u
        if first < 0:
            return
        time = max(s[st.READY + first], s[st.LAST] + 1)
        while taken >> time % period & 1:
            time += 1
        s[st.READY + first] = time
        taken |= 1 << time % period
        done |= 1 << first


@part
def _list(s: Any, t: int, e: int) -> None:
    """Enter a resource into a thread's list of events."""
    place = st.LIST + t * st.LIST_ROW + s[st.THREAD + t * st.THREAD_ROW + st.EVENTS]
    s[st.THREAD + t * st.THREAD_ROW + st.EVENTS] += 1
    while place > st.LIST + t * st.LIST_ROW and s[place - 1] > e:
        s[place] = s[place - 1]
        place -= 1
    s[place] = e


@part
def _unlist(s: Any, t: int, e: int) -> None:
    first = st.LIST + t * st.LIST_ROW
    count = s[st.THREAD + t * st.THREAD_ROW + st.EVENTS]
    kept = 0
    for place in range(count):
        other = s[first + place]
        if other != e:
            s[first + kept] = other
            kept += 1
    s[st.THREAD + t * st.THREAD_ROW + st.EVENTS] = kept


@part
def enable(s: Any, e: int) -> None:
    """Enable events of a resource for its owner."""
    r = st.RESOURCE + e * st.RESOURCE_ROW
    if s[r + st.ENABLED] == 0:
        s[r + st.ENABLED] = 1
        _list(s, s[r + st.OWNER], e)


@part
def disable(s: Any, e: int) -> None:
    """Disable events of a resource."""
    r = st.RESOURCE + e * st.RESOURCE_ROW
    if s[r + st.ENABLED] != 0:
        s[r + st.ENABLED] = 0
        _unlist(s, s[r + st.OWNER], e)


@part
def own(s: Any, e: int, t: int) -> None:
    """Make the thread that uses a resource its owner."""
    r = st.RESOURCE + e * st.RESOURCE_ROW
    if s[r + st.OWNER] != t:
        enabled = s[r + st.ENABLED]
        disable(s, e)
        s[r + st.OWNER] = t
        if enabled != 0:
            enable(s, e)


@part
def pause(s: Any, t: int, why: int, e: int, again: int) -> None:
    """Let a thread wait for a resource, and look again at a cycle."""
    b = st.THREAD + t * st.THREAD_ROW
    s[st.STATE + t] = st.PAUSED
    s[st.READY + t] = again
    s[b + st.WHY] = why
    s[b + st.ON] = e
    s[st.SEQUENCE] += 1
    s[b + st.ORDER] = s[st.SEQUENCE]


@part
def timer_after(s: Any, e: int, now: int) -> int:
    """When a timer's condition is met; now or earlier if it is."""
    b = st.TIMER + (e - st.TIMER_0) * st.TIMER_ROW
    if s[b + st.AFTER] == 0:
        return now
    missing = (s[b + st.TIMER_DATA] + 1 - (now >> 2)) & 0xFFFFFFFF
    if missing == 0 or missing > 0x7FFFFFFF:
        return now
    return ((now >> 2) + missing) << 2


@part
def _event_after(s: Any, regs: Any, inbox: Any, pins: Any, log: Any, e: int, now: int) -> int:
    """When a resource has an event, as far as is known; now or earlier if it has."""
    if e < st.CHANNEL_0:
        return timer_after(s, e, now)
    if e < st.PORT_0:
        b = st.CHANNEL + (e - st.CHANNEL_0) * st.CHANNEL_ROW
        absorb(s, inbox, e - st.CHANNEL_0, now)
        if s[b + st.TOKENS] > 0:
            return now
        if s[b + st.INBOX_FIRST] < s[b + st.INBOX_END]:
            return max(now + 1, inbox[e - st.CHANNEL_0, s[b + st.INBOX_FIRST]] >> 16)
        return st.NEVER
    p = e - st.PORT_0
    update(s, regs, pins, log, p, now)
    b = st.PORT + p * st.PORT_ROW
    if s[b + st.OUTPUT] == 0 and input_is_ready(s, b):
        return now
    return input_after(s, pins, p, now) if s[b + st.OUTPUT] == 0 else st.NEVER


@part
def due_event(s: Any, regs: Any, inbox: Any, pins: Any, log: Any, t: int, now: int) -> tuple[int, int]:
    """The first of a thread's resources that has an event or interrupt which the thread permits.

    Returns
    -------
    resource : int
        Its index; -1 if there is none now.
    again : int
        Then, when to look again.
    """
    status = regs[t * st.REGISTER_ROW + st.SR]
    again = st.NEVER
    for place in range(s[st.THREAD + t * st.THREAD_ROW + st.EVENTS]):
        e = s[st.LIST + t * st.LIST_ROW + place]
        permits = st.IEBLE if s[st.RESOURCE + e * st.RESOURCE_ROW + st.INTERRUPT] != 0 else st.EEBLE
        if status & permits:
            time = _event_after(s, regs, inbox, pins, log, e, now)
            if time <= now:
                return e, now
            again = min(again, time)
    return -1, again


@part
def take_event(s: Any, regs: Any, t: int, e: int) -> None:
    """Let a thread begin at the vector of a resource."""
    r, b, k = st.RESOURCE + e * st.RESOURCE_ROW, st.THREAD + t * st.THREAD_ROW, t * st.REGISTER_ROW
    status = signed(regs[k + st.SR]) & ~st.WAITING
    if s[r + st.INTERRUPT] != 0:
        regs[k + st.SSR] = status
        regs[k + st.SPC] = st.RAM + 2 * s[b + st.PC]
        regs[k + st.SED] = regs[k + st.ED]
        regs[k + st.SR] = status & ~(st.IEBLE | st.EEBLE) | st.ININT | st.INK
    else:
        regs[k + st.SR] = status & ~(st.EEBLE | st.INENB)
    regs[k + st.ED] = s[r + st.ENVIRONMENT]
    s[b + st.PC] = s[r + st.VECTOR]
    s[b + st.NEXT] = -1
    if e >= st.PORT_0:
        s[st.PORT + (e - st.PORT_0) * st.PORT_ROW + st.HOLD] = 1


@part
def signed(value: Any) -> Any:
    """An unsigned register as a signed number, which mixes with others."""
    return np.int64(value)


@part
def wake(s: Any, regs: Any, inbox: Any, pins: Any, log: Any, t: int, now: int) -> None:
    """Let a paused thread look again: it runs, or pauses until a later time."""
    b = st.THREAD + t * st.THREAD_ROW
    why, e = s[b + st.WHY], s[b + st.ON]
    goes_on = False
    again = st.NEVER
    if why == st.FOR_OUTPUT:
        p = e - st.PORT_0
        update(s, regs, pins, log, p, now)
        goes_on = s[st.PORT + p * st.PORT_ROW + st.FULL] == 0 or s[st.PORT + p * st.PORT_ROW + st.OUTPUT] == 0
        if not goes_on:
            again = output_after(s, pins, st.PORT + p * st.PORT_ROW, now)
    elif why == st.FOR_TIME:
        again = timer_after(s, e, now)
        goes_on = again <= now
    elif why == st.FOR_TOKEN or why == st.FOR_WORD:
        d = e - st.CHANNEL_0
        absorb(s, inbox, d, now)
        if why == st.FOR_WORD:
            goes_on = word_is_there(s, d) >= 0
            if not goes_on:
                again = word_after(s, inbox, d, now)
        else:
            again = _event_after(s, regs, inbox, pins, log, e, now)
            goes_on = again <= now
    elif why == st.FOR_LINK:
        again = room_after(s, s[b + st.SOURCE], s[b + st.NEED])
        goes_on = again <= now
    elif why == st.FOR_ROOM or why == st.FOR_CLAIM:
        d = e - st.CHANNEL_0
        absorb(s, inbox, d, now)
        goes_on = may_send(s, t)
        if not goes_on and s[st.CHANNEL + d * st.CHANNEL_ROW + st.CLAIM] == st.OUTSIDE:
            first = s[st.CHANNEL + d * st.CHANNEL_ROW + st.INBOX_FIRST]
            if first < s[st.CHANNEL + d * st.CHANNEL_ROW + st.INBOX_END]:
                again = max(now + 1, inbox[d, first] >> 16)
    elif why == st.FOR_INPUT:
        p = e - st.PORT_0
        update(s, regs, pins, log, p, now)
        goes_on = s[st.PORT + p * st.PORT_ROW + st.OUTPUT] == 0 and input_is_ready(s, st.PORT + p * st.PORT_ROW)
        if not goes_on:
            again = input_after(s, pins, p, now)
    elif why == st.FOR_DRAIN:
        p = e - st.PORT_0
        update(s, regs, pins, log, p, now)
        goes_on = is_drained(s, st.PORT + p * st.PORT_ROW)
        if not goes_on:
            again = drained_after(s, pins, st.PORT + p * st.PORT_ROW, now)
    elif why == st.FOR_LOCK:
        goes_on = s[st.LOCK + (e - st.LOCK_0) * st.LOCK_ROW + st.GRANTED] == t
    if not goes_on and regs[t * st.REGISTER_ROW + st.SR] & (st.EEBLE | st.IEBLE) != 0:
        event, time = due_event(s, regs, inbox, pins, log, t, now)
        if event >= 0:
            take_event(s, regs, t, event)
            goes_on = True
        again = min(again, time)
    if goes_on:
        s[st.READY + t] = slot(s, t, now)
        s[st.STATE + t] = st.RUNNING
    else:
        s[st.READY + t] = again


@part
def is_drained(s: Any, b: int) -> bool:
    """Whether an output has sent all that it was given."""
    return s[b + st.OUTPUT] == 0 or (s[b + st.VALID] == 0 and s[b + st.FULL] == 0)


@part
def enter(regs: Any, k: int, pc: int, kind: int, data: int) -> int:
    """Enter the kernel; returns the half word where it begins, or -1 if it is nowhere."""
    kep = signed(regs[k + st.KEP]) + (64 if kind == st.KCALL else 0)
    half = (kep - st.RAM) >> 1
    if kep & 1 or not 0 <= half < st.HALVES:
        return -1
    status = signed(regs[k + st.SR])
    regs[k + st.SSR] = status
    regs[k + st.SPC] = pc
    regs[k + st.SED] = regs[k + st.ED]
    regs[k + st.SR] = status & ~(st.EEBLE | st.IEBLE) | st.INK
    regs[k + st.ET] = kind
    regs[k + st.ED] = data
    return half


@part
def fault(s: Any, kind: int, data: int) -> int:
    """Note an exception, for the instruction to end with."""
    s[st.FAULT] = kind
    s[st.FAULT_DATA] = data
    return st.TRAP


@part
def used(s: Any, e: int) -> bool:
    """Whether a resource is allocated."""
    return e >= 0 and s[st.RESOURCE + e * st.RESOURCE_ROW + st.USED] != 0
