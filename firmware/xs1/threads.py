# ruff: noqa: SIM109  # numba compiles a comparison with each of a few codes, not a search
# mypy: disable-error-code="no-any-return"
"""Instructions that start, join and end threads, for the core's kernel."""

from __future__ import annotations

from typing import Any

from . import state as st
from .compiled import part
from .resources import fault, find, free_thread, pause, signed, slot, used
from .settings import allocate

__all__ = ["act_on_threads"]

I_GETST, I_TINITPC, I_TINITSP, I_TINITDP, I_TINITCP, I_TINITLR = st.codes(
    "getst tinitpc tinitsp tinitdp tinitcp tinitlr"
)
I_TSTART, I_TSETR, I_TSETMR, I_MSYNC, I_MJOIN, I_SSYNC = st.codes("tstart tsetr tsetmr msync mjoin ssync")
I_FREET, I_GETID = st.codes("freet getid")


@part
def _start(s: Any, t: int, now: int) -> None:
    """Let a stopped or paused thread run from now on."""
    s[st.READY + t] = slot(s, t, now)
    s[st.STATE + t] = st.RUNNING


@part
def _all_stopped(s: Any, sync: int) -> bool:
    """Whether all threads of a synchroniser, but its master, wait in SSYNC."""
    for u in range(st.THREADS):
        if (
            s[st.STATE + u] != st.FREE
            and s[st.THREAD + u * st.THREAD_ROW + st.SYNC] == sync
            and s[st.STATE + u] != st.STOPPED
        ):
            return False
    return True


@part
def _release(s: Any, sync: int, ends: bool, now: int) -> None:
    """Let all threads of a synchroniser go on, or end them."""
    for u in range(st.THREADS):
        if s[st.STATE + u] == st.STOPPED and s[st.THREAD + u * st.THREAD_ROW + st.SYNC] == sync:
            if ends:
                free_thread(s, u)
            else:
                _start(s, u, now)


@part
def _synchronise(s: Any, t: int, now: int) -> None:
    """SSYNC: stop, until the master and the other threads have come."""
    s[st.STATE + t] = st.STOPPED
    s[st.READY + t] = st.NEVER
    sync = s[st.THREAD + t * st.THREAD_ROW + st.SYNC]
    if sync < 0 or not _all_stopped(s, sync):
        return
    master = s[st.MASTER + sync]
    b = st.THREAD + master * st.THREAD_ROW
    waits = s[st.STATE + master] == st.PAUSED and s[b + st.ON] == st.SYNC_0 + sync
    if waits and (s[b + st.WHY] == st.FOR_THREADS or s[b + st.WHY] == st.FOR_JOIN):
        _release(s, sync, s[b + st.WHY] == st.FOR_JOIN, now)
        s[b + st.PC] += 1  # MSYNC and MJOIN have one half word
        _start(s, master, now)


@part
def act_on_threads(
    s: Any, regs: Any, inbox: Any, t: int, now: int, op: int, a: int, b: int, imm: int, half: int,
) -> int:  # fmt: skip
    """Execute what concerns threads and synchronisers; `OTHER` if the instruction is none of these."""
    k, row = t * st.REGISTER_ROW, st.THREAD + t * st.THREAD_ROW
    va, vb = signed(regs[k + a]), signed(regs[k + b])
    # Threads
    if op == I_GETST:
        e = find(vb)
        if not st.SYNC_0 <= e < st.SYNC_0 + st.SYNCHRONISERS or not used(s, e):
            return fault(s, st.ILLEGAL_RESOURCE, vb)
        identifier = allocate(s, inbox, st.TYPE_THREAD, t, now)
        if identifier != 0:
            s[st.THREAD + (identifier >> 8) * st.THREAD_ROW + st.SYNC] = e - st.SYNC_0
        regs[k + a] = identifier
        return st.DONE
    if (
        op == I_TINITPC or op == I_TINITSP or op == I_TINITDP or op == I_TINITCP or op == I_TINITLR or op == I_TSTART
        or op == I_TSETR
    ):  # fmt: skip
        identifier = va if op == I_TSTART else vb
        if op == I_TSETR:
            identifier = signed(regs[k + imm])
        u = find(identifier) - st.THREAD_0
        if u < 0 or not used(s, st.THREAD_0 + u):
            return fault(s, st.ILLEGAL_RESOURCE, identifier)
        if op == I_TSETR:
            regs[u * st.REGISTER_ROW + a] = vb
            return st.DONE
        if s[st.STATE + u] != st.STOPPED or (op == I_TSTART and s[st.THREAD + u * st.THREAD_ROW + st.SYNC] >= 0):
            return fault(s, st.ILLEGAL_RESOURCE, identifier)
        if op == I_TSTART:
            _start(s, u, now)
        elif op == I_TINITPC:
            start = (va - st.RAM) >> 1
            s[st.THREAD + u * st.THREAD_ROW + st.PC] = start if va & 1 == 0 and 0 <= start < st.HALVES else st.HALVES
            s[st.THREAD + u * st.THREAD_ROW + st.NEXT] = -1
        else:
            register = st.SP
            if op == I_TINITDP:
                register = st.SP - 1
            elif op == I_TINITCP:
                register = st.SP - 2
            elif op == I_TINITLR:
                register = st.SP + 1
            regs[u * st.REGISTER_ROW + register] = va
        return st.DONE
    if op == I_TSETMR:
        sync = s[row + st.SYNC]
        regs[(t if sync < 0 else s[st.MASTER + sync]) * st.REGISTER_ROW + a] = vb
        return st.DONE
    if op == I_MSYNC or op == I_MJOIN:
        e = find(va)
        if not st.SYNC_0 <= e < st.SYNC_0 + st.SYNCHRONISERS or not used(s, e):
            return fault(s, st.ILLEGAL_RESOURCE, va)
        s[st.MASTER + e - st.SYNC_0] = t
        if _all_stopped(s, e - st.SYNC_0):
            _release(s, e - st.SYNC_0, op == I_MJOIN, now)
            return st.DONE
        pause(s, t, st.FOR_JOIN if op == I_MJOIN else st.FOR_THREADS, e, st.NEVER)
        return st.PAUSE
    if op == I_SSYNC:
        s[row + st.PC] = half
        _synchronise(s, t, now)
        return st.GONE
    if op == I_FREET:
        free_thread(s, t)
        return st.GONE
    if op == I_GETID:
        regs[k + 11] = t
        return st.DONE
    return st.OTHER
