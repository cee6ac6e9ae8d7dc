"""The compiled loop of `links`: every token of a message over every link. It checks nothing of what it is given."""

from __future__ import annotations

from typing import Any

from ...base.compiling import kernel

__all__ = ["carry"]


@kernel
def carry(
    path: Any,
    header: int,
    tokens: int,
    at: int,
    hop_cycles: int,
    credit_cycles: int,
    never: int,
    cycles: Any,
    stuck: Any,
    busy: Any,
    freed: Any,
    passed: Any,
    spans: Any,
) -> int:
    """Let the tokens of a message pass, and return the cycle at which its receiver has taken the last one.

    A *place* is a link together with the buffer behind it, or a channel end with its buffer.

    Parameters
    ----------
    path : (m,) int64
        The places that it passes: links, and at the end one that is no link.
    header : int
        Tokens at its beginning that the last switch takes off.
    tokens, at : int
        How many there are, and the cycle from which on they may leave.
    hop_cycles, credit_cycles : int
        Delay of a switch, and of a credit.
    never : int
        A cycle that never comes.
    cycles : (n,) int64
        Core cycles per token, of the links.
    stuck : (p,) bool
        Places from which nothing goes on.
    busy : (p,) int64
        When each place's last token has passed into it. Brought up to date.
    freed : (p, 8) int64
        When each place in a buffer was left; the token that passes as number k has place k mod 8. Brought up to date.
    passed : (p,) int64
        Tokens that passed so far. Brought up to date.
    spans : (m, 2) int64
        Output: when the first token began to pass into each place, and the last one has.
    """
    room = freed.shape[1]
    last = path.size - 1
    spans[:] = never
    taken = never
    for token in range(tokens):
        came = at
        step = 0
        for stage in range(last + 1):
            here = path[stage]
            stored = stage < last or token >= header
            begins = busy[here]
            if stored:
                begins = max(begins, freed[here, passed[here] % room] + credit_cycles)
            before = path[max(stage - 1, 0)]
            if stage == 0:
                step = cycles[here]
                begins = max(begins, at)
            else:
                # A channel end takes tokens as fast as they came. A symbol goes on one delay after it came, so that the
                # first and the last of a token are no sooner there than that.
                onward = cycles[here] if stage < last else step
                begins = max(begins, freed[before, (passed[before] - 1) % room], came + hop_cycles - min(step, onward))
                step = onward
            ends = min(begins + step, never)
            busy[here] = ends
            if stage > 0:
                freed[before, passed[before] % room] = ends
                passed[before] += 1
            if ends == never:
                break
            if token == 0:
                spans[stage, 0] = begins
            if token == tokens - 1:
                spans[stage, 1] = ends
            if stuck[here] or stage == last:
                left = never if stuck[here] else ends
                if stored:
                    freed[here, passed[here] % room] = left
                    passed[here] += 1
                if token == tokens - 1:
                    taken = left
                break
            came = ends
    return taken
