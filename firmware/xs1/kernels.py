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

from .actions import act
from .compiled import kernel, part
from .instructions import BY_NAME, INSTRUCTIONS, Effect
from .ports import bring_up, free_after, update
from .resources import due_event, enter, find_port, pause, slot, take_event, wake
from .state import (
    AHEAD,
    ARITHMETIC,
    COUNT,
    CP,
    CYCLE,
    DIVISION,
    DONE,
    DP,
    EEBLE,
    FAULT,
    FAULT_CYCLE,
    FAULT_DATA,
    FAULT_PC,
    FAULT_THREAD,
    FETCHED,
    FOR_OUTPUT,
    FULL,
    GONE,
    HALVES,
    IEBLE,
    ILLEGAL_INSTRUCTION,
    ILLEGAL_PC,
    ISSUE,
    ISSUED,
    LAST,
    LOAD_STORE,
    LOCKSTEP,
    LOG_FULL,
    LOG_MARGIN,
    LOGGED,
    LR,
    MESSAGE,
    NEVER,
    NEXT,
    NOT_DECODED,
    ON,
    OUTSIDE_RAM,
    OWNER,
    PAUSE,
    PAUSED,
    PC,
    PESSIMISTIC,
    PORT,
    PORT_0,
    PORT_ROW,
    PORTS,
    PROFILED,
    RAM,
    REACHED,
    READY,
    REGISTER_ROW,
    RESOURCE,
    RESOURCE_ROW,
    RUNNING,
    SENT,
    SP,
    SR,
    STATE,
    THREAD,
    THREAD_ROW,
    THREADS,
    TRANSFER,
    TRANSFER_WIDTH,
    TRAP,
    TRAPPED,
    UNDECODED,
    UNDECODED_AT,
    UNHANDLED,
    USED_THREADS,
    WATCHED,
    WHY,
    codes,
)

__all__ = ["flush", "run"]

int32: Any = np.int32
int64: Any = np.int64
uint64: Any = np.uint64

ACCESSES = np.zeros(256, np.bool_)
"""Of each code whether it accesses memory, so that no instructions can be fetched at that time."""
ACCESSES[[code for code, i in enumerate(INSTRUCTIONS) if i.effect in (Effect.LOAD, Effect.STORE)]] = True
ACCESSES[[BY_NAME[name] for name in ("retsp", "blat", "blacp")]] = True

STWI, LDWI, ADD, SUB, SHL, SHR, EQ, AND = codes("stwi ldwi add sub shl shr eq and")
OR, LDW, LD16S, LD8U, ADDI, SUBI, SHLI, SHRI, EQI = codes("or ldw ld16s ld8u addi subi shli shri eqi")
LSS, LSU, ANDNOT, SEXT, SEXTI, ZEXT, ZEXTI, NOT, NEG = codes("lss lsu andnot sext sexti zext zexti not neg")
MKMSK, MKMSKI, BLAR, BAU, BRU, SETSP, SETDP, SETCP = codes("mkmsk mkmski blar bau bru setsp setdp setcp")
STWDP, STWSP, LDWDP, LDWSP, LDAWDP, LDAWSP, LDC, LDWCP = codes("stwdp stwsp ldwdp ldwsp ldawdp ldawsp ldc ldwcp")
BRFT, BRBT, BRFF, BRBF, BRFU, BRBU, BLAT, BLACP = codes("brft brbt brff brbf brfu brbu blat blacp")
EXTDP, EXTSP, ENTSP, RETSP, GETSR, LDAWCP, LDWCPL = codes("extdp extsp entsp retsp getsr ldawcp ldwcpl")
BLRF, BLRB, LDAPF, LDAPB, STWL, ST16, ST8, XOR, ASHR = codes("blrf blrb ldapf ldapb stwl st16 st8 xor ashr")
LDAWF, LDAWB, LDAWFI, LDAWBI, LDA16F, LDA16B, ASHRI = codes("ldawf ldawb ldawfi ldawbi lda16f lda16b ashri")
MUL, DIVS, DIVU, REMS, REMU, CRC32, CRC8, BITREV = codes("mul divs divu rems remu crc32 crc8 bitrev")
BYTEREV, CLZ, MACCU, MACCS, LDIVU, LADD, LSUB, LMUL = codes("byterev clz maccu maccs ldivu ladd lsub lmul")
(OUT,) = codes("out")

WORD = 0xFFFFFFFF


@part
def _forget(code: Any, address: int) -> None:
    """Have the half words around a word that was stored decoded again."""
    half = (address - RAM) >> 1 & ~1
    code[half - 1 if half > 0 else 0] = NOT_DECODED
    code[half] = NOT_DECODED
    code[half + 1] = NOT_DECODED


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
    for p in range(PORTS):
        if s[PORT + p * PORT_ROW + WATCHED] != 0:
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
        Of each word of memory, whether it may be in `code`.
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
    period = s[ISSUE]
    pessimistic, profiled, lockstep, ahead = s[PESSIMISTIC] != 0, s[PROFILED] != 0, s[LOCKSTEP] != 0, s[AHEAD]
    count = 0
    stop = REACHED
    full = log.shape[0] - LOG_MARGIN
    cycle = until
    for t in range(THREADS):
        if s[STATE + t] == PAUSED:  # something may have come from outside
            s[READY + t] = min(s[READY + t], s[CYCLE] + 1)
    while True:
        t, now, other = 0, s[READY], NEVER
        for u in range(1, THREADS):
            time = s[READY + u]
            if time < now:
                other = now
                now = time
                t = u
            elif time < other:
                other = time
        if now > until:
            break
        if s[LOGGED] >= full:
            stop = LOG_FULL
            cycle = now - 1
            break
        row, k = THREAD + t * THREAD_ROW, t * REGISTER_ROW
        if s[STATE + t] != RUNNING:
            if s[row + WHY] == FOR_OUTPUT and regs[k + SR] & (EEBLE | IEBLE) == 0:
                p = s[row + ON] - PORT_0
                if not bring_up(s, log, p, now) or s[PORT + p * PORT_ROW + FULL] != 0:
                    wake(s, regs, inbox, pins, log, t, now)
                    continue
                s[READY + t] = slot(s, t, now)
                s[STATE + t] = RUNNING
                if s[READY + t] != now:
                    continue
            else:
                wake(s, regs, inbox, pins, log, t, now)
                continue
        general = s[USED_THREADS] > period
        if general and now <= s[LAST]:
            now = s[LAST] + 1
            if now > until:
                break
        bound = now
        if regs[k + SR] & (EEBLE | IEBLE):
            event, _ = due_event(s, regs, inbox, pins, log, t, now)
            if event >= 0:
                take_event(s, regs, t, event)
        elif not (lockstep or general):
            bound = min(until, now + ahead)
        r = regs[k : k + REGISTER_ROW]
        i = s[row + PC]
        fetched, following = s[row + FETCHED], s[row + NEXT]
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
                if data & 0xFFFF0003 == RAM:
                    r[a] = words[data >> 2 & 0x3FFF]
                else:
                    fault = LOAD_STORE
            elif op == LDWI:
                data = r[b] + imm
                if data & 0xFFFF0003 == RAM:
                    r[a] = words[data >> 2 & 0x3FFF]
                else:
                    fault = LOAD_STORE
            elif op == LDWSP:
                data = r[SP] + imm
                if data & 0xFFFF0003 == RAM:
                    r[a] = words[data >> 2 & 0x3FFF]
                else:
                    fault = LOAD_STORE
            elif op == LDWDP:
                data = r[DP] + imm
                if data & 0xFFFF0003 == RAM:
                    r[a] = words[data >> 2 & 0x3FFF]
                else:
                    fault = LOAD_STORE
            elif op == LDWCP or op == LDWCPL:
                data = r[CP] + imm
                if data & 0xFFFF0003 == RAM:
                    r[a if op == LDWCP else 11] = words[data >> 2 & 0x3FFF]
                else:
                    fault = LOAD_STORE
            elif op == LD16S:
                data = r[b] + 2 * int64(r[c])
                if data & 0xFFFF0001 == RAM:
                    r[a] = halves[data >> 1 & 0x7FFF]
                else:
                    fault = LOAD_STORE
            elif op == LD8U:
                data = r[b] + int64(r[c])
                if data & 0xFFFF0000 == RAM:
                    r[a] = bytes_[data & 0xFFFF]
                else:
                    fault = LOAD_STORE
            elif op == STWI or op == STWL or op == STWSP or op == STWDP:
                if op == STWI:
                    data = r[b] + imm
                elif op == STWL:
                    data = r[b] + 4 * int64(r[c])
                elif op == STWSP:
                    data = r[SP] + imm
                else:
                    data = r[DP] + imm
                if data & 0xFFFF0003 == RAM:
                    words[data >> 2 & 0x3FFF] = r[a]
                    if marks[data >> 2 & 0x3FFF]:
                        _forget(code, data & WORD)
                else:
                    fault = LOAD_STORE
            elif op == ST16:
                data = r[b] + 2 * int64(r[c])
                if data & 0xFFFF0001 == RAM:
                    halves[data >> 1 & 0x7FFF] = int64(r[a])
                    if marks[data >> 2 & 0x3FFF]:
                        _forget(code, data & WORD)
                else:
                    fault = LOAD_STORE
            elif op == ST8:
                data = r[b] + int64(r[c])
                if data & 0xFFFF0000 == RAM:
                    bytes_[data & 0xFFFF] = r[a]
                    if marks[data >> 2 & 0x3FFF]:
                        _forget(code, data & WORD)
                else:
                    fault = LOAD_STORE
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
                r[a] = r[SP] + imm
            elif op == LDAWDP:
                r[a] = r[DP] + imm
            elif op == LDAWCP:
                r[11] = r[CP] + imm
            elif op == LDAPF or op == LDAPB:
                r[11] = RAM + 2 * (n + imm)
            elif op == BRFT or op == BRBT:
                if r[a] != 0:
                    n += imm
                    if n < 0 or n >= HALVES:
                        fault, data = ILLEGAL_PC, RAM + 2 * n
            elif op == BRFF or op == BRBF:
                if r[a] == 0:
                    n += imm
                    if n < 0 or n >= HALVES:
                        fault, data = ILLEGAL_PC, RAM + 2 * n
            elif op == BRFU or op == BRBU:
                n += imm
                if n < 0 or n >= HALVES:
                    fault, data = ILLEGAL_PC, RAM + 2 * n
            elif op == BLRF or op == BLRB:
                target = n + imm
                if target < 0 or target >= HALVES:
                    fault, data = ILLEGAL_PC, RAM + 2 * target
                else:
                    r[LR] = RAM + 2 * n
                    n = target
            elif op == BRU:
                data = RAM + 2 * (n + int64(int32(r[a])))
                n = (data & WORD) - RAM >> 1
                if n < 0 or n >= HALVES:
                    fault = ILLEGAL_PC
            elif op == BAU or op == BLAR:
                data = int64(r[a])
                if data & 1 or data & 0xFFFF0000 != RAM:
                    fault = ILLEGAL_PC
                else:
                    if op == BLAR:
                        r[LR] = RAM + 2 * n
                    n = (data - RAM) >> 1
            elif op == BLAT or op == BLACP:
                data = (r[11] if op == BLAT else r[CP]) + imm
                if data & 0xFFFF0003 == RAM:
                    data = int64(words[data >> 2 & 0x3FFF])
                    if data & 1 or data & 0xFFFF0000 != RAM:
                        fault = ILLEGAL_PC
                    else:
                        r[LR] = RAM + 2 * n
                        n = (data - RAM) >> 1
                else:
                    fault = LOAD_STORE
            elif op == RETSP:
                data = int64(r[LR])
                sp = int64(r[SP])
                if imm > 0:
                    sp = (sp + imm) & WORD
                    if sp & 0xFFFF0003 == RAM:
                        data = int64(words[sp >> 2 & 0x3FFF])
                    else:
                        fault, data = LOAD_STORE, sp
                if fault == 0:
                    if data & 1 or data & 0xFFFF0000 != RAM:
                        fault = ILLEGAL_PC
                    else:
                        r[LR] = data
                        r[SP] = sp
                        n = (data - RAM) >> 1
            elif op == ENTSP:
                if imm > 0:
                    data = int64(r[SP])
                    if data & 0xFFFF0003 == RAM:
                        words[data >> 2 & 0x3FFF] = r[LR]
                        if marks[data >> 2 & 0x3FFF]:
                            _forget(code, data)
                        r[SP] = data - imm
                    else:
                        fault = LOAD_STORE
            elif op == EXTSP:
                r[SP] = r[SP] - imm
            elif op == EXTDP:
                r[DP] = r[DP] - imm
            elif op == SETSP:
                r[SP] = r[a]
            elif op == SETDP:
                r[DP] = r[a]
            elif op == SETCP:
                r[CP] = r[a]
            elif op == GETSR:
                r[11] = r[SR] & imm
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
                took = DIVISION * period
                if r[c] == 0:
                    fault = ARITHMETIC
                elif op == DIVU:
                    r[a] = int64(r[b]) // int64(r[c])
                else:
                    r[a] = int64(r[b]) % int64(r[c])
            elif op == DIVS or op == REMS:
                took = DIVISION * period
                dividend, divisor = int64(int32(r[b])), int64(int32(r[c]))
                if divisor == 0 or (dividend == -0x80000000 and divisor == -1):
                    fault = ARITHMETIC
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
                    took = DIVISION * period
                    if ve >= vc:
                        fault = ARITHMETIC
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
                s[LAST] = now
                s[row + ISSUED] = now
                place = PORT + p * PORT_ROW
                owned = s[RESOURCE + (PORT_0 + p) * RESOURCE_ROW + OWNER] == t
                if owned and bring_up(s, log, p, now):
                    if s[place + FULL] != 0:
                        s[row + PC] = i
                        pause(s, t, FOR_OUTPUT, PORT_0 + p, free_after(s, place))
                        now = s[READY + t]
                        break
                    s[place + TRANSFER] = int64(r[a]) & (1 << s[place + TRANSFER_WIDTH]) - 1
                    s[place + FULL] = 1
                else:
                    s[row + PC] = i
                    did = act(s, regs, words, processor, inbox, outbox, pins, log, t, now, op, a, b, imm, n)
                    if did == PAUSE:
                        now = s[READY + t]
                        break
                    if did == TRAP:
                        fault, data = s[FAULT], s[FAULT_DATA]
            elif op == NOT_DECODED:
                s[UNDECODED_AT] = i
                stop = UNDECODED
                break
            elif op == OUTSIDE_RAM:
                fault, data = ILLEGAL_PC, RAM + 2 * i
            elif op > 251:
                fault = ILLEGAL_INSTRUCTION
            else:
                if now > start and now >= other:
                    break
                s[LAST] = now
                s[row + ISSUED] = now
                s[row + PC] = i
                did = act(s, regs, words, processor, inbox, outbox, pins, log, t, now, op, a, b, imm, n)
                if did == DONE or did == SENT:
                    if pessimistic:
                        following = n
                        if fetched - n <= 2:
                            fetched += 2
                    if profiled:
                        profile[i] += 1
                    count += 1
                    i = n
                    now += period
                    if did == SENT:
                        stop = MESSAGE
                        cycle = now - period
                    break
                if did == PAUSE:
                    now = s[READY + t]
                    break
                if did == TRAP:
                    fault, data = s[FAULT], s[FAULT_DATA]
                else:
                    if profiled:
                        profile[i] += 1
                    count += 1
                    following = -1
                    i = s[row + PC]
                    now = s[READY + t] if did == GONE else now + period
                    break
            if fault != 0:
                data &= WORD
                n = enter(regs, k, RAM + 2 * i, fault, data)
                following = -1
                if n < 0:
                    s[FAULT], s[FAULT_DATA], s[FAULT_THREAD] = fault, data, t
                    s[FAULT_PC], s[FAULT_CYCLE] = RAM + 2 * i, now
                    s[STATE + t] = TRAPPED
                    stop = UNHANDLED
                    now = NEVER
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
        s[row + PC] = i
        s[READY + t] = now
        s[row + FETCHED], s[row + NEXT] = fetched, following
        if general:
            s[LAST] = max(s[LAST], start)
        if stop != REACHED:
            break
    s[COUNT] += count
    if stop == UNDECODED or stop == UNHANDLED:
        cycle = until if stop == UNDECODED else min(until, s[FAULT_CYCLE])
        for u in range(THREADS):
            cycle = min(cycle, s[READY + u] - 1)
    s[CYCLE] = max(s[CYCLE], cycle)
    flush(s, regs, pins, log, s[CYCLE])
    return stop
