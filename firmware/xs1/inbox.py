"""Tokens from outside into the inbox of a channel end: the fast way, compiled."""

from __future__ import annotations

from typing import Any

from ...base.compiling import kernel
from .state import CHANNEL, CHANNEL_ENDS, CHANNEL_ROW, CYCLE, INBOX_END, INBOX_FIRST

__all__ = ["enqueue"]

TOKEN = 0x1FF


@kernel
def enqueue(s: Any, inbox: Any, channel_end: int, tokens: Any, first: int, step: int) -> int:
    """Append tokens, if there is room and the first does not come too soon.

    Parameters
    ----------
    s : (SIZE,) int64
        State, as `state` describes it.
    inbox : (32, n) int64
        Tokens, and in bits 16 and higher their cycles.
    channel_end : int
    tokens : (k,) uint16
    first, step : int
        The cycle of the first of them, and from one to the next.

    Returns
    -------
    int
        How many were appended: all or none.
    """
    if not 0 <= channel_end < CHANNEL_ENDS:
        return -1
    row = CHANNEL + channel_end * CHANNEL_ROW
    at = s[row + INBOX_END]
    earliest = s[CYCLE] + 1
    if at > s[row + INBOX_FIRST]:
        earliest = max(earliest, inbox[channel_end, at - 1] >> 16)
    if first < earliest or at + len(tokens) > inbox.shape[1]:
        return -1
    for place in range(len(tokens)):
        inbox[channel_end, at + place] = first + place * step << 16 | int(tokens[place]) & TOKEN
    s[row + INBOX_END] = at + len(tokens)
    return len(tokens)
