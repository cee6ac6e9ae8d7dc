# ruff: noqa: SIM109  # numba compiles a comparison with each of a few numbers, not a search
# mypy: disable-error-code="no-any-return"
"""Channel ends, for the core's kernel.

Tokens of a channel end come from two sides: from threads of this core, which pause if the buffer is full, and from the
inbox, which Python fills with tokens and their times. Tokens to other nodes, and to switches, go into the outbox of
their channel end until a message is complete.
"""

from __future__ import annotations

from typing import Any

from .compiled import part
from .state import (
    BEGAN,
    BUFFER,
    BUFFER_SIZE,
    CHANNEL,
    CHANNEL_0,
    CHANNEL_ENDS,
    CHANNEL_ROW,
    CLAIM,
    CONTROL,
    DESTINATION,
    ELSEWHERE,
    ENABLED,
    FIRST,
    FOR_CLAIM,
    FOR_LINK,
    FOR_ROOM,
    HELD_UP,
    IN_PACKET,
    INBOX_END,
    INBOX_FIRST,
    INBOX_SEEN,
    LEFT,
    LINK_CYCLES,
    NEED,
    NEVER,
    NODE,
    NOWHERE,
    ON,
    ORDER,
    OUTBOX_END,
    OUTSIDE,
    OWNER,
    PAUSED,
    READY,
    RESOURCE,
    RESOURCE_ROW,
    SOURCE,
    STATE,
    THREAD,
    THREAD_ROW,
    THREADS,
    THROWN_AWAY,
    TO,
    TOKENS,
    TYPE_CHANNEL,
    USED,
    WHY,
)

__all__ = [
    "absorb", "clear", "may_send", "poke", "room_after", "send", "take", "token_at", "word_after", "word_is_there",
]  # fmt: skip

END, PAUSE = CONTROL | 1, CONTROL | 2


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
    r = RESOURCE + e * RESOURCE_ROW
    owner = s[r + OWNER] if s[r + ENABLED] != 0 else -1
    for u in range(THREADS):
        if s[STATE + u] == PAUSED and (u == owner or s[THREAD + u * THREAD_ROW + ON] == e):
            s[READY + u] = min(s[READY + u], now)


@part
def clear(s: Any, inbox: Any, d: int, now: int) -> None:
    """Make a channel end as new; tokens that came before are lost."""
    b = CHANNEL + d * CHANNEL_ROW
    s[b + DESTINATION] = 0
    s[b + IN_PACKET] = 0
    s[b + TO] = NOWHERE
    s[b + CLAIM] = NOWHERE
    s[b + TOKENS] = 0
    s[b + OUTBOX_END] = 0
    while s[b + INBOX_FIRST] < s[b + INBOX_END] and inbox[d, s[b + INBOX_FIRST]] >> 16 <= now:
        s[b + INBOX_FIRST] += 1
    s[b + INBOX_SEEN] = max(s[b + INBOX_SEEN], s[b + INBOX_FIRST])


@part
def _release(s: Any, d: int, now: int) -> None:
    """End a packet to a channel end: the thread that waits longest may begin its own."""
    chosen = -1
    for u in range(THREADS):
        t = THREAD + u * THREAD_ROW
        waits = s[STATE + u] == PAUSED and s[t + WHY] == FOR_CLAIM and s[t + ON] == CHANNEL_0 + d
        if waits and (chosen < 0 or s[t + ORDER] < s[THREAD + chosen * THREAD_ROW + ORDER]):
            chosen = u
    s[CHANNEL + d * CHANNEL_ROW + CLAIM] = NOWHERE
    if chosen >= 0:
        s[CHANNEL + d * CHANNEL_ROW + CLAIM] = s[THREAD + chosen * THREAD_ROW + SOURCE]
        s[READY + chosen] = min(s[READY + chosen], now)


@part
def _put(s: Any, d: int, token: int) -> None:
    b = CHANNEL + d * CHANNEL_ROW
    s[b + BUFFER + ((s[b + FIRST] + s[b + TOKENS]) & 7)] = token
    s[b + TOKENS] += 1


@part
def absorb(s: Any, inbox: Any, d: int, now: int) -> None:
    """Take tokens from outside into the buffer, as far as they have come and there is room.

    Parameters
    ----------
    s : (n,) int64
        State of the core.
    inbox : (32, n) int64
        For each channel end tokens, with their cycles in the bits from 16 on.
    d : int
        Number of the channel end.
    now : int
        Cycle.
    """
    b = CHANNEL + d * CHANNEL_ROW
    end = s[b + INBOX_END]
    if s[b + INBOX_FIRST] == end:
        return
    while s[b + INBOX_FIRST] < end and inbox[d, s[b + INBOX_FIRST]] >> 16 <= now:
        if s[RESOURCE + (CHANNEL_0 + d) * RESOURCE_ROW + USED] == 0:
            s[b + INBOX_FIRST] += 1
            s[b + INBOX_SEEN] = max(s[b + INBOX_SEEN], s[b + INBOX_FIRST])
            continue
        claim = s[b + CLAIM]
        if s[b + TOKENS] == BUFFER_SIZE or (claim != NOWHERE and claim != OUTSIDE):
            break
        token = inbox[d, s[b + INBOX_FIRST]] & 0x1FF
        s[b + INBOX_FIRST] += 1
        s[b + INBOX_SEEN] = max(s[b + INBOX_SEEN], s[b + INBOX_FIRST])
        if token != PAUSE:
            _put(s, d, token)
        if token == END or token == PAUSE:
            _release(s, d, now)
        else:
            s[b + CLAIM] = OUTSIDE
    while s[b + INBOX_SEEN] < end and inbox[d, s[b + INBOX_SEEN]] >> 16 <= now:
        s[HELD_UP] += 1
        s[b + INBOX_SEEN] += 1


@part
def token_at(s: Any, d: int, place: int) -> int:
    """A token of the buffer, which is left there."""
    b = CHANNEL + d * CHANNEL_ROW
    return s[b + BUFFER + ((s[b + FIRST] + place) & 7)]


@part
def take(s: Any, inbox: Any, d: int, count: int, now: int) -> None:
    """Remove tokens from the front of the buffer."""
    b = CHANNEL + d * CHANNEL_ROW
    s[b + FIRST] = (s[b + FIRST] + count) & 7
    s[b + TOKENS] -= count
    absorb(s, inbox, d, now)
    if s[b + CLAIM] >= 0:
        poke(s, CHANNEL_0 + d, now)


@part
def word_is_there(s: Any, d: int) -> int:
    """Whether four tokens are there, or a control token among fewer: 1 to 4 is its place, 0 for none, -1 to wait."""
    count = min(s[CHANNEL + d * CHANNEL_ROW + TOKENS], 4)
    for place in range(count):
        if token_at(s, d, place) >= CONTROL:
            return place + 1
    return 0 if count == 4 else -1


@part
def word_after(s: Any, inbox: Any, d: int, now: int) -> int:
    """When a word, or a control token in its place, will be there, as far as is known."""
    b = CHANNEL + d * CHANNEL_ROW
    count = s[b + TOKENS]
    for place in range(s[b + INBOX_FIRST], s[b + INBOX_END]):
        count += 1
        if count == 4 or inbox[d, place] & CONTROL:
            return max(now + 1, inbox[d, place] >> 16)
    return NEVER


@part
def room_after(s: Any, c: int, count: int) -> int:
    """When the link of a channel end has room for some tokens; now or earlier if it has."""
    return s[CHANNEL + c * CHANNEL_ROW + LEFT] - (BUFFER_SIZE - count) * s[LINK_CYCLES]


@part
def send(s: Any, outbox: Any, inbox: Any, c: int, value: int, count: int, now: int) -> int:
    """Send a token, or the four of a word.

    Parameters
    ----------
    s : (n,) int64
        State of the core.
    outbox : (32, n) int64
        For each channel end the tokens of its message to elsewhere.
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
    b = CHANNEL + c * CHANNEL_ROW
    ends = count == 1 and (value == END or value == PAUSE)
    to = s[b + TO]
    if s[b + IN_PACKET] == 0:
        destination = s[b + DESTINATION]
        if destination == 0:
            return -1
        if destination & 0xFF != TYPE_CHANNEL or destination >> 16 != s[NODE]:
            to = ELSEWHERE
            s[b + BEGAN] = now
        else:
            to = destination >> 8 & 0xFF
            if to >= CHANNEL_ENDS or s[RESOURCE + (CHANNEL_0 + to) * RESOURCE_ROW + USED] == 0:
                to = THROWN_AWAY
            else:
                absorb(s, inbox, to, now)
                d = CHANNEL + to * CHANNEL_ROW
                if s[d + CLAIM] != NOWHERE and s[d + CLAIM] != c:
                    s[b + TO] = to
                    return FOR_CLAIM
                s[d + CLAIM] = c
        s[b + TO] = to
        s[b + IN_PACKET] = 1
    if to == THROWN_AWAY:
        s[b + IN_PACKET] = 0 if ends else 1
        return -3
    if to == ELSEWHERE:
        if room_after(s, c, count) > now:
            return FOR_LINK
        n = s[b + OUTBOX_END]
        for place in range(count):
            outbox[c, n + place] = value >> 8 * (count - 1 - place) & 0xFF if count > 1 else value
        s[b + OUTBOX_END] = n + count
        s[b + LEFT] = max(s[b + LEFT], now) + count * s[LINK_CYCLES]
        if ends or s[b + OUTBOX_END] + 4 > outbox.shape[1]:
            s[b + IN_PACKET] = 0
            return -2
        return -3
    d = CHANNEL + to * CHANNEL_ROW
    if value != PAUSE or count > 1:
        if s[d + TOKENS] + count > BUFFER_SIZE:
            return FOR_ROOM
        for place in range(count):
            _put(s, to, value >> 8 * (count - 1 - place) & 0xFF if count > 1 else value)
    if ends:
        s[b + IN_PACKET] = 0
        _release(s, to, now)
        absorb(s, inbox, to, now)
    poke(s, CHANNEL_0 + to, now)
    return -3


@part
def may_send(s: Any, t: int) -> bool:
    """Whether a thread that paused for a claim or for room can send."""
    b = THREAD + t * THREAD_ROW
    d = CHANNEL + (s[b + ON] - CHANNEL_0) * CHANNEL_ROW
    if s[b + WHY] == FOR_ROOM:
        return s[d + TOKENS] + s[b + NEED] <= BUFFER_SIZE
    if s[d + CLAIM] == NOWHERE:
        s[d + CLAIM] = s[b + SOURCE]
    return s[d + CLAIM] == s[b + SOURCE]
