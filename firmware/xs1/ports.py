# mypy: disable-error-code="no-any-return"
"""Ports and the clock blocks that drive them, for the core's kernel.

A port changes at edges of its clock only, so nothing happens between them that need be computed: `update` brings a port
up to a cycle when somebody looks at it, in closed form while it repeats itself, and otherwise edge by edge. Outputs
change and the counter advances at falling edges; inputs are sampled at rising edges, or at falling ones if so set.
Ready signals are not modelled.
"""

from __future__ import annotations

from typing import Any

from . import state as st
from .compiled import part

__all__ = [
    "attach", "bring_up", "drained_after", "free_after", "input_after", "input_is_ready", "output_after", "restart",
    "touch", "update",
]  # fmt: skip


@part
def _mask(width: int) -> int:
    return (1 << width) - 1


@part
def _seen(s: Any, b: int) -> int:
    """The input pins as the port reads them."""
    return s[b + st.PINS] ^ s[b + st.INVERTED]


@part
def _agrees(s: Any, b: int, value: int) -> bool:
    """Whether a value meets the port's condition."""
    condition = s[b + st.CONDITION]
    if condition == st.ALWAYS:
        return True
    return (value == s[b + st.PORT_DATA]) == (condition == st.EQUAL)


@part
def input_is_ready(s: Any, b: int) -> bool:
    """Whether IN would find data that meet time and condition.

    Parameters
    ----------
    s : (n,) int64
        State of the core.
    b : int
        The index at which the port's row begins.
    """
    if s[b + st.FULL] == 0 or (s[b + st.TIMED] != 0 and s[b + st.STAMP] != s[b + st.PORT_TIME]):
        return False
    return s[b + st.CONDITION] == st.ALWAYS or (s[b + st.BUFFERED] == 0 and _agrees(s, b, s[b + st.TRANSFER]))


@part
def _awaited(s: Any, regs: Any, p: int, b: int) -> bool:
    """Whether a thread pauses for input, or may have an event of the port."""
    if s[b + st.AWAITED] != 0:
        return True
    e = st.RESOURCE + (st.PORT_0 + p) * st.RESOURCE_ROW
    if s[e + st.ENABLED] == 0:
        return False
    return (regs[s[e + st.OWNER] * st.REGISTER_ROW + st.SR] & (st.IEBLE if s[e + st.INTERRUPT] != 0 else st.EEBLE)) != 0


@part
def _drive(s: Any, log: Any, p: int, b: int, cycle: int) -> None:
    """Put the shift register on the pins, and into the log if they are watched and change."""
    value = 0
    if s[b + st.OUTPUT] != 0:
        value = (s[b + st.SHIFT] & _mask(s[b + st.WIDTH])) ^ s[b + st.INVERTED]
    if value == s[b + st.DRIVEN]:
        return
    s[b + st.DRIVEN] = value
    if s[b + st.WATCHED] != 0:
        n = s[st.LOGGED]
        log[n, 0] = p
        log[n, 1] = cycle
        log[n, 2] = value
        s[st.LOGGED] = n + 1


@part
def _output_falls(s: Any, log: Any, p: int, b: int, cycle: int) -> None:
    """A falling edge of an output."""
    s[b + st.COUNTER] = (s[b + st.COUNTER] + 1) & 0xFFFF
    drives = True
    if s[b + st.TIMED] != 0 and s[b + st.COUNTER] == s[b + st.PORT_TIME]:
        drives = s[b + st.FULL] != 0
        s[b + st.TIMED] = 0
        s[b + st.VALID] = 0
    if s[b + st.VALID] > 0:
        s[b + st.VALID] -= 1
    if s[b + st.VALID] > 0:
        width, whole = s[b + st.WIDTH], s[b + st.TRANSFER_WIDTH]
        shift = s[b + st.SHIFT]
        s[b + st.SHIFT] = shift >> width | shift >> (whole - width) << (whole - width)
    elif s[b + st.TIMED] == 0:
        if s[b + st.FULL] != 0:
            s[b + st.VALID] = s[b + st.SHIFT_COUNT]
            s[b + st.SHIFT_COUNT] = s[b + st.ENTRIES]
            s[b + st.SHIFT] = s[b + st.TRANSFER]
            s[b + st.STAMP] = s[b + st.COUNTER]
            s[b + st.FULL] = 0
        elif s[b + st.TURNING] != 0:
            s[b + st.TURNING] = 0
            drives = False
    if not drives:
        s[b + st.OUTPUT] = 0
    _drive(s, log, p, b, cycle)


@part
def _outputs(s: Any, log: Any, p: int, b: int, origin: int, period: int, first: int, last: int) -> int:
    """Falling edges of an output, numbered from 1, after `first` up to `last`; returns the last that was one."""
    while first < last:
        if s[b + st.VALID] == 0 and s[b + st.TURNING] == 0:
            if s[b + st.TIMED] != 0:
                quiet = (s[b + st.PORT_TIME] - s[b + st.COUNTER] - 1) & 0xFFFF
                quiet = min(quiet, last - first)
            elif s[b + st.FULL] == 0:
                quiet = last - first
            else:
                quiet = 0
            s[b + st.COUNTER] = (s[b + st.COUNTER] + quiet) & 0xFFFF
            first += quiet
            if first == last:
                break
        first += 1
        _output_falls(s, log, p, b, origin + first * period)
        if s[b + st.OUTPUT] == 0:
            break
    return first


@part
def _sample(s: Any, b: int, awaited: bool) -> None:
    """A sampling edge of an input."""
    width, whole = s[b + st.WIDTH], s[b + st.TRANSFER_WIDTH]
    pins = _seen(s, b)
    s[b + st.SHIFT] = s[b + st.SHIFT] >> width | pins << (whole - width)
    s[b + st.VALID] += 1
    if s[b + st.BUFFERED] != 0:
        in_time = s[b + st.TIMED] != 0 and s[b + st.COUNTER] == s[b + st.PORT_TIME]
        asked = in_time or (s[b + st.TIMED] == 0 and s[b + st.CONDITION] != st.ALWAYS)
        if awaited and asked and s[b + st.HOLD] == 0 and _agrees(s, b, pins):
            s[b + st.VALID] = s[b + st.SHIFT_COUNT]
            s[b + st.FULL] = 0
            s[b + st.TIMED] = 0
            s[b + st.CONDITION] = st.ALWAYS
        elif in_time:
            s[b + st.TIMED] = 0
    if s[b + st.VALID] != s[b + st.SHIFT_COUNT]:
        return
    s[b + st.VALID] = 0
    if s[b + st.HOLD] != 0:
        return
    s[b + st.SHIFT_COUNT] = s[b + st.ENTRIES]
    s[b + st.TRANSFER] = s[b + st.SHIFT]
    s[b + st.STAMP] = s[b + st.COUNTER]
    s[b + st.FULL] = 1
    if input_is_ready(s, b):
        if s[b + st.BUFFERED] == 0 and (awaited or s[b + st.TIMED] != 0):
            s[b + st.HOLD] = 1  # what met time or condition, until it is taken
        s[b + st.TIMED] = 0


@part
def _input_edge(s: Any, b: int, falls: bool, awaited: bool) -> None:
    if falls:
        s[b + st.COUNTER] = (s[b + st.COUNTER] + 1) & 0xFFFF
    if falls == (s[b + st.FALLING] != 0):
        _sample(s, b, awaited)


@part
def _plain_inputs(s: Any, b: int, first: int, last: int, awaited: bool) -> None:
    """Half periods after `first` up to `last` of an unbuffered input, whose pins do not change."""
    count, odd = s[b + st.COUNTER], 1 - s[b + st.FALLING]
    if s[b + st.HOLD] == 0:
        sampling = last - 1 + (last & 1 if odd else 1 - (last & 1))
        if awaited and s[b + st.TIMED] == 0 and _agrees(s, b, _seen(s, b)):
            sampling = first + 1 + (first & 1 if odd else 1 - (first & 1))
        if s[b + st.TIMED] != 0:
            timed = 2 * ((first >> 1) + ((s[b + st.PORT_TIME] - count) & 0xFFFF)) + odd
            if timed <= first:
                timed += 1 << 17
            if timed <= last:
                s[b + st.COUNTER] = (count + (timed >> 1) - (first >> 1)) & 0xFFFF
                _sample(s, b, awaited)
        if first < sampling <= last and s[b + st.HOLD] == 0:
            s[b + st.COUNTER] = (count + (sampling >> 1) - (first >> 1)) & 0xFFFF
            _sample(s, b, awaited)
    s[b + st.COUNTER] = (count + (last >> 1) - (first >> 1)) & 0xFFFF


@part
def _inputs(s: Any, b: int, first: int, last: int, awaited: bool) -> None:
    """Half periods after `first` up to `last` of an input, whose pins do not change."""
    if s[b + st.BUFFERED] == 0:
        _plain_inputs(s, b, first, last, awaited)
        return
    settled = first + 4 * s[b + st.ENTRIES] + 2
    while first < last:
        if first >= settled and not awaited and s[b + st.TIMED] == 0:
            entries = s[b + st.SHIFT_COUNT] if s[b + st.HOLD] != 0 else s[b + st.ENTRIES]
            rounds = (last - first) // (2 * entries)
            quiet = rounds * entries
            s[b + st.COUNTER] = (s[b + st.COUNTER] + quiet) & 0xFFFF
            if s[b + st.HOLD] == 0:
                s[b + st.STAMP] = (s[b + st.STAMP] + quiet) & 0xFFFF
            first += 2 * quiet
            settled = last
            if first == last:
                break
        first += 1
        _input_edge(s, b, first & 1 == 0, awaited)


@part
def _advance(s: Any, regs: Any, pins: Any, log: Any, p: int, b: int, now: int) -> None:
    """Let edges of a port's clock take effect, up to a cycle until which its pins do not change."""
    c = st.CLOCK + s[b + st.CLOCK_OF] * st.CLOCK_ROW
    if s[st.RESOURCE + (st.PORT_0 + p) * st.RESOURCE_ROW + st.USED] == 0 or s[c + st.RUNS] == 0:
        return
    source = s[c + st.FROM_PORT]
    if source < 0:
        half, origin = s[c + st.HALF], s[c + st.STARTED]
        last = (now - origin) // half
        first = s[b + st.EDGE]
        while first < last:
            if s[b + st.OUTPUT] != 0:
                fallen = _outputs(s, log, p, b, origin, 2 * half, first >> 1, last >> 1)
                first = last if fallen == last >> 1 and s[b + st.OUTPUT] != 0 else 2 * fallen
            else:
                _inputs(s, b, first, last, _awaited(s, regs, p, b))
                first = last
        s[b + st.EDGE] = max(first, last)
        return
    q = st.PORT + source * st.PORT_ROW
    while s[b + st.EDGE] < s[q + st.PINS_END] and pins[source, s[b + st.EDGE], 0] <= now:
        level = (pins[source, s[b + st.EDGE], 1] ^ s[q + st.INVERTED]) & 1
        if level != s[b + st.LEVEL]:
            s[b + st.LEVEL] = level
            if s[b + st.OUTPUT] == 0:
                _input_edge(s, b, level == 0, _awaited(s, regs, p, b))
            elif level == 0:
                _output_falls(s, log, p, b, pins[source, s[b + st.EDGE], 0])
        s[b + st.EDGE] += 1


@part
def bring_up(s: Any, log: Any, p: int, now: int) -> bool:
    """Do what `update` does, if a port just puts out words, one in each period of its clock; returns whether it does.

    Nearly all that a port does in a field is this, so it is worth a shorter way.
    """
    b = st.PORT + p * st.PORT_ROW
    if s[b + st.OUTPUT] == 0 or s[b + st.ENTRIES] != 1 or s[b + st.TIMED] != 0 or s[b + st.TURNING] != 0:
        return False
    c = st.CLOCK + s[b + st.CLOCK_OF] * st.CLOCK_ROW
    if s[c + st.RUNS] == 0 or s[c + st.FROM_PORT] >= 0 or s[b + st.PINS_FIRST] != s[b + st.PINS_END]:
        return False
    period, origin, first = 2 * s[c + st.HALF], s[c + st.STARTED], s[b + st.EDGE] >> 1
    passed = now - origin - first * period
    if passed < period:
        return True
    last = first + 1 if passed < 2 * period else first + passed // period
    _outputs(s, log, p, b, origin, period, first, last)
    s[b + st.EDGE] = 2 * last
    return True


@part
def update(s: Any, regs: Any, pins: Any, log: Any, p: int, now: int) -> None:
    """Bring a port up to a cycle, this cycle included.

    Parameters
    ----------
    s : (n,) int64
        State of the core.
    regs : (n,) uint32
        Registers of all threads.
    pins : (ports, n, 2) int64
        The cycles and values of its input pins, which Python has written.
    log : (n, 3) int64
        Port, cycle and value of each change of watched pins.
    p : int
        Number of the port.
    now : int
        Not before any cycle to which the port was brought up.
    """
    b = st.PORT + p * st.PORT_ROW
    while s[b + st.PINS_FIRST] < s[b + st.PINS_END]:
        change = pins[p, s[b + st.PINS_FIRST], 0]
        if change > now:
            break
        _advance(s, regs, pins, log, p, b, change - 1)
        s[b + st.PINS] = pins[p, s[b + st.PINS_FIRST], 1]
        s[b + st.PINS_FIRST] += 1
    _advance(s, regs, pins, log, p, b, now)


@part
def attach(s: Any, regs: Any, pins: Any, log: Any, p: int, now: int) -> None:
    """Let a port follow its clock from now on. Its counter is left alone."""
    b = st.PORT + p * st.PORT_ROW
    c = st.CLOCK + s[b + st.CLOCK_OF] * st.CLOCK_ROW
    source = s[c + st.FROM_PORT]
    if source >= 0:
        update(s, regs, pins, log, source, now)
        q = st.PORT + source * st.PORT_ROW
        s[b + st.EDGE] = s[q + st.PINS_FIRST]
        s[b + st.LEVEL] = _seen(s, q) & 1
    else:
        s[b + st.EDGE] = (now - s[c + st.STARTED]) // s[c + st.HALF] if s[c + st.RUNS] != 0 else 0


@part
def touch(s: Any, regs: Any, pins: Any, log: Any, clock: int, now: int) -> None:
    """Bring all ports of a clock block up to now, before it changes."""
    for p in range(st.PORTS):
        if s[st.PORT + p * st.PORT_ROW + st.CLOCK_OF] == clock:
            update(s, regs, pins, log, p, now)


@part
def restart(s: Any, regs: Any, pins: Any, log: Any, clock: int, now: int) -> None:
    """Let all ports of a clock block follow it from now on, after it changed."""
    for p in range(st.PORTS):
        if s[st.PORT + p * st.PORT_ROW + st.CLOCK_OF] == clock:
            attach(s, regs, pins, log, p, now)


@part
def _edge_after(s: Any, pins: Any, b: int, now: int, half_periods: int) -> int:
    """When a half period ends, counted from the start of a port's clock; any edge, if the clock is a port."""
    c = st.CLOCK + s[b + st.CLOCK_OF] * st.CLOCK_ROW
    if s[c + st.RUNS] == 0:
        return st.NEVER
    source = s[c + st.FROM_PORT]
    if source < 0:
        return s[c + st.STARTED] + half_periods * s[c + st.HALF]
    if s[b + st.EDGE] < s[st.PORT + source * st.PORT_ROW + st.PINS_END]:
        return max(now + 1, pins[source, s[b + st.EDGE], 0])
    return st.NEVER


@part
def free_after(s: Any, b: int) -> int:
    """When the transfer register of a port that `bring_up` brings up, and which is full now, becomes free."""
    c = st.CLOCK + s[b + st.CLOCK_OF] * st.CLOCK_ROW
    return s[c + st.STARTED] + 2 * ((s[b + st.EDGE] >> 1) + 1) * s[c + st.HALF]


@part
def output_after(s: Any, pins: Any, b: int, now: int) -> int:
    """When the transfer register of an output, which is full now, becomes free."""
    fallen = s[b + st.EDGE] >> 1
    if s[b + st.TIMED] != 0:
        fallen += ((s[b + st.PORT_TIME] - s[b + st.COUNTER] - 1) & 0xFFFF) + 1
    else:
        fallen += max(s[b + st.VALID], 1)
    return _edge_after(s, pins, b, now, 2 * fallen)


@part
def drained_after(s: Any, pins: Any, b: int, now: int) -> int:
    """When to look again whether an output has nothing left to send."""
    return _edge_after(s, pins, b, now, 2 * ((s[b + st.EDGE] >> 1) + 1))


@part
def input_after(s: Any, pins: Any, p: int, now: int) -> int:
    """When to look again whether a port has the input that is waited for, which it has not now."""
    b = st.PORT + p * st.PORT_ROW
    edge = s[b + st.EDGE]
    if s[b + st.OUTPUT] != 0:
        return drained_after(s, pins, b, now)
    odd = 1 - s[b + st.FALLING]
    change = st.NEVER
    if s[b + st.PINS_FIRST] < s[b + st.PINS_END]:
        change = pins[p, s[b + st.PINS_FIRST], 0]
    if s[b + st.TIMED] != 0:
        sampling = 2 * ((edge >> 1) + ((s[b + st.PORT_TIME] - s[b + st.COUNTER]) & 0xFFFF)) + odd
        if sampling <= edge:
            sampling += 1 << 17
        if s[b + st.BUFFERED] != 0:
            sampling = min(sampling, edge + 1)
        return _edge_after(s, pins, b, now, sampling)
    sampling = edge + 1 + (edge & 1 if odd else 1 - (edge & 1))
    if s[b + st.BUFFERED] != 0 and s[b + st.CONDITION] == st.ALWAYS:
        missing = max(s[b + st.SHIFT_COUNT] - s[b + st.VALID], 1)
        return _edge_after(s, pins, b, now, sampling + 2 * (missing - 1))
    if _agrees(s, b, _seen(s, b)):
        return _edge_after(s, pins, b, now, sampling)
    return change
