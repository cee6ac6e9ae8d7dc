# ruff: noqa: SIM109  # numba compiles a comparison with each of a few reasons, not a search
# mypy: disable-error-code="no-any-return"
"""Threads' dealings with resources, for the core's kernel: finding them, waiting for them, their events.

A paused thread has a time at which it looks again, which is exact where it can be computed, and is brought forward by
whoever changes what it waits for. It takes no slot of the scheduler until its instruction can go on.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .channels import absorb, may_send, room_after, word_after, word_is_there
from .compiled import part
from .ports import drained_after, input_after, input_is_ready, output_after, update
from .state import (
    AFTER,
    CHANNEL,
    CHANNEL_0,
    CHANNEL_ENDS,
    CHANNEL_ROW,
    CLAIM,
    CLOCK_0,
    CLOCKS,
    ED,
    EEBLE,
    ENABLED,
    ENVIRONMENT,
    ET,
    EVENTS,
    FOR_CLAIM,
    FOR_DRAIN,
    FOR_INPUT,
    FOR_LINK,
    FOR_LOCK,
    FOR_OUTPUT,
    FOR_ROOM,
    FOR_TIME,
    FOR_TOKEN,
    FOR_WORD,
    FREE,
    FULL,
    GRANTED,
    HALVES,
    HOLD,
    IEBLE,
    INBOX_END,
    INBOX_FIRST,
    INENB,
    ININT,
    INK,
    INTERRUPT,
    ISSUE,
    ISSUED,
    KCALL,
    KEP,
    LAST,
    LIST,
    LIST_ROW,
    LOCK,
    LOCK_0,
    LOCK_ROW,
    LOCKS,
    NEED,
    NEVER,
    NEXT,
    ON,
    ORDER,
    OUTPUT,
    OUTSIDE,
    OWNER,
    PAUSED,
    PC,
    PORT,
    PORT_0,
    PORT_ROW,
    RAM,
    READY,
    REGISTER_ROW,
    RESOURCE,
    RESOURCE_ROW,
    RUNNING,
    SED,
    SEQUENCE,
    SOURCE,
    SPC,
    SR,
    SSR,
    STATE,
    SYNC_0,
    SYNCHRONISERS,
    THREAD,
    THREAD_0,
    THREAD_ROW,
    THREADS,
    TIMER,
    TIMER_0,
    TIMER_DATA,
    TIMER_ROW,
    TIMERS,
    TOKENS,
    TYPE_CHANNEL,
    TYPE_CLOCK,
    TYPE_LOCK,
    TYPE_PORT,
    TYPE_SYNC,
    TYPE_THREAD,
    TYPE_TIMER,
    USED,
    USED_THREADS,
    VALID,
    VECTOR,
    WAITING,
    WHY,
)

__all__ = [
    "disable", "due_event", "enable", "enter", "find", "find_port", "free_thread", "is_drained", "own", "pause",
    "settle", "signed", "slot", "take_event", "timer_after", "wake",
]  # fmt: skip


@part
def find_port(identifier: int) -> int:
    """The number of a port; -1 if there is none with this identifier."""
    if identifier & 0xFF != TYPE_PORT:
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
    if kind == TYPE_PORT:
        port = find_port(identifier)
        return PORT_0 + port if port >= 0 else -1
    if kind == TYPE_CHANNEL and number < CHANNEL_ENDS:
        return CHANNEL_0 + number
    if kind == TYPE_TIMER and number < TIMERS:
        return TIMER_0 + number
    if kind == TYPE_LOCK and number < LOCKS:
        return LOCK_0 + number
    if kind == TYPE_SYNC and number < SYNCHRONISERS:
        return SYNC_0 + number
    if kind == TYPE_CLOCK and number < CLOCKS:
        return CLOCK_0 + number
    if kind == TYPE_THREAD and number < THREADS:
        return THREAD_0 + number
    return -1


@part
def _any_slot(s: Any, t: int, now: int, period: int) -> int:
    """The first cycle from now on whose slot among so many no running thread but `t` has."""
    free = False
    while not free:
        free = True
        for u in range(THREADS):
            if s[STATE + u] == RUNNING and u != t and (s[READY + u] - now) % period == 0:
                free = False
        now += 0 if free else 1
    return now


@part
def slot(s: Any, t: int, now: int) -> int:
    """When a thread that does not run may issue.

    If every thread in use can have a slot of its own among `ISSUE` cycles, it is the first cycle, from now on, whose
    slot no running thread has; else it is now, and the thread that waits longest comes first.
    """
    period = s[ISSUE]
    now = max(now, s[THREAD + t * THREAD_ROW + ISSUED] + period)
    if s[USED_THREADS] > period:
        return now
    if now <= s[LAST]:
        now = s[LAST] + 1
    if period != 4:
        return _any_slot(s, t, now, period)
    taken = 0
    for u in range(THREADS):
        if s[STATE + u] == RUNNING and u != t:
            taken |= 1 << (s[READY + u] & 3)
    while taken >> (now & 3) & 1:
        now += 1
    return now


@part
def free_thread(s: Any, t: int) -> None:
    """End a thread. If all that remain can have slots of their own, they get them."""
    s[STATE + t] = FREE
    s[READY + t] = NEVER
    s[RESOURCE + (THREAD_0 + t) * RESOURCE_ROW + USED] = 0
    for e in range(TIMER_0, LOCK_0):
        if s[RESOURCE + e * RESOURCE_ROW + OWNER] == t:
            disable(s, e)
    s[USED_THREADS] -= 1
    if s[USED_THREADS] == s[ISSUE]:
        settle(s)


@part
def settle(s: Any) -> None:
    """Give each running thread a slot of its own, in the order in which they are ready."""
    period = s[ISSUE]
    taken, done = 0, 0
    for _ in range(THREADS):
        first = -1
        for u in range(THREADS):
            if s[STATE + u] == RUNNING and not done >> u & 1 and (first < 0 or s[READY + u] < s[READY + first]):
                first = u
        if first < 0:
            return
        time = max(s[READY + first], s[LAST] + 1)
        while taken >> time % period & 1:
            time += 1
        s[READY + first] = time
        taken |= 1 << time % period
        done |= 1 << first


@part
def _list(s: Any, t: int, e: int) -> None:
    """Enter a resource into a thread's list of events."""
    place = LIST + t * LIST_ROW + s[THREAD + t * THREAD_ROW + EVENTS]
    s[THREAD + t * THREAD_ROW + EVENTS] += 1
    while place > LIST + t * LIST_ROW and s[place - 1] > e:
        s[place] = s[place - 1]
        place -= 1
    s[place] = e


@part
def _unlist(s: Any, t: int, e: int) -> None:
    first = LIST + t * LIST_ROW
    count = s[THREAD + t * THREAD_ROW + EVENTS]
    kept = 0
    for place in range(count):
        other = s[first + place]
        if other != e:
            s[first + kept] = other
            kept += 1
    s[THREAD + t * THREAD_ROW + EVENTS] = kept


@part
def enable(s: Any, e: int) -> None:
    """Enable events of a resource for its owner."""
    r = RESOURCE + e * RESOURCE_ROW
    if s[r + ENABLED] == 0:
        s[r + ENABLED] = 1
        _list(s, s[r + OWNER], e)


@part
def disable(s: Any, e: int) -> None:
    """Disable events of a resource."""
    r = RESOURCE + e * RESOURCE_ROW
    if s[r + ENABLED] != 0:
        s[r + ENABLED] = 0
        _unlist(s, s[r + OWNER], e)


@part
def own(s: Any, e: int, t: int) -> None:
    """Make the thread that uses a resource its owner."""
    r = RESOURCE + e * RESOURCE_ROW
    if s[r + OWNER] != t:
        enabled = s[r + ENABLED]
        disable(s, e)
        s[r + OWNER] = t
        if enabled != 0:
            enable(s, e)


@part
def pause(s: Any, t: int, why: int, e: int, again: int) -> None:
    """Let a thread wait for a resource, and look again at a cycle."""
    b = THREAD + t * THREAD_ROW
    s[STATE + t] = PAUSED
    s[READY + t] = again
    s[b + WHY] = why
    s[b + ON] = e
    s[SEQUENCE] += 1
    s[b + ORDER] = s[SEQUENCE]


@part
def timer_after(s: Any, e: int, now: int) -> int:
    """When a timer's condition is met; now or earlier if it is."""
    b = TIMER + (e - TIMER_0) * TIMER_ROW
    if s[b + AFTER] == 0:
        return now
    missing = (s[b + TIMER_DATA] + 1 - (now >> 2)) & 0xFFFFFFFF
    if missing == 0 or missing > 0x7FFFFFFF:
        return now
    return ((now >> 2) + missing) << 2


@part
def _event_after(s: Any, regs: Any, inbox: Any, pins: Any, log: Any, e: int, now: int) -> int:
    """When a resource has an event, as far as is known; now or earlier if it has."""
    if e < CHANNEL_0:
        return timer_after(s, e, now)
    if e < PORT_0:
        b = CHANNEL + (e - CHANNEL_0) * CHANNEL_ROW
        absorb(s, inbox, e - CHANNEL_0, now)
        if s[b + TOKENS] > 0:
            return now
        if s[b + INBOX_FIRST] < s[b + INBOX_END]:
            return max(now + 1, inbox[e - CHANNEL_0, s[b + INBOX_FIRST]] >> 16)
        return NEVER
    p = e - PORT_0
    update(s, regs, pins, log, p, now)
    b = PORT + p * PORT_ROW
    if s[b + OUTPUT] == 0 and input_is_ready(s, b):
        return now
    return input_after(s, pins, p, now) if s[b + OUTPUT] == 0 else NEVER


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
    status = regs[t * REGISTER_ROW + SR]
    again = NEVER
    for place in range(s[THREAD + t * THREAD_ROW + EVENTS]):
        e = s[LIST + t * LIST_ROW + place]
        permits = IEBLE if s[RESOURCE + e * RESOURCE_ROW + INTERRUPT] != 0 else EEBLE
        if status & permits:
            time = _event_after(s, regs, inbox, pins, log, e, now)
            if time <= now:
                return e, now
            again = min(again, time)
    return -1, again


@part
def take_event(s: Any, regs: Any, t: int, e: int) -> None:
    """Let a thread begin at the vector of a resource."""
    r, b, k = RESOURCE + e * RESOURCE_ROW, THREAD + t * THREAD_ROW, t * REGISTER_ROW
    status = signed(regs[k + SR]) & ~WAITING
    if s[r + INTERRUPT] != 0:
        regs[k + SSR] = status
        regs[k + SPC] = RAM + 2 * s[b + PC]
        regs[k + SED] = regs[k + ED]
        regs[k + SR] = status & ~(IEBLE | EEBLE) | ININT | INK
    else:
        regs[k + SR] = status & ~(EEBLE | INENB)
    regs[k + ED] = s[r + ENVIRONMENT]
    s[b + PC] = s[r + VECTOR]
    s[b + NEXT] = -1
    if e >= PORT_0:
        s[PORT + (e - PORT_0) * PORT_ROW + HOLD] = 1


@part
def signed(value: Any) -> Any:
    """An unsigned register as a signed number, which mixes with others."""
    return np.int64(value)


@part
def wake(s: Any, regs: Any, inbox: Any, pins: Any, log: Any, t: int, now: int) -> None:
    """Let a paused thread look again: it runs, or pauses until a later time."""
    b = THREAD + t * THREAD_ROW
    why, e = s[b + WHY], s[b + ON]
    goes_on = False
    again = NEVER
    if why == FOR_OUTPUT:
        p = e - PORT_0
        update(s, regs, pins, log, p, now)
        goes_on = s[PORT + p * PORT_ROW + FULL] == 0 or s[PORT + p * PORT_ROW + OUTPUT] == 0
        if not goes_on:
            again = output_after(s, pins, PORT + p * PORT_ROW, now)
    elif why == FOR_TIME:
        again = timer_after(s, e, now)
        goes_on = again <= now
    elif why == FOR_TOKEN or why == FOR_WORD:
        d = e - CHANNEL_0
        absorb(s, inbox, d, now)
        if why == FOR_WORD:
            goes_on = word_is_there(s, d) >= 0
            if not goes_on:
                again = word_after(s, inbox, d, now)
        else:
            again = _event_after(s, regs, inbox, pins, log, e, now)
            goes_on = again <= now
    elif why == FOR_LINK:
        again = room_after(s, s[b + SOURCE], s[b + NEED])
        goes_on = again <= now
    elif why == FOR_ROOM or why == FOR_CLAIM:
        d = e - CHANNEL_0
        absorb(s, inbox, d, now)
        goes_on = may_send(s, t)
        if not goes_on and s[CHANNEL + d * CHANNEL_ROW + CLAIM] == OUTSIDE:
            first = s[CHANNEL + d * CHANNEL_ROW + INBOX_FIRST]
            if first < s[CHANNEL + d * CHANNEL_ROW + INBOX_END]:
                again = max(now + 1, inbox[d, first] >> 16)
    elif why == FOR_INPUT:
        p = e - PORT_0
        update(s, regs, pins, log, p, now)
        goes_on = s[PORT + p * PORT_ROW + OUTPUT] == 0 and input_is_ready(s, PORT + p * PORT_ROW)
        if not goes_on:
            again = input_after(s, pins, p, now)
    elif why == FOR_DRAIN:
        p = e - PORT_0
        update(s, regs, pins, log, p, now)
        goes_on = is_drained(s, PORT + p * PORT_ROW)
        if not goes_on:
            again = drained_after(s, pins, PORT + p * PORT_ROW, now)
    elif why == FOR_LOCK:
        goes_on = s[LOCK + (e - LOCK_0) * LOCK_ROW + GRANTED] == t
    if not goes_on and regs[t * REGISTER_ROW + SR] & (EEBLE | IEBLE) != 0:
        event, time = due_event(s, regs, inbox, pins, log, t, now)
        if event >= 0:
            take_event(s, regs, t, event)
            goes_on = True
        again = min(again, time)
    if goes_on:
        s[READY + t] = slot(s, t, now)
        s[STATE + t] = RUNNING
    else:
        s[READY + t] = again


@part
def is_drained(s: Any, b: int) -> bool:
    """Whether an output has sent all that it was given."""
    return s[b + OUTPUT] == 0 or (s[b + VALID] == 0 and s[b + FULL] == 0)


@part
def enter(regs: Any, k: int, pc: int, kind: int, data: int) -> int:
    """Enter the kernel; returns the half word where it begins, or -1 if it is nowhere."""
    kep = signed(regs[k + KEP]) + (64 if kind == KCALL else 0)
    half = (kep - RAM) >> 1
    if kep & 1 or not 0 <= half < HALVES:
        return -1
    status = signed(regs[k + SR])
    regs[k + SSR] = status
    regs[k + SPC] = pc
    regs[k + SED] = regs[k + ED]
    regs[k + SR] = status & ~(EEBLE | IEBLE) | INK
    regs[k + ET] = kind
    regs[k + ED] = data
    return half
