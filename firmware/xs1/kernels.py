# ruff: noqa: SIM109  # numba compiles a comparison with each of a few codes, not a search
"""The core's kernel: thread scheduler and instructions, compiled. Python is entered only if something needs it.

`run` chooses the thread that is ready first and executes its instructions. In bursts a thread goes on until it comes to
an instruction that acts on something which other threads can see, or until it is `AHEAD` cycles ahead; in lockstep it
executes one instruction. Both give the same result if threads share memory across synchronising instructions only:
every thread has a slot of its own among `ISSUE` cycles, so that none delays another, and what acts on resources is
executed in order of time. If more threads are in use than have slots, the kernel goes in lockstep by itself.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from . import state as st
from .actions import act
from .compiled import kernel, part
from .instructions import BY_NAME, INSTRUCTIONS, Effect
from .ports import bring_up, free_after, update
from .resources import due_event, enter, find_port, pause, slot, take_event, wake

__all__ = ["flush", "run"]

int32: Any = np.int32
int64: Any = np.int64
uint64: Any = np.uint64

ACCESSES = np.zeros(256, np.bool_)
"""Of each code whether it accesses memory, so that no instructions can be fetched at that time."""
ACCESSES[[code for code, i in enumerate(INSTRUCTIONS) if i.effect in (Effect.LOAD, Effect.STORE)]] = True
ACCESSES[[BY_NAME[name] for name in ("retsp", "blat", "blacp")]] = True

STWI, LDWI, ADD, SUB, SHL, SHR, EQ, AND = st.codes("stwi ldwi add sub shl shr eq and")
OR, LDW, LD16S, LD8U, ADDI, SUBI, SHLI, SHRI, EQI = st.codes("or ldw ld16s ld8u addi subi shli shri eqi")
LSS, LSU, ANDNOT, SEXT, SEXTI, ZEXT, ZEXTI, NOT, NEG = st.codes("lss lsu andnot sext sexti zext zexti not neg")
MKMSK, MKMSKI, BLAR, BAU, BRU, SETSP, SETDP, SETCP = st.codes("mkmsk mkmski blar bau bru setsp setdp setcp")
STWDP, STWSP, LDWDP, LDWSP, LDAWDP, LDAWSP, LDC, LDWCP = st.codes("stwdp stwsp ldwdp ldwsp ldawdp ldawsp ldc ldwcp")
BRFT, BRBT, BRFF, BRBF, BRFU, BRBU, BLAT, BLACP = st.codes("brft brbt brff brbf brfu brbu blat blacp")
EXTDP, EXTSP, ENTSP, RETSP, GETSR, LDAWCP, LDWCPL = st.codes("extdp extsp entsp retsp getsr ldawcp ldwcpl")
BLRF, BLRB, LDAPF, LDAPB, STWL, ST16, ST8, XOR, ASHR = st.codes("blrf blrb ldapf ldapb stwl st16 st8 xor ashr")
LDAWF, LDAWB, LDAWFI, LDAWBI, LDA16F, LDA16B, ASHRI = st.codes("ldawf ldawb ldawfi ldawbi lda16f lda16b ashri")
MUL, DIVS, DIVU, REMS, REMU, CRC32, CRC8, BITREV = st.codes("mul divs divu rems remu crc32 crc8 bitrev")
BYTEREV, CLZ, MACCU, MACCS, LDIVU, LADD, LSUB, LMUL = st.codes("byterev clz maccu maccs ldivu ladd lsub lmul")
(OUT,) = st.codes("out")

WORD = 0xFFFFFFFF


@part
def _forget(code: Any, address: int) -> None:
    """Have the half words around a word that was stored decoded again."""
    half = (address - st.RAM) >> 1 & ~1
    code[half - 1 if half > 0 else 0] = st.NOT_DECODED
    code[half] = st.NOT_DECODED
    code[half + 1] = st.NOT_DECODED


@part
def _crc(checksum: int, data: int, bits: int, polynomial: int) -> int:
    """Shift bits of data into a checksum, the lowest first."""
    for _ in range(bits):
        low = checksum & 1
        checksum = checksum >> 1 | (data & 1) << 31
        data >>= 1
        if low != 0:
            checksum ^= polynomial
    return checksum


@part
def _reversed_bits(value: int) -> int:
    result = 0
    for _ in range(32):
        result = result << 1 | value & 1
        value >>= 1
    return result


@part
def _leading_zeros(value: int) -> int:
    count = 32
    while value != 0:
        value >>= 1
        count -= 1
    return count


@part
def _extended(value: int, bits: int, signed: bool) -> int:
    """SEXT and ZEXT, which leave a value alone if it has fewer bits than that."""
    if bits == 0 or bits > 31:
        return value
    value &= (1 << bits) - 1
    return value - (value >> (bits - 1) << bits) if signed else value


@part
def _high_product(a: int, b: int) -> tuple[int, int]:
    """The product of two unsigned words, as its high and its low word."""
    low = (a & 0xFFFF) * b
    high = (a >> 16) * b + (low >> 16)
    return high >> 16, (high & 0xFFFF) << 16 | low & 0xFFFF


@part
def flush(s: Any, regs: Any, pins: Any, log: Any, now: int) -> None:
    """Bring watched ports up to a cycle, so that the log is complete."""
    for p in range(st.PORTS):
        if s[st.PORT + p * st.PORT_ROW + st.WATCHED] != 0:
            update(s, regs, pins, log, p, now)


@kernel
def run(
    s: Any, regs: Any, bytes_: Any, halves: Any, words: Any, code: Any, marks: Any, processor: Any, inbox: Any,
    outbox: Any, pins: Any, log: Any, profile: Any, until: int,
) -> int:  # fmt: skip
    """Execute instructions up to a cycle, this cycle included, or until Python must do something.

    Parameters
    ----------
    s : (SIZE,) int64
        State, as `state` describes it; changed, as all arrays but `inbox` and `pins` are.
    regs : (THREADS * REGISTER_ROW,) uint32
        Registers of all threads.
    bytes_, halves, words : uint8, int16 and uint32
        Three views of the memory.
    code : (HALVES + 2,) int64
        Decoded instructions: code, operands from bit 8 on, 4 bits each, LONG, and the immediate from bit 32 on.
    marks : (HALVES // 2,) uint8
        Whether each word of memory may be in `code`.
    processor : (PROCESSOR_REGISTERS,) int64
        Registers of the processor state.
    inbox, outbox : (32, n) int64
        Tokens of channel ends from and to outside.
    pins : (32, n, 2) int64
        Cycles and values of input pins.
    log : (n, 3) int64
        Ports, cycles and values of watched pins.
    profile : (HALVES,) int64
        How many times each instruction was executed, if PROFILED.
    until : int
        Cycle.

    Returns
    -------
    int
        REACHED, MESSAGE, UNHANDLED, LOG_FULL or UNDECODED.
    """
    period = s[st.ISSUE]
    pessimistic, profiled, lockstep = s[st.PESSIMISTIC] != 0, s[st.PROFILED] != 0, s[st.LOCKSTEP] != 0
    ahead = s[st.AHEAD]
    count = 0
    stop = st.REACHED
    full = log.shape[0] - st.LOG_MARGIN
    cycle = until
    for t in range(st.THREADS):
        if s[st.STATE + t] == st.PAUSED:  # something may have come from outside
            s[st.READY + t] = min(s[st.READY + t], s[st.CYCLE] + 1)
    while True:
        t, now, other = int64(0), s[st.READY], st.NEVER  # for a plain 0 numba compiles every callee once more
        for u in range(1, st.THREADS):
            time = s[st.READY + u]
            if time < now:
                other = now
                now = time
                t = u
            elif time < other:
                other = time
        if now > until:
            break
        if s[st.LOGGED] >= full:
            stop = st.LOG_FULL
            cycle = now - 1
            break
        row, k = st.THREAD + t * st.THREAD_ROW, t * st.REGISTER_ROW
        if s[st.STATE + t] != st.RUNNING:
            if s[row + st.WHY] == st.FOR_OUTPUT and regs[k + st.SR] & (st.EEBLE | st.IEBLE) == 0:
                p = s[row + st.ON] - st.PORT_0
                if not bring_up(s, log, p, now) or s[st.PORT + p * st.PORT_ROW + st.FULL] != 0:
                    wake(s, regs, inbox, pins, log, t, now)
                    continue
                s[st.READY + t] = slot(s, t, now)
                s[st.STATE + t] = st.RUNNING
                if s[st.READY + t] != now:
                    continue
            else:
                wake(s, regs, inbox, pins, log, t, now)
                continue
        general = s[st.USED_THREADS] > period
        if general and now <= s[st.LAST]:
            now = s[st.LAST] + 1
            if now > until:
                break
        bound = now
        if regs[k + st.SR] & (st.EEBLE | st.IEBLE):
            event, _ = due_event(s, regs, inbox, pins, log, t, now)
            if event >= 0:
                take_event(s, regs, t, event)
        elif not (lockstep or general):
            bound = min(until, now + ahead)
        r = regs[k : k + st.REGISTER_ROW]
        i = s[row + st.PC]
        fetched, following = s[row + st.FETCHED], s[row + st.NEXT]
        start = now
        while now <= bound:
            w = code[i]
            op, a, b, c, imm = w & 255, w >> 8 & 15, w >> 12 & 15, w >> 16 & 15, w >> 32
            n = i + 1 + (w >> 28 & 1)
            if pessimistic:
                if i != following:
                    fetched = (i | 1) + 1
                    following = i
                if fetched < n:
                    stalls = (n - fetched + 1) >> 1
                    fetched += 2 * stalls
                    now += stalls * period
                    continue
            fault, data = 0, 0
            took = period
            if op == ADD:
                r[a] = r[b] + r[c]
            elif op == ADDI:
                r[a] = r[b] + imm
            elif op == SUB:
                r[a] = r[b] - r[c]
            elif op == SUBI:
                r[a] = r[b] - imm
            elif op == EQ:
                r[a] = r[b] == r[c]
            elif op == EQI:
                r[a] = r[b] == imm
            elif op == LSS:
                r[a] = int32(r[b]) < int32(r[c])
            elif op == LSU:
                r[a] = r[b] < r[c]
            elif op == AND:
                r[a] = r[b] & r[c]
            elif op == OR:
                r[a] = r[b] | r[c]
            elif op == XOR:
                r[a] = r[b] ^ r[c]
            elif op == ANDNOT:
                r[a] = r[a] & ~r[b]
            elif op == NOT:
                r[a] = ~r[b]
            elif op == NEG:
                r[a] = -int64(r[b])
            elif op == SHL:
                r[a] = int64(r[b]) << r[c] if r[c] < 32 else 0
            elif op == SHLI:
                r[a] = int64(r[b]) << imm
            elif op == SHR:
                r[a] = int64(r[b]) >> r[c] if r[c] < 32 else 0
            elif op == SHRI:
                r[a] = int64(r[b]) >> imm
            elif op == ASHR:
                r[a] = int64(int32(r[b])) >> min(int64(r[c]), 32)
            elif op == ASHRI:
                r[a] = int64(int32(r[b])) >> imm
            elif op == MUL:
                r[a] = r[b] * r[c]
            elif op == LDC:
                r[a] = imm
            elif op == LDW:
                data = r[b] + 4 * int64(r[c])
                if data & 0xFFFF0003 == st.RAM:
                    r[a] = words[data >> 2 & 0x3FFF]
                else:
                    fault = st.LOAD_STORE
            elif op == LDWI:
                data = r[b] + imm
                if data & 0xFFFF0003 == st.RAM:
                    r[a] = words[data >> 2 & 0x3FFF]
                else:
                    fault = st.LOAD_STORE
            elif op == LDWSP:
                data = r[st.SP] + imm
                if data & 0xFFFF0003 == st.RAM:
                    r[a] = words[data >> 2 & 0x3FFF]
                else:
                    fault = st.LOAD_STORE
            elif op == LDWDP:
                data = r[st.DP] + imm
                if data & 0xFFFF0003 == st.RAM:
                    r[a] = words[data >> 2 & 0x3FFF]
                else:
                    fault = st.LOAD_STORE
            elif op == LDWCP or op == LDWCPL:
                data = r[st.CP] + imm
                if data & 0xFFFF0003 == st.RAM:
                    r[a if op == LDWCP else 11] = words[data >> 2 & 0x3FFF]
                else:
                    fault = st.LOAD_STORE
            elif op == LD16S:
                data = r[b] + 2 * int64(r[c])
                if data & 0xFFFF0001 == st.RAM:
                    r[a] = halves[data >> 1 & 0x7FFF]
                else:
                    fault = st.LOAD_STORE
            elif op == LD8U:
                data = r[b] + int64(r[c])
                if data & 0xFFFF0000 == st.RAM:
                    r[a] = bytes_[data & 0xFFFF]
                else:
                    fault = st.LOAD_STORE
            elif op == STWI or op == STWL or op == STWSP or op == STWDP:
                if op == STWI:
                    data = r[b] + imm
                elif op == STWL:
                    data = r[b] + 4 * int64(r[c])
                elif op == STWSP:
                    data = r[st.SP] + imm
                else:
                    data = r[st.DP] + imm
                if data & 0xFFFF0003 == st.RAM:
                    words[data >> 2 & 0x3FFF] = r[a]
                    if marks[data >> 2 & 0x3FFF]:
                        _forget(code, data & WORD)
                else:
                    fault = st.LOAD_STORE
            elif op == ST16:
                data = r[b] + 2 * int64(r[c])
                if data & 0xFFFF0001 == st.RAM:
                    halves[data >> 1 & 0x7FFF] = int64(r[a])
                    if marks[data >> 2 & 0x3FFF]:
                        _forget(code, data & WORD)
                else:
                    fault = st.LOAD_STORE
            elif op == ST8:
                data = r[b] + int64(r[c])
                if data & 0xFFFF0000 == st.RAM:
                    bytes_[data & 0xFFFF] = r[a]
                    if marks[data >> 2 & 0x3FFF]:
                        _forget(code, data & WORD)
                else:
                    fault = st.LOAD_STORE
            elif op == LDAWF:
                r[a] = r[b] + 4 * int64(r[c])
            elif op == LDAWB:
                r[a] = r[b] - 4 * int64(r[c])
            elif op == LDAWFI:
                r[a] = r[b] + imm
            elif op == LDAWBI:
                r[a] = r[b] - imm
            elif op == LDA16F:
                r[a] = r[b] + 2 * int64(r[c])
            elif op == LDA16B:
                r[a] = r[b] - 2 * int64(r[c])
            elif op == LDAWSP:
                r[a] = r[st.SP] + imm
            elif op == LDAWDP:
                r[a] = r[st.DP] + imm
            elif op == LDAWCP:
                r[11] = r[st.CP] + imm
            elif op == LDAPF or op == LDAPB:
                r[11] = st.RAM + 2 * (n + imm)
            elif op == BRFT or op == BRBT:
                if r[a] != 0:
                    n += imm
                    if n < 0 or n >= st.HALVES:
                        fault, data = st.ILLEGAL_PC, st.RAM + 2 * n
            elif op == BRFF or op == BRBF:
                if r[a] == 0:
                    n += imm
                    if n < 0 or n >= st.HALVES:
                        fault, data = st.ILLEGAL_PC, st.RAM + 2 * n
            elif op == BRFU or op == BRBU:
                n += imm
                if n < 0 or n >= st.HALVES:
                    fault, data = st.ILLEGAL_PC, st.RAM + 2 * n
            elif op == BLRF or op == BLRB:
                target = n + imm
                if target < 0 or target >= st.HALVES:
                    fault, data = st.ILLEGAL_PC, st.RAM + 2 * target
                else:
                    r[st.LR] = st.RAM + 2 * n
                    n = target
            elif op == BRU:
                data = st.RAM + 2 * (n + int64(int32(r[a])))
                n = (data & WORD) - st.RAM >> 1
                if n < 0 or n >= st.HALVES:
                    fault = st.ILLEGAL_PC
            elif op == BAU or op == BLAR:
                data = int64(r[a])
                if data & 1 or data & 0xFFFF0000 != st.RAM:
                    fault = st.ILLEGAL_PC
                else:
                    if op == BLAR:
                        r[st.LR] = st.RAM + 2 * n
                    n = (data - st.RAM) >> 1
            elif op == BLAT or op == BLACP:
                data = (r[11] if op == BLAT else r[st.CP]) + imm
                if data & 0xFFFF0003 == st.RAM:
                    data = int64(words[data >> 2 & 0x3FFF])
                    if data & 1 or data & 0xFFFF0000 != st.RAM:
                        fault = st.ILLEGAL_PC
                    else:
                        r[st.LR] = st.RAM + 2 * n
                        n = (data - st.RAM) >> 1
                else:
                    fault = st.LOAD_STORE
            elif op == RETSP:
                data = int64(r[st.LR])
                sp = int64(r[st.SP])
                if imm > 0:
                    sp = (sp + imm) & WORD
                    if sp & 0xFFFF0003 == st.RAM:
                        data = int64(words[sp >> 2 & 0x3FFF])
                    else:
                        fault, data = st.LOAD_STORE, sp
                if fault == 0:
                    if data & 1 or data & 0xFFFF0000 != st.RAM:
                        fault = st.ILLEGAL_PC
                    else:
                        r[st.LR] = data
                        r[st.SP] = sp
                        n = (data - st.RAM) >> 1
            elif op == ENTSP:
                if imm > 0:
                    data = int64(r[st.SP])
                    if data & 0xFFFF0003 == st.RAM:
                        words[data >> 2 & 0x3FFF] = r[st.LR]
                        if marks[data >> 2 & 0x3FFF]:
                            _forget(code, data)
                        r[st.SP] = data - imm
                    else:
                        fault = st.LOAD_STORE
            elif op == EXTSP:
                r[st.SP] = r[st.SP] - imm
            elif op == EXTDP:
                r[st.DP] = r[st.DP] - imm
            elif op == SETSP:
                r[st.SP] = r[a]
            elif op == SETDP:
                r[st.DP] = r[a]
            elif op == SETCP:
                r[st.CP] = r[a]
            elif op == GETSR:
                r[11] = r[st.SR] & imm
            elif op == ZEXTI or op == SEXTI:
                r[a] = _extended(int64(r[a]), imm, op == SEXTI)
            elif op == ZEXT or op == SEXT:
                r[a] = _extended(int64(r[a]), int64(r[b]), op == SEXT)
            elif op == MKMSKI:
                r[a] = (1 << imm) - 1
            elif op == MKMSK:
                r[a] = (1 << min(int64(r[b]), 32)) - 1
            elif op == CLZ:
                r[a] = _leading_zeros(int64(r[b]))
            elif op == BITREV:
                r[a] = _reversed_bits(int64(r[b]))
            elif op == BYTEREV:
                data = int64(r[b])
                r[a] = data >> 24 | data >> 8 & 0xFF00 | (data & 0xFF00) << 8 | (data & 0xFF) << 24
            elif op == CRC32:
                r[a] = _crc(int64(r[a]), int64(r[b]), 32, int64(r[c]))
            elif op == DIVU or op == REMU:
                took = st.DIVISION * period
                if r[c] == 0:
                    fault = st.ARITHMETIC
                elif op == DIVU:
                    r[a] = int64(r[b]) // int64(r[c])
                else:
                    r[a] = int64(r[b]) % int64(r[c])
            elif op == DIVS or op == REMS:
                took = st.DIVISION * period
                dividend, divisor = int64(int32(r[b])), int64(int32(r[c]))
                if divisor == 0 or (dividend == -0x80000000 and divisor == -1):
                    fault = st.ARITHMETIC
                else:
                    quotient = abs(dividend) // abs(divisor)
                    if (dividend < 0) != (divisor < 0):
                        quotient = -quotient
                    r[a] = quotient if op == DIVS else dividend - quotient * divisor
            elif op == LADD or op == LSUB or op == LMUL or op == LDIVU or op == CRC8 or op == MACCU or op == MACCS:
                d, e = w >> 20 & 15, w >> 24 & 15
                vb, vc, vd, ve = int64(r[b]), int64(r[c]), int64(r[d]), int64(r[e])
                if op == LADD:
                    data = vb + vc + (ve & 1)
                    r[d] = data >> 32
                    r[a] = data
                elif op == LSUB:
                    data = vb - vc - (ve & 1)
                    r[d] = data >> 32 & 1
                    r[a] = data
                elif op == CRC8:
                    vd = _crc(vd, vb & 0xFF, 8, vc)
                    r[d] = vd
                    r[a] = vb >> 8
                elif op == LDIVU:
                    took = st.DIVISION * period
                    if ve >= vc:
                        fault = st.ARITHMETIC
                    else:
                        dividend = uint64(ve) << uint64(32) | uint64(vb)
                        r[d] = dividend % uint64(vc)
                        r[a] = dividend // uint64(vc)
                elif op == MACCS:
                    total = int64(r[a]) << 32 | vd
                    total += int64(int32(r[b])) * int64(int32(r[c]))
                    r[d] = total
                    r[a] = total >> 32
                else:
                    high, low = _high_product(vb, vc)
                    if op == LMUL:
                        low += ve + int64(r[imm])
                    else:
                        low += vd
                        high += int64(r[a])
                    r[d] = low
                    r[a] = high + (low >> 32)
            elif op == OUT and find_port(int64(r[b])) >= 0:
                p = find_port(int64(r[b]))
                if now > start and now >= other:
                    break
                s[st.LAST] = now
                s[row + st.ISSUED] = now
                place = st.PORT + p * st.PORT_ROW
                owned = s[st.RESOURCE + (st.PORT_0 + p) * st.RESOURCE_ROW + st.OWNER] == t
                if owned and bring_up(s, log, p, now):
                    if s[place + st.FULL] != 0:
                        s[row + st.PC] = i
                        pause(s, t, st.FOR_OUTPUT, st.PORT_0 + p, free_after(s, place))
                        now = s[st.READY + t]
                        break
                    s[place + st.TRANSFER] = int64(r[a]) & (1 << s[place + st.TRANSFER_WIDTH]) - 1
                    s[place + st.FULL] = 1
                else:
                    s[row + st.PC] = i
                    did = act(s, regs, words, processor, inbox, outbox, pins, log, t, now, op, a, b, imm, n)
                    if did == st.PAUSE:
                        now = s[st.READY + t]
                        break
                    if did == st.TRAP:
                        fault, data = s[st.FAULT], s[st.FAULT_DATA]
            elif op == st.NOT_DECODED:
                s[st.UNDECODED_AT] = i
                stop = st.UNDECODED
                break
            elif op == st.OUTSIDE_RAM:
                fault, data = st.ILLEGAL_PC, st.RAM + 2 * i
            elif op > 251:
                fault = st.ILLEGAL_INSTRUCTION
            else:
                if now > start and now >= other:
                    break
                s[st.LAST] = now
                s[row + st.ISSUED] = now
                s[row + st.PC] = i
                did = act(s, regs, words, processor, inbox, outbox, pins, log, t, now, op, a, b, imm, n)
                if did == st.DONE or did == st.SENT:
                    if pessimistic:
                        following = n
                        if fetched - n <= 2:
                            fetched += 2
                    if profiled:
                        profile[i] += 1
                    count += 1
                    i = n
                    now += period
                    if did == st.SENT:
                        stop = st.MESSAGE
                        cycle = now - period
                    break
                if did == st.PAUSE:
                    now = s[st.READY + t]
                    break
                if did == st.TRAP:
                    fault, data = s[st.FAULT], s[st.FAULT_DATA]
                else:
                    if profiled:
                        profile[i] += 1
                    count += 1
                    following = -1
                    i = s[row + st.PC]
                    now = s[st.READY + t] if did == st.GONE else now + period
                    break
            if fault != 0:
                data &= WORD
                n = enter(regs, k, st.RAM + 2 * i, fault, data)
                following = -1
                if n < 0:
                    s[st.FAULT], s[st.FAULT_DATA], s[st.FAULT_THREAD] = fault, data, t
                    s[st.FAULT_PC], s[st.FAULT_CYCLE] = st.RAM + 2 * i, now
                    s[st.STATE + t] = st.TRAPPED
                    stop = st.UNHANDLED
                    now = st.NEVER
                    break
                count += 1
                i = n
                now += period
                break
            if pessimistic:
                if n == i + 1 + (w >> 28 & 1):
                    following = n
                    if not ACCESSES[op] and fetched - n <= 2:
                        fetched += 2
                else:
                    following = -1
            if profiled:
                profile[i] += 1
            count += 1
            i = n
            now += took
        s[row + st.PC] = i
        s[st.READY + t] = now
        s[row + st.FETCHED], s[row + st.NEXT] = fetched, following
        if general:
            s[st.LAST] = max(s[st.LAST], start)
        if stop != st.REACHED:
            break
    s[st.COUNT] += count
    if stop == st.UNDECODED or stop == st.UNHANDLED:
        cycle = until if stop == st.UNDECODED else min(until, s[st.FAULT_CYCLE])
        for u in range(st.THREADS):
            cycle = min(cycle, s[st.READY + u] - 1)
    s[st.CYCLE] = max(s[st.CYCLE], cycle)
    flush(s, regs, pins, log, s[st.CYCLE])
    return stop
