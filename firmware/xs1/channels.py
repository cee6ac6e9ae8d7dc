# ruff: noqa: SIM109  # numba compiles a comparison with each of a few numbers, not a search
# mypy: disable-error-code="no-any-return"
"""Channel ends, for the core's kernel.

Tokens of a channel end come from two sides: from threads of this core, which pause if the buffer is full, and from the
inbox, which Python fills with tokens and their times. Tokens to other nodes, and to switches, go into the outbox of
their channel end until a message is complete.
"""

from __future__ import annotations

from typing import Any

from . import state as st
from .compiled import part

__all__ = [
    "absorb", "clear", "may_send", "poke", "room_after", "send", "take", "token_at", "word_after", "word_is_there",
]  # fmt: skip

END, PAUSE = st.CONTROL | 1, st.CONTROL | 2


@part
def poke(s: Any, e: int, now: int) -> None:
    """Let threads that wait for a resource look again.

    Parameters
    ----------
    s : (n,) int64
        State of the core.
    e : int
        Index of the resource.
    now : int
        Cycle.
    """
    r = st.RESOURCE + e * st.RESOURCE_ROW
    owner = s[r + st.OWNER] if s[r + st.ENABLED] != 0 else -1
    for u in range(st.THREADS):
        if s[st.STATE + u] == st.PAUSED and (u == owner or s[st.THREAD + u * st.THREAD_ROW + st.ON] == e):
            s[st.READY + u] = min(s[st.READY + u], now)


@part
def clear(s: Any, inbox: Any, d: int, now: int) -> None:
    """Make a channel end as new; tokens that came before are lost."""
    b = st.CHANNEL + d * st.CHANNEL_ROW
    s[b + st.DESTINATION] = 0
    s[b + st.IN_PACKET] = 0
    s[b + st.TO] = st.NOWHERE
    s[b + st.CLAIM] = st.NOWHERE
    s[b + st.TOKENS] = 0
    s[b + st.OUTBOX_END] = 0
    while s[b + st.INBOX_FIRST] < s[b + st.INBOX_END] and inbox[d, s[b + st.INBOX_FIRST]] >> 16 <= now:
        s[b + st.INBOX_FIRST] += 1
    s[b + st.INBOX_SEEN] = max(s[b + st.INBOX_SEEN], s[b + st.INBOX_FIRST])


@part
def _release(s: Any, d: int, now: int) -> None:
    """End a packet to a channel end: the thread that waits longest may begin its own."""
    chosen = -1
    for u in range(st.THREADS):
        t = st.THREAD + u * st.THREAD_ROW
        waits = s[st.STATE + u] == st.PAUSED and s[t + st.WHY] == st.FOR_CLAIM and s[t + st.ON] == st.CHANNEL_0 + d
        if waits and (chosen < 0 or s[t + st.ORDER] < s[st.THREAD + chosen * st.THREAD_ROW + st.ORDER]):
            chosen = u
    s[st.CHANNEL + d * st.CHANNEL_ROW + st.CLAIM] = st.NOWHERE
    if chosen >= 0:
        s[st.CHANNEL + d * st.CHANNEL_ROW + st.CLAIM] = s[st.THREAD + chosen * st.THREAD_ROW + st.SOURCE]
        s[st.READY + chosen] = min(s[st.READY + chosen], now)


@part
def _put(s: Any, d: int, token: int) -> None:
    b = st.CHANNEL + d * st.CHANNEL_ROW
    s[b + st.BUFFER + ((s[b + st.FIRST] + s[b + st.TOKENS]) & 7)] = token
    s[b + st.TOKENS] += 1


@part
def absorb(s: Any, inbox: Any, d: int, now: int) -> None:
    """Take tokens from outside into the buffer, as far as they have come and there is room.

    Parameters
    ----------
    s : (n,) int64
        State of the core.
    inbox : (32, n) int64
        The tokens of each channel end, with their cycles in the bits from 16 on.
    d : int
        Number of the channel end.
    now : int
        Cycle.
    """
    b = st.CHANNEL + d * st.CHANNEL_ROW
    end = s[b + st.INBOX_END]
    if s[b + st.INBOX_FIRST] == end:
        return
    while s[b + st.INBOX_FIRST] < end and inbox[d, s[b + st.INBOX_FIRST]] >> 16 <= now:
        if s[st.RESOURCE + (st.CHANNEL_0 + d) * st.RESOURCE_ROW + st.USED] == 0:
            s[b + st.INBOX_FIRST] += 1
            s[b + st.INBOX_SEEN] = max(s[b + st.INBOX_SEEN], s[b + st.INBOX_FIRST])
            continue
        claim = s[b + st.CLAIM]
        if s[b + st.TOKENS] == st.BUFFER_SIZE or (claim != st.NOWHERE and claim != st.OUTSIDE):
            break
        token = inbox[d, s[b + st.INBOX_FIRST]] & 0x1FF
        s[b + st.INBOX_FIRST] += 1
        s[b + st.INBOX_SEEN] = max(s[b + st.INBOX_SEEN], s[b + st.INBOX_FIRST])
        if token != PAUSE:
            _put(s, d, token)
        if token == END or token == PAUSE:
            _release(s, d, now)
        else:
            s[b + st.CLAIM] = st.OUTSIDE
    while s[b + st.INBOX_SEEN] < end and inbox[d, s[b + st.INBOX_SEEN]] >> 16 <= now:
        s[st.HELD_UP] += 1
        s[b + st.INBOX_SEEN] += 1


@part
def token_at(s: Any, d: int, place: int) -> int:
    """A token of the buffer, which is left there."""
    b = st.CHANNEL + d * st.CHANNEL_ROW
    return s[b + st.BUFFER + ((s[b + st.FIRST] + place) & 7)]


@part
def take(s: Any, inbox: Any, d: int, count: int, now: int) -> None:
    """Remove tokens from the front of the buffer."""
    b = st.CHANNEL + d * st.CHANNEL_ROW
    s[b + st.FIRST] = (s[b + st.FIRST] + count) & 7
    s[b + st.TOKENS] -= count
    absorb(s, inbox, d, now)
    if s[b + st.CLAIM] >= 0:
        poke(s, st.CHANNEL_0 + d, now)


@part
def word_is_there(s: Any, d: int) -> int:
    """Whether four tokens are there, or a control token among fewer: 1 to 4 is its place, 0 for none, -1 to wait."""
    count = min(s[st.CHANNEL + d * st.CHANNEL_ROW + st.TOKENS], 4)
    for place in range(count):
        if token_at(s, d, place) >= st.CONTROL:
            return place + 1
    return 0 if count == 4 else -1


@part
def word_after(s: Any, inbox: Any, d: int, now: int) -> int:
    """When a word, or a control token in its place, will be there, as far as is known."""
    b = st.CHANNEL + d * st.CHANNEL_ROW
    count = s[b + st.TOKENS]
    for place in range(s[b + st.INBOX_FIRST], s[b + st.INBOX_END]):
        count += 1
        if count == 4 or inbox[d, place] & st.CONTROL:
            return max(now + 1, inbox[d, place] >> 16)
    return st.NEVER


@part
def room_after(s: Any, c: int, count: int) -> int:
    """When the link of a channel end has room for some tokens; now or earlier if it has."""
    return s[st.CHANNEL + c * st.CHANNEL_ROW + st.LEFT] - (st.BUFFER_SIZE - count) * s[st.LINK_CYCLES]


@part
def send(s: Any, outbox: Any, inbox: Any, c: int, value: int, count: int, now: int) -> int:
    """Send a token, or the four of a word.

    Parameters
    ----------
    s : (n,) int64
        State of the core.
    outbox : (32, n) int64
        The tokens of its message to elsewhere.
    inbox : (32, n) int64
        As for `absorb`.
    c : int
        The channel end that sends.
    value, count : int
        A token with its control bit, 1; or a word, 4.
    now : int
        Cycle.

    Returns
    -------
    int
        -3 if it is sent, -2 if a message is complete with it, -1 if there is no destination; else why the thread
        pauses.
    """
    b = st.CHANNEL + c * st.CHANNEL_ROW
    ends = count == 1 and (value == END or value == PAUSE)
    to = s[b + st.TO]
    if s[b + st.IN_PACKET] == 0:
        destination = s[b + st.DESTINATION]
        if destination == 0:
            return -1
        if destination & 0xFF != st.TYPE_CHANNEL or destination >> 16 != s[st.NODE]:
            to = st.ELSEWHERE
            s[b + st.BEGAN] = now
        else:
            to = destination >> 8 & 0xFF
            if to >= st.CHANNEL_ENDS or s[st.RESOURCE + (st.CHANNEL_0 + to) * st.RESOURCE_ROW + st.USED] == 0:
                to = st.THROWN_AWAY
            else:
                absorb(s, inbox, to, now)
                d = st.CHANNEL + to * st.CHANNEL_ROW
                if s[d + st.CLAIM] != st.NOWHERE and s[d + st.CLAIM] != c:
                    s[b + st.TO] = to
                    return st.FOR_CLAIM
                s[d + st.CLAIM] = c
        s[b + st.TO] = to
        s[b + st.IN_PACKET] = 1
    if to == st.THROWN_AWAY:
        s[b + st.IN_PACKET] = 0 if ends else 1
        return -3
    if to == st.ELSEWHERE:
        if room_after(s, c, count) > now:
            return st.FOR_LINK
        n = s[b + st.OUTBOX_END]
        for place in range(count):
            outbox[c, n + place] = value >> 8 * (count - 1 - place) & 0xFF if count > 1 else value
        s[b + st.OUTBOX_END] = n + count
        s[b + st.LEFT] = max(s[b + st.LEFT], now) + count * s[st.LINK_CYCLES]
        if ends or s[b + st.OUTBOX_END] + 4 > outbox.shape[1]:
            s[b + st.IN_PACKET] = 0
            return -2
        return -3
    d = st.CHANNEL + to * st.CHANNEL_ROW
    if value != PAUSE or count > 1:
        if s[d + st.TOKENS] + count > st.BUFFER_SIZE:
            return st.FOR_ROOM
        for place in range(count):
            _put(s, to, value >> 8 * (count - 1 - place) & 0xFF if count > 1 else value)
    if ends:
        s[b + st.IN_PACKET] = 0
        _release(s, to, now)
        absorb(s, inbox, to, now)
    poke(s, st.CHANNEL_0 + to, now)
    return -3


@part
def may_send(s: Any, t: int) -> bool:
    """Whether a thread that paused for a claim or for room can send."""
    b = st.THREAD + t * st.THREAD_ROW
    d = st.CHANNEL + (s[b + st.ON] - st.CHANNEL_0) * st.CHANNEL_ROW
    if s[b + st.WHY] == st.FOR_ROOM:
        return s[d + st.TOKENS] + s[b + st.NEED] <= st.BUFFER_SIZE
    if s[d + st.CLAIM] == st.NOWHERE:
        s[d + st.CLAIM] = s[b + st.SOURCE]
    return s[d + st.CLAIM] == s[b + st.SOURCE]
