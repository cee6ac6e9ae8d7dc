# ruff: noqa: SIM109  # numba compiles a comparison with each of a few codes, not a search
# mypy: disable-error-code="no-any-return"
"""Instructions that act on resources, threads and the kernel, for the core's kernel.

They are executed in order of time, one at a time, whichever way the other instructions go. Events and the kernel are
here, the rest in `transfers`, `settings` and `threads`.
"""

from __future__ import annotations

from typing import Any

from . import state as st
from .compiled import part
from .ports import update
from .resources import disable, due_event, enable, fault, find, own, pause, signed, take_event, used
from .settings import set_up
from .threads import act_on_threads
from .transfers import transfer

__all__ = ["act"]

I_WAITEU, I_WAITET, I_WAITEF, I_EEU, I_EDU, I_EET = st.codes("waiteu waitet waitef eeu edu eet")
I_EEF, I_SETV, I_SETEV, I_CLRE, I_SETSR, I_CLRSR = st.codes("eef setv setev clre setsr clrsr")
I_ECALLT, I_ECALLF, I_KCALL, I_KCALLI, I_KRET, I_SETKEP = st.codes("ecallt ecallf kcall kcalli kret setkep")
I_GETED, I_GETET, I_GETKEP, I_GETKSP, I_LDSPC, I_LDSSR = st.codes("geted getet getkep getksp ldspc ldssr")
I_LDSED, I_LDET, I_STSPC, I_STSSR, I_STSED, I_STET = st.codes("ldsed ldet stspc stssr stsed stet")
I_KENTSP, I_KRESTSP, I_GETPS, I_SETPS = st.codes("kentsp krestsp getps setps")


@part
def _processor_state(identifier: int) -> int:
    """The place of a register of the processor state, or -1."""
    number = identifier >> 8
    if identifier & 0xFF != st.TYPE_PS or number >= st.PROCESSOR_REGISTERS:
        return -1
    if number <= 0xD or 0x10 <= number <= 0x18 or 0x20 <= number <= 0x27 or number >= 0x30:
        return number
    return -1


@part
def _is_address(address: int) -> bool:
    return address & 0xFFFF0003 == st.RAM


@part
def act(
    s: Any, regs: Any, memory: Any, processor: Any, inbox: Any, outbox: Any, pins: Any, log: Any, t: int, now: int,
    op: int, a: int, b: int, imm: int, half: int,
) -> int:  # fmt: skip
    """Execute an instruction that acts on a resource, a thread or the kernel.

    Parameters
    ----------
    s, regs, inbox, outbox, pins, log : arrays
        As `core` describes them.
    memory : (16384,) uint32
    processor : (PROCESSOR_REGISTERS,) int64
        Registers of the processor state.
    t, now : int
        Thread and cycle.
    op, a, b, imm : int
        Code and operands.
    half : int
        The half word after the instruction.

    Returns
    -------
    int
        DONE; PAUSE, to try again later; TRAP, for the reason in the state; JUMP, to a place in the state; SENT, if a
        message is complete; GONE, if the thread does not run any more.
    """
    k, row = t * st.REGISTER_ROW, st.THREAD + t * st.THREAD_ROW
    va, vb = signed(regs[k + a]), signed(regs[k + b])
    result = transfer(s, regs, inbox, outbox, pins, log, t, now, op, a, b, imm)
    if result != st.OTHER:
        return result
    result = set_up(s, regs, inbox, pins, log, t, now, op, a, b, imm)
    if result != st.OTHER:
        return result
    result = act_on_threads(s, regs, inbox, t, now, op, a, b, imm, half)
    if result != st.OTHER:
        return result
    # Events
    if op == I_WAITEU or op == I_WAITET or op == I_WAITEF:
        if (op == I_WAITET and va == 0) or (op == I_WAITEF and va != 0):
            return st.DONE
        regs[k + st.SR] |= st.EEBLE
        e, again = due_event(s, regs, inbox, pins, log, t, now)
        if e >= 0:
            s[row + st.PC] = half - 1
            take_event(s, regs, t, e)
            return st.JUMP
        pause(s, t, st.FOR_EVENT, -1, again)
        return st.PAUSE
    if op == I_EEU or op == I_EDU or op == I_EET or op == I_EEF or op == I_SETV or op == I_SETEV:
        identifier = vb if op == I_EET or op == I_EEF else va
        e = find(identifier)
        if not 0 <= e < st.EVENTABLE or not used(s, e):
            return fault(s, st.ILLEGAL_RESOURCE, identifier)
        if e >= st.PORT_0:
            update(s, regs, pins, log, e - st.PORT_0, now)
        own(s, e, t)
        r = st.RESOURCE + e * st.RESOURCE_ROW
        if op == I_SETV:
            s[r + st.VECTOR] = signed(regs[k + 11]) >> 1 & 0x7FFF
        elif op == I_SETEV:
            s[r + st.ENVIRONMENT] = signed(regs[k + 11]) & 0xFFFF | st.RAM
        elif op == I_EEU or (op == I_EET and va != 0) or (op == I_EEF and va == 0):
            enable(s, e)
        else:
            disable(s, e)
        return st.DONE
    if op == I_CLRE:
        regs[k + st.SR] = signed(regs[k + st.SR]) & ~(st.EEBLE | st.INENB)
        for e in range(st.EVENTABLE):
            r = st.RESOURCE + e * st.RESOURCE_ROW
            if s[r + st.ENABLED] != 0 and s[r + st.OWNER] == t and s[r + st.INTERRUPT] == 0:
                disable(s, e)
        return st.DONE
    if op == I_SETSR:
        regs[k + st.SR] |= imm & 0xFF
        return st.DONE
    if op == I_CLRSR:
        regs[k + st.SR] = signed(regs[k + st.SR]) & ~imm
        return st.DONE
    # The kernel
    if op == I_ECALLT or op == I_ECALLF:
        return fault(s, st.ECALL, 0) if (va != 0) == (op == I_ECALLT) else st.DONE
    if op == I_KCALL or op == I_KCALLI:
        return fault(s, st.KCALL, va if op == I_KCALL else imm)
    if op == I_KRET:
        start = signed(regs[k + st.SPC])
        regs[k + st.SR] = signed(regs[k + st.SSR]) & ~st.WAITING
        regs[k + st.ED] = regs[k + st.SED]
        if start & 1 or not st.RAM <= start < st.RAM + 2 * st.HALVES:
            return fault(s, st.ILLEGAL_PC, start)
        s[row + st.PC] = (start - st.RAM) >> 1
        s[row + st.NEXT] = -1
        return st.JUMP
    if op == I_SETKEP:
        regs[k + st.KEP] = signed(regs[k + 11]) & ~0x7F
        return st.DONE
    if op == I_GETED or op == I_GETET or op == I_GETKEP or op == I_GETKSP:
        source = st.ED
        if op == I_GETET:
            source = st.ET
        elif op == I_GETKEP:
            source = st.KEP
        elif op == I_GETKSP:
            source = st.KSP
        regs[k + 11] = regs[k + source]
        return st.DONE
    if (
        op == I_LDSPC or op == I_LDSSR or op == I_LDSED or op == I_LDET or op == I_STSPC or op == I_STSSR
        or op == I_STSED or op == I_STET
    ):  # fmt: skip
        register, words = st.SPC, 1
        if op == I_LDSSR or op == I_STSSR:
            register, words = st.SSR, 2
        elif op == I_LDSED or op == I_STSED:
            register, words = st.SED, 3
        elif op == I_LDET or op == I_STET:
            register, words = st.ET, 4
        address = (signed(regs[k + st.SP]) + 4 * words) & 0xFFFFFFFF
        if not _is_address(address):
            return fault(s, st.LOAD_STORE, address)
        place = (address - st.RAM) >> 2
        if op == I_LDSPC or op == I_LDSSR or op == I_LDSED or op == I_LDET:
            regs[k + register] = memory[place]
        else:
            memory[place] = regs[k + register]
        return st.DONE
    if op == I_KENTSP:
        address = signed(regs[k + st.KSP])
        if not _is_address(address):
            return fault(s, st.LOAD_STORE, address)
        memory[(address - st.RAM) >> 2] = regs[k + st.SP]
        regs[k + st.SP] = address - imm
        return st.DONE
    if op == I_KRESTSP:
        address = (signed(regs[k + st.SP]) + imm) & 0xFFFFFFFF
        if not _is_address(address):
            return fault(s, st.LOAD_STORE, address)
        regs[k + st.SP] = memory[(address - st.RAM) >> 2]
        regs[k + st.KSP] = address
        return st.DONE
    if op == I_GETPS or op == I_SETPS:
        place = _processor_state(vb)
        if place < 0 or (op == I_SETPS and place == 0):
            return fault(s, st.ILLEGAL_PS, vb)
        if op == I_GETPS:
            regs[k + a] = processor[place]
        else:
            processor[place] = va
        return st.DONE
    return fault(s, st.ILLEGAL_INSTRUCTION, 0)
