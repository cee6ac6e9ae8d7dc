"""By what a mutant shows itself: of each a few lines that find it, and find nothing on a sound device."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from cobs import cobs
from phasewire.emulator import faults
from phasewire.emulator.machine import plugged
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.lines.serial import SerialLine
from phasewire.hil.conformance.tools.dfu import DfuLine, dfu_mode
from phasewire.host.lines.usb_find import RUN_TIME
from phasewire.protocol.blocks import Block, Modulation, NoOp, Samples, Update, checksum, pack
from phasewire.protocol.codes import Bank, DfuState, Feature, FrameKind, Reason, Request, State
from phasewire.protocol.framing import CONSOLE_FRAME, Frame, encode
from phasewire.protocol.pulses import Pulses
from phasewire.protocol.requests import Setup

Sign = Callable[[Bench], bool]
SIGNS: dict[str, Sign] = {}

INFO = Setup(0xC1, Request.INFO, 0, 0, 64)


def sign_of(name: str) -> Callable[[Sign], Sign]:
    def enter(sign: Sign) -> Sign:
        SIGNS[name] = sign
        return sign

    return enter


def forged(block: bytes, **fields: bytes) -> bytes:
    """A block with other bytes at places, and its checksum put right."""
    changed = bytearray(block)
    for place, value in fields.items():
        at = int(place.removeprefix("at"))
        changed[at : at + len(value)] = value
    changed[28:32] = checksum(bytes(changed)).to_bytes(4, "little")
    return bytes(changed)


def playing(bench: Bench, width: int = 5, others: int = 0) -> None:
    bench.order(Request.WATCHDOG, 60_000)
    bench.enable()
    ack = bench.must(Update(Pulses([0] * 320, [width] + [others] * 319)))
    bench.wait_until(ack.commit_period + 2)


# Requests

SIGNS["info-counts-a-place-too-many"] = lambda bench: bench.info.queue_blocks != bench.status().free
SIGNS["unknown-requests-are-acknowledged"] = lambda bench: bench.request(Setup(0xC1, 0x60, 0, 0, 8)) is not None
SIGNS["values-of-requests-are-not-checked"] = lambda bench: bench.try_order(Request.CLEAR_FAULTS, 1)
SIGNS["index-of-requests-is-not-checked"] = lambda bench: bench.request(replace(INFO, index=2)) is not None
SIGNS["identify-takes-board-5"] = lambda bench: bench.try_order(Request.IDENTIFY, 5)
SIGNS["watchdog-takes-9-ms"] = lambda bench: bench.try_order(Request.WATCHDOG, 9)
SIGNS["limit-takes-a-transducer-too-many"] = lambda bench: bench.try_order(Request.LIMIT, 321)
SIGNS["clock-tells-periods"] = lambda bench: bench.clock().now < bench.status().now // 10


@sign_of("info-counts-seconds-in-its-last-bytes")
def _(bench: Bench) -> bool:
    bench.wait(1)
    return bench.request(INFO) != bench.info.encode()


@sign_of("orders-with-data-are-carried-out")
def _(bench: Bench) -> bool:
    return bench.request(Setup(0x41, Request.DISABLE, 0, 0, 4), bytes(4)) is not None


def _bytes_of(bench: Bench, length: int) -> list[int]:
    """How many bytes of INFO come over both lines."""
    answers = [line.request(replace(INFO, length=length)) for line in (bench.line, _frames(bench))]
    return [len(answer or b"") for answer in answers]


def _frames(bench: Bench) -> SerialLine:
    bench.serial.enter_frames()
    return bench.serial


SIGNS["answers-are-not-cut-to-what-was-asked-for"] = lambda bench: _bytes_of(bench, 8) == [64, 64]
SIGNS["answers-are-cut-a-byte-too-late"] = lambda bench: _bytes_of(bench, 8) == [9, 9]


@sign_of("sync-pulses-are-not-counted")
def _(bench: Bench) -> bool:
    bench.wait(0.3)
    return bench.clock().sync_pulses == 1


@sign_of("wiring-is-answered-the-other-way-round")
def _(bench: Bench) -> bool:
    (emulator,) = plugged()
    return list(bench.wiring.channels) != list(emulator.running._identification.wiring.channels)


@sign_of("read-back-is-modulated")
def _(bench: Bench) -> bool:
    playing(bench, width=10)
    bench.must(Samples(bytes([40])))
    bench.wait_until(bench.must(Modulation(0, 1, 1)).commit_period + 2)
    return int(bench.read_back().pulses.width[0]) != 10


@sign_of("read-back-tells-what-was-queued-last")
def _(bench: Bench) -> bool:
    playing(bench)
    bench.must(Update(Pulses([0] * 320, [3] * 320), bench.period() + 4000))
    return int(bench.read_back().pulses.width[0]) == 3


@sign_of("read-back-plays-since-it-was-read")
def _(bench: Bench) -> bool:
    playing(bench)
    bench.wait_periods(100)
    found = bench.read_back()
    return found.since_period == found.read_period


@sign_of("status-forgets-the-last-refusal-once-it-was-read")
def _(bench: Bench) -> bool:
    bench.send(Update(bench.weak()))
    return [bench.status().last_refusal, bench.status().last_refusal] == [Reason.DISABLED, Reason.ACCEPTED]


def _heat(bench: Bench, *celsius: int) -> None:
    for board, each in enumerate(celsius):
        bench.levers.cause(faults.HotBoard(board=board, celsius=each))
    bench.wait(0.03)


@sign_of("temperature-is-that-of-the-first-board")
def _(bench: Bench) -> bool:
    _heat(bench, 20, 20, 20, 60)
    return bench.status().temperature_c == 20


@sign_of("frost-is-told-as-zero")
def _(bench: Bench) -> bool:
    _heat(bench, *[-10] * 5)
    return bench.status().temperature_c == 0 and bench.processors()[0].temperature_c == 0


@sign_of("processors-are-told-from-the-far-end")
def _(bench: Bench) -> bool:
    _heat(bench, 40)
    return bench.processors()[9].temperature_c == 40


@sign_of("temperature-is-cleared-without-hysteresis")
def _(bench: Bench) -> bool:
    _heat(bench, 90)
    _heat(bench, 83)
    bench.order(Request.CLEAR_FAULTS)
    return bench.status().state is State.OFF


@sign_of("reset-only-disables")
def _(bench: Bench) -> bool:
    (emulator,) = plugged()
    before = emulator.controller
    bench.order(Request.RESET)
    bench.wait(0.01)
    return emulator.controller is before


# Chain


def _damage(bench: Bench, message: str, token: int, times: int = 1) -> None:
    bench.levers.cause(faults.FlippedBit(message=message, processor=3, token=token, times=times))


@sign_of("damaged-messages-are-not-counted")
def _(bench: Bench) -> bool:
    _damage(bench, "collect", 3)
    bench.wait(0.03)
    return bool(bench.status().faults) and bench.status().damaged_messages == 0


@sign_of("damaged-slices-are-played")
def _(bench: Bench) -> bool:
    _damage(bench, "slice", 10)
    playing(bench)
    bench.wait(0.03)
    return bench.status().missed_commits == 0


@sign_of("missed-commits-are-kept-quiet")
def _(bench: Bench) -> bool:
    _damage(bench, "slice", 10)
    playing(bench)
    bench.wait(0.03)
    return bench.processors()[3].missed_commits == 0


@sign_of("silent-processors-are-not-noticed")
def _(bench: Bench) -> bool:
    _damage(bench, "report", 5, times=100)
    bench.wait(0.1)
    return bench.status().state is not State.FAULT


@sign_of("broken-chain-is-not-noticed")
def _(bench: Bench) -> bool:
    bench.levers.cause(faults.DeadProcessor(processor=4))
    bench.wait(0.1)
    return not bench.status().faults


@sign_of("lone-processors-play-on")
def _(bench: Bench) -> bool:
    playing(bench, others=5)
    bench.levers.cause(faults.DeadProcessor(processor=0))
    bench.wait(0.2)
    (emulator,) = plugged()
    now = emulator.running.now_tick
    return bool(emulator.capture().bits(now - 50, now)[:, 1:].any())


@sign_of("missed-silence-is-not-sent-again")
def _(bench: Bench) -> bool:
    playing(bench)
    (emulator,) = plugged()
    emulator.unfold()
    channel = int(bench.wiring.channels[0])
    bench.levers.cause(faults.FlippedBit(message="commit", processor=channel // 32, token=4, times=2))
    bench.order(Request.DISABLE)
    bench.wait(0.2)
    now = emulator.running.now_tick
    return bool(emulator.capture().bits(now - 50, now).any())


@sign_of("sync-may-be-off-by-100-ticks")
def _(bench: Bench) -> bool:
    bench.levers.cause(faults.ClockError(board=2, ppm=100, periods=8000))
    bench.wait(0.3)
    return bench.status().state is not State.FAULT


@sign_of("missing-sync-pulses-are-not-noticed")
def _(bench: Bench) -> bool:
    bench.levers.cause(faults.LostSync())
    bench.wait(0.3)
    return bench.status().state is not State.FAULT


@sign_of("faults-go-with-their-cause")
def _(bench: Bench) -> bool:
    _heat(bench, 90)
    _heat(bench, 40)
    return bench.status().state is State.OFF


@sign_of("clear-faults-clears-what-persists")
def _(bench: Bench) -> bool:
    _heat(bench, 90)
    bench.order(Request.CLEAR_FAULTS)
    return bench.status().state is State.OFF


@sign_of("overrun-is-never-said")
def _(bench: Bench) -> bool:
    bench.levers.cause(faults.SlowProcessor(processor=1, slowness=10))
    playing(bench)
    bench.wait(0.03)
    return "OVERRUN" not in repr(bench.status().faults)


@sign_of("faults-are-told-only-when-asked-for")
def _(bench: Bench) -> bool:
    _heat(bench, 90)
    return not bench.listen(0.01)


@sign_of("processors-wait-for-the-controller-to-silence-them")
def _(bench: Bench) -> bool:
    playing(bench)
    (emulator,) = plugged()
    emulator.unfold()
    bench.wait_until(bench.period() // 400 * 400 + 400 + 4 * (int(bench.wiring.channels[0]) // 32) + 40)
    board = int(bench.wiring.channels[0]) // 64
    bench.levers.cause(faults.HotBoard(board=board, celsius=90))
    now = emulator.running.now_tick
    bench.wait_periods(20)
    return bool(emulator.capture().bits(now + 100, now + 200).any())


@sign_of("faults-leave-the-state-as-it-is")
def _(bench: Bench) -> bool:
    _heat(bench, 90)
    return bool(bench.status().faults) and bench.status().state is State.OFF


# USB


def _descriptor(bench: Bench, kind: int, length: int = 400, index: int = 0) -> bytes | None:
    return bench.request(Setup(0x80, 6, kind << 8 | (3 if kind == 3 else 0), index or (0x409 * (kind == 3)), length))


def _part(found: bytes | None, start: int, stop: int) -> bytes:
    assert found is not None
    return found[start:stop]


SIGNS["blocks-endpoint-has-interval-0"] = lambda bench: (
    b"\x07\x05\x01\x02\x00\x02\x00" in (_descriptor(bench, 2) or b"")
)
SIGNS["other-speed-has-the-packets-of-this-one"] = lambda bench: _part(_descriptor(bench, 7), 22, 24) == b"\x00\x02"
SIGNS["qualifier-names-another-class"] = lambda bench: _part(_descriptor(bench, 6), 4, 7) == bytes(3)
SIGNS["strings-are-there-in-every-language"] = lambda bench: _descriptor(bench, 3, index=0x407) is not None
SIGNS["descriptors-are-not-cut-to-what-was-asked-for"] = lambda bench: len(_descriptor(bench, 2, 9) or b"") > 9
SIGNS["unknown-descriptors-are-empty"] = lambda bench: _descriptor(bench, 5) == b""
SIGNS["device-says-that-the-bus-powers-it"] = lambda bench: bench.request(Setup(0x80, 0, 0, 0, 2)) == b"\x00\x00"
SIGNS["configuration-2-is-taken"] = lambda bench: bench.request(Setup(0, 9, 2, 0, 0)) is not None


def _ms_os(bench: Bench) -> bytes:
    return bench.request(Setup(0xC0, 0x20, 0, 7, 338)) or b""


SIGNS["ms-os-set-says-another-length"] = lambda bench: (
    int.from_bytes(_ms_os(bench)[8:10], "little") != len(_ms_os(bench))
)
SIGNS["ms-os-set-names-the-value-of-the-configuration"] = lambda bench: _ms_os(bench)[14] == 1


@sign_of("interfaces-answer-before-the-configuration")
def _(bench: Bench) -> bool:
    bench.request(Setup(0, 9, 0, 0, 0))
    return bench.request(INFO) is not None


@sign_of("serial-number-changes-at-each-restart")
def _(bench: Bench) -> bool:
    before = bench.request(Setup(0x80, 6, 0x303, 0x409, 255))
    (emulator,) = plugged()
    emulator.restart()
    emulator.run_until_started()
    return emulator.usb.control(Setup(0x80, 6, 0x303, 0x409, 255)) != before


def _halt(bench: Bench, endpoint: int, *, begins: bool) -> None:
    assert bench.request(Setup(0x02, 3 if begins else 1, 0, endpoint, 0)) is not None


@sign_of("halts-do-not-end")
def _(bench: Bench) -> bool:
    _halt(bench, 0x81, begins=True)
    _halt(bench, 0x81, begins=False)
    return bench.request(Setup(0x82, 0, 0, 0x81, 2)) == b"\x01\x00"


@sign_of("halts-are-not-told")
def _(bench: Bench) -> bool:
    _halt(bench, 0x81, begins=True)
    return bench.request(Setup(0x82, 0, 0, 0x81, 2)) == b"\x00\x00"


@sign_of("halts-have-no-effect")
def _(bench: Bench) -> bool:
    _halt(bench, 0x01, begins=True)
    return bench.request(Setup(0x82, 0, 0, 0x01, 2)) == b"\x01\x00" and _sends(bench, bytes(512))


def _sends(bench: Bench, block: bytes) -> bool:
    (emulator,) = plugged()
    return emulator.usb.bulk_out(1, block).name == "ACK"


def _waiting(bench: Bench) -> int:
    """Records that wait for 81 IN."""
    (emulator,) = plugged()
    array: Any = emulator.usb._functions[0]
    return len(array._records)


@sign_of("halt-drops-waiting-records")
def _(bench: Bench) -> bool:
    _sends(bench, pack(Block(NoOp(), 1, restart=True)))
    _halt(bench, 0x81, begins=True)
    return _waiting(bench) == 0


@sign_of("clear-feature-drops-waiting-records")
def _(bench: Bench) -> bool:
    _sends(bench, pack(Block(NoOp(), 1, restart=True)))
    _halt(bench, 0x81, begins=False)
    return _waiting(bench) == 0


@sign_of("records-outlive-the-session")
def _(bench: Bench) -> bool:
    _sends(bench, pack(Block(NoOp(), 1, restart=True)))
    bench.request(Setup(0, 9, 1, 0, 0))
    return _waiting(bench) == 1


@sign_of("short-blocks-halt-the-endpoint")
def _(bench: Bench) -> bool:
    _sends(bench, bytes(100))
    return not _sends(bench, bytes(512))


@sign_of("blocks-with-another-magic-halt-the-endpoint")
def _(bench: Bench) -> bool:
    _sends(bench, forged(pack(Block(NoOp(), 1)), at0=b"XX"))
    return not _sends(bench, bytes(512))


@sign_of("empty-packets-are-answered")
def _(bench: Bench) -> bool:
    _sends(bench, b"")
    return _waiting(bench) == 1


@sign_of("short-packets-shift-what-follows")
def _(bench: Bench) -> bool:
    _sends(bench, bytes(100))
    _sends(bench, pack(Block(NoOp(), 1, restart=True)))
    return bench.status().accepted == 0


@sign_of("full-packets-are-not-followed-by-an-empty-one")
def _(bench: Bench) -> bool:
    for number in range(16):
        _sends(bench, pack(Block(NoOp(), number, restart=True)))
    (emulator,) = plugged()
    emulator.usb.bulk_in(0x81)
    return emulator.usb.bulk_in(0x81) != b""


@sign_of("set-interface-does-nothing")
def _(bench: Bench) -> bool:
    bench.enable()
    bench.request(Setup(0x01, 11, 0, 0, 0))
    return bench.status().state is State.READY


@sign_of("settings-end-with-the-session")
def _(bench: Bench) -> bool:
    bench.order(Request.WATCHDOG, 500)
    bench.request(Setup(0, 9, 1, 0, 0))
    return bench.status().watchdog_ms == 100


@sign_of("unread-console-holds-up-blocks")
def _(bench: Bench) -> bool:
    bench.request(Setup(0x21, 0x22, 1, 1, 0))
    (emulator,) = plugged()
    emulator.usb.bulk_out(3, b"help\r")
    return not _sends(bench, bytes(512))


@sign_of("console-speaks-without-dtr")
def _(bench: Bench) -> bool:
    (emulator,) = plugged()
    emulator.usb.bulk_out(3, b"help\r")
    return isinstance(emulator.usb.bulk_in(0x83), bytes)


def _coding(bench: Bench) -> bytes | None:
    return bench.request(Setup(0xA1, 0x21, 0, 1, 7))


def _set_coding(bench: Bench) -> bytes:
    coding = (9600).to_bytes(4, "little") + bytes([2, 1, 7])
    assert bench.request(Setup(0x21, 0x20, 0, 1, 7), coding) is not None
    return coding


SIGNS["line-coding-is-not-kept"] = lambda bench: _set_coding(bench) != _coding(bench)


@sign_of("line-coding-outlives-the-session")
def _(bench: Bench) -> bool:
    coding = _set_coding(bench)
    bench.request(Setup(0, 9, 1, 0, 0))
    return _coding(bench) == coding


# Power


@sign_of("suspend-is-ignored")
def _(bench: Bench) -> bool:
    bench.enable()
    bench.levers.suspend()
    bench.levers.resume()
    return bench.status().state is State.READY


@sign_of("resume-enables-again")
def _(bench: Bench) -> bool:
    bench.enable()
    bench.levers.suspend()
    bench.levers.resume()
    return bench.status().state is State.READY


@sign_of("bus-reset-keeps-playing")
def _(bench: Bench) -> bool:
    playing(bench)
    bench.request(Setup(0, 9, 1, 0, 0))
    return bench.status().state is State.PLAYING


@sign_of("reset-keeps-the-watchdog-time")
def _(bench: Bench) -> bool:
    bench.order(Request.WATCHDOG, 500)
    bench.order(Request.RESET)
    bench.line.reopen(15)
    return bench.status().watchdog_ms == 500


@sign_of("reset-keeps-the-counters")
def _(bench: Bench) -> bool:
    bench.must(NoOp())
    bench.order(Request.RESET)
    bench.line.reopen(15)
    return bench.status().accepted == 1


@sign_of("time-goes-on-over-a-reset")
def _(bench: Bench) -> bool:
    bench.wait(10)
    bench.order(Request.RESET)
    bench.line.reopen(15)
    return bench.clock().now > 20_000_000


@sign_of("outputs-are-high-for-a-tick-at-power-up")
def _(bench: Bench) -> bool:
    (emulator,) = plugged()
    words = emulator.capture().bits(0, 50)
    return bool((words[0] == 2**32 - 1).all()) and not words[1:].any()


# Firmware


def _dfu(bench: Bench, look: Callable[[DfuLine], bool]) -> bool:
    with dfu_mode(bench) as line:
        return look(line)


def _image(line: DfuLine) -> bytes:
    found = line.image()
    line.rest()
    return found


SIGNS["clrstatus-is-taken-in-every-quiet-state"] = lambda bench: _dfu(bench, lambda line: line.clear())
SIGNS["detach-is-taken-in-dfu-mode"] = lambda bench: _dfu(bench, lambda line: line.detach())
SIGNS["download-of-nothing-is-taken-in-idle"] = lambda bench: _dfu(bench, lambda line: line.download(0, b""))
SIGNS["numbers-of-blocks-are-not-checked"] = lambda bench: _dfu(
    bench, lambda line: line.download(5, _image(line)[:2048])
)
SIGNS["upload-takes-any-length"] = lambda bench: _dfu(bench, lambda line: line.upload(0, 100) is not None)
SIGNS["upload-takes-any-number"] = lambda bench: _dfu(
    bench, lambda line: line.upload(0) is not None and line.upload(2) is not None
)


@sign_of("upload-never-ends")
def _(bench: Bench) -> bool:
    return _dfu(bench, lambda line: all(len(line.upload(number) or b"") == 2048 for number in range(10)))


@sign_of("poll-time-is-0")
def _(bench: Bench) -> bool:
    def look(line: DfuLine) -> bool:
        line.download(0, _image(line)[:2048])
        busy = line.status()
        line.wait(200)
        return busy is not None and busy.state is DfuState.DNBUSY and busy.poll_ms == 0

    return _dfu(bench, look)


@sign_of("busy-state-ends-late")
def _(bench: Bench) -> bool:
    def look(line: DfuLine) -> bool:
        line.download(0, _image(line)[:2048])
        line.status()
        line.wait(135)
        late = line.state() is None
        line.wait(100)
        return late

    return _dfu(bench, look)


@sign_of("abort-goes-on-with-the-download")
def _(bench: Bench) -> bool:
    def look(line: DfuLine) -> bool:
        line.send(_image(line), 0, 1)
        return line.abort() and line.state() is DfuState.DNLOAD_IDLE

    return _dfu(bench, look)


@sign_of("later-errors-replace-the-first")
def _(bench: Bench) -> bool:
    def look(line: DfuLine) -> bool:
        line.download(5, bytes(2048))
        line.abort()
        status = line.status()
        return status is not None and status.status.name == "STALLEDPKT"

    return _dfu(bench, look)


@sign_of("detach-does-not-silence")
def _(bench: Bench) -> bool:
    playing(bench)
    DfuLine(bench).detach()
    return bench.status().state is State.PLAYING


@sign_of("refused-request-calls-off-a-detach")
def _(bench: Bench) -> bool:
    line = DfuLine(bench)
    line.detach()
    line.abort()
    bench.wait(0.1)
    (emulator,) = plugged()
    return emulator.usb._dfu is not None


@sign_of("reset-of-enumeration-boots")
def _(bench: Bench) -> bool:
    DfuLine(bench).detach()
    bench.wait(0.1)
    (emulator,) = plugged()
    emulator.usb.reset()
    bench.wait(0.5)
    return emulator.controller is not None and emulator.usb._dfu is not None


def _flash(bench: Bench, image: Callable[[bytes], bytes] = bytes) -> bool:
    """Flash the device's own image, or another; whether it was taken."""
    with dfu_mode(bench) as line:
        line.send(image(_image(line)))
        line.download(0, b"")
        taken = line.poll().state is DfuState.DFU_IDLE
    bench.begin_case("behind the upgrade")
    return taken


def _bank(bench: Bench) -> Bank | None:
    return bench.processors()[0].bank


def _resealed(image: bytes, at: int, value: int) -> bytes:
    """An image with another byte in its header, and the checksum put right."""
    changed = bytearray(image)
    changed[at] = value
    table = changed[32 : 32 + 48 * changed[5]]
    changed[28:32] = zlib.crc32(table, zlib.crc32(changed[:28])).to_bytes(4, "little")
    return bytes(changed)


@sign_of("hardware-of-images-is-not-checked")
def _(bench: Bench) -> bool:
    return _flash(bench, lambda image: _resealed(image, 6, 2)) and _bank(bench) is Bank.A


@sign_of("digests-of-images-are-not-checked")
def _(bench: Bench) -> bool:
    return _flash(bench, lambda image: image[:-100] + bytes([image[-100] ^ 1]) + image[-99:]) and (
        _bank(bench) is Bank.A
    )


@sign_of("older-versions-are-refused")
def _(bench: Bench) -> bool:
    return not _flash(bench, lambda image: _resealed(image, 8, 0))


@sign_of("upgrade-overwrites-the-bank-that-runs")
def _(bench: Bench) -> bool:
    return _flash(bench) and _flash(bench) and _bank(bench) is Bank.A


@sign_of("bank-a-always-comes-first")
def _(bench: Bench) -> bool:
    return _flash(bench) and _flash(bench) and _bank(bench) is Bank.A


@sign_of("bank-is-erased-before-the-header-is-checked")
def _(bench: Bench) -> bool:
    def look(line: DfuLine) -> bool:
        line.flash(_resealed(_image(line), 8, 2))
        line.download(0, bytes(2048))
        line.wait(100)
        line.rest()
        return _image(line)[8] != 2

    return _dfu(bench, look)


@sign_of("new-images-are-never-confirmed")
def _(bench: Bench) -> bool:
    _flash(bench)
    bench.power_cycle()
    return _bank(bench) is Bank.FACTORY


@sign_of("images-that-never-came-up-boot-again")
def _(bench: Bench) -> bool:
    return _bank_behind_a_trial(bench) is Bank.A


@sign_of("new-images-are-confirmed-at-once")
def _(bench: Bench) -> bool:
    return _bank_behind_a_trial(bench) is Bank.A


def _bank_behind_a_trial(bench: Bench) -> Bank | None:
    """The bank that runs after new firmware was started and no host has come."""
    with dfu_mode(bench) as line:
        line.flash(_image(line))
        (emulator,) = plugged()
        for _ in range(2):
            emulator.power_down()
            emulator.power_up()
            emulator.run_until_started()
        bench.usb.wait_for(RUN_TIME, 15)
    return _bank(bench)


@sign_of("record-is-written-before-the-image-is-checked")
def _(bench: Bench) -> bool:
    _flash(bench, lambda image: image[:-100] + bytes([image[-100] ^ 1]) + image[-99:])
    return _bank(bench) is Bank.A or bool(bench.status().faults)


@sign_of("revert-only-restarts")
def _(bench: Bench) -> bool:
    _flash(bench)
    bench.restart(lambda: bench.order(Request.REVERT))
    return _bank(bench) is Bank.A


@sign_of("revert-leaves-the-newer-image")
def _(bench: Bench) -> bool:
    _flash(bench)
    _flash(bench)
    bench.restart(lambda: bench.order(Request.REVERT))
    return _bank(bench) is Bank.B


# Serial lines


def _frame(content: bytes) -> bytes:
    return bytes(cobs.encode(content + zlib.crc32(content).to_bytes(4, "little")))


def _request(tag: int = 7, kind: int = 0xC1, length: int = 64, data: bytes = b"") -> bytes:
    return b"\x03" + bytes([tag, kind, Request.INFO]) + bytes(4) + length.to_bytes(2, "little") + data


def _replies(bench: Bench, *frames: bytes) -> list[bytes]:
    line = _frames(bench)
    line.write(b"\0" + b"\0".join(frames) + b"\0")
    line.listen(0.05)
    return line.frames(FrameKind.REPLY)


def _dropped(bench: Bench, data: bytes) -> int:
    line = _frames(bench)
    before = bench.status().dropped_frames
    line.write(data)
    line.listen(0.05)
    return bench.status().dropped_frames - before


@sign_of("checksum-of-frames-is-ignored")
def _(bench: Bench) -> bool:
    content = _request()
    wrong = bytes(cobs.encode(content + (zlib.crc32(content) ^ 1).to_bytes(4, "little")))
    return len(_replies(bench, wrong)) == 1


@sign_of("empty-group-at-the-end-of-a-frame-is-taken")
def _(bench: Bench) -> bool:
    for tag in range(256):  # kind, head, data and checksum without a zero behind the head: 254 bytes
        frame = _frame(_request(tag, kind=0x41, length=250, data=b"\x55" * 250))
        if frame[-255] == 0xFF:
            return len(_replies(bench, frame + b"\x01")) == 1
    raise AssertionError("no frame ends with a full group")


SIGNS["requests-of-any-length-are-answered"] = lambda bench: len(_replies(bench, _frame(_request(length=700)))) == 1
SIGNS["long-frames-begin-anew-when-the-buffer-is-full"] = lambda bench: bool(
    _replies(bench, b"\x55" * 657 + _frame(_request()))
)
SIGNS["long-frames-are-not-counted"] = lambda bench: _dropped(bench, b"\0" + b"\x55" * 1000 + b"\0") == 0
SIGNS["two-zeros-count-as-a-damaged-frame"] = lambda bench: _dropped(bench, b"\0\0\0") > 0
SIGNS["damaged-frames-are-not-counted"] = lambda bench: _dropped(bench, b"\0\x03\x55\x55\0") == 0
SIGNS["frames-that-go-the-other-way-are-not-counted"] = lambda bench: (
    _dropped(bench, b"\0" + encode(Frame(FrameKind.RECORD, bytes(32)))) == 0
)
SIGNS["requests-of-any-type-are-carried-out"] = lambda bench: _replies(bench, _frame(_request(kind=0xC0)))[0][1] == 0


@sign_of("replies-have-tag-0")
def _(bench: Bench) -> bool:  # without the line of the bench, which does not come to frames where tags are wrong
    (emulator,) = plugged()
    emulator.usb.bulk_out(3, b"\0" + _frame(_request(tag=7)) + b"\0")
    packet = emulator.usb.bulk_in(0x83)
    assert isinstance(packet, bytes)
    return bool(cobs.decode(packet.strip(b"\0"))[1] == 0)


@sign_of("replies-overtake-what-waits")
def _(bench: Bench) -> bool:
    return [reply[0] for reply in _replies(bench, _frame(_request(tag=1)), _frame(_request(tag=2)))] == [2, 1]


@sign_of("console-frames-are-not-answered")
def _(bench: Bench) -> bool:
    line = _frames(bench)
    line.write(encode(CONSOLE_FRAME))
    return encode(CONSOLE_FRAME) not in _heard(line)


def _heard(line: SerialLine) -> bytes:
    """All bytes that come for a while."""
    end, found = line.time.monotonic() + 0.05, b""
    while line.time.monotonic() < end:
        found += line.wire.read(0.002)
    return found


# The console


def _typed(bench: Bench, text: bytes, *, echo: bool = False) -> bytes:
    """What the console sends, on its own endpoints, to what is typed."""
    line = bench.serial
    line.enter_console()
    if echo:
        line.write(b"echo 1\r")
        _heard(line)
    line.write(text)
    return _heard(line)


SIGNS["lines-may-have-81-characters"] = lambda bench: b"ok\r" in _typed(bench, b"clear" + b" " * 76 + b"\r")
SIGNS["backspace-moves-at-an-empty-line"] = lambda bench: _typed(bench, b"\b", echo=True) == b"\b \b"
SIGNS["cr-lf-ends-two-lines"] = lambda bench: _typed(bench, b"clear\r\n").count(b"> ") == 2
SIGNS["del-takes-nothing-back"] = lambda bench: b"error" in _typed(bench, b"clearx\x7f\r")
SIGNS["echo-0-is-not-heeded"] = lambda bench: _typed(bench, b"clear\r") != b"ok\r\n> "
SIGNS["case-does-not-matter"] = lambda bench: _typed(bench, b"CLEAR\r") == b"ok\r\n> "
SIGNS["command-is-judged-before-its-characters"] = lambda bench: b"error 3" in _typed(bench, b"h\x01lp\r")
SIGNS["ranges-are-not-judged"] = lambda bench: b"error 6" in _typed(bench, b"limit 400\r")
SIGNS["signs-before-numbers-are-taken"] = lambda bench: b"ok" in _typed(bench, b"limit +4\r")
SIGNS["arguments-too-many-are-ignored"] = lambda bench: b"ok" in _typed(bench, b"clear 1\r")
SIGNS["ok-is-missing-after-clear"] = lambda bench: _typed(bench, b"clear\r") == b"> "
SIGNS["keys-of-status-are-sorted"] = lambda bench: _typed(bench, b"status\r").startswith(b"accepted")
SIGNS["no-bits-are-said-as-0"] = lambda bench: b"faults: 0" in _typed(bench, b"faults\r")
SIGNS["help-forgets-a-command"] = lambda bench: b"echo ON" not in _typed(bench, b"help\r")
SIGNS["later-of-info-is-told"] = lambda bench: b"later" in _typed(bench, b"info\r")
SIGNS["long-lines-deafen-the-console"] = lambda bench: not _typed(bench, b"x" * 300 + b"\rclear\r")


@sign_of("test-drives-a-width-of-3")
def _(bench: Bench) -> bool:
    bench.order(Request.WATCHDOG, 60_000)
    _typed(bench, b"enable\rtest 0\r")
    return int(bench.read_back().pulses.width[0]) == 3


@sign_of("test-is-not-counted")
def _(bench: Bench) -> bool:
    bench.order(Request.WATCHDOG, 60_000)
    _typed(bench, b"enable\rtest 0\r")
    return bench.status().accepted == 0


@sign_of("stop-is-refused-in-fault")
def _(bench: Bench) -> bool:
    _heat(bench, 90)
    return b"error 6" in _typed(bench, b"stop\r")


# Versions, nonsense and long runs


def _of_version(bench: Bench, version: int) -> tuple[Reason, int]:
    """The reason and the version of the acknowledgement of a NO_OP of some version."""
    _sends(bench, forged(pack(Block(NoOp(), 1, restart=True)), at2=bytes([version])))
    (emulator,) = plugged()
    record = emulator.usb.bulk_in(0x81)
    assert isinstance(record, bytes)
    return Reason(record[3]), record[2]


SIGNS["later-versions-are-taken-as-version-1"] = lambda bench: _of_version(bench, 2)[0] is Reason.ACCEPTED
SIGNS["version-0-is-taken-as-version-1"] = lambda bench: _of_version(bench, 0)[0] is Reason.ACCEPTED
SIGNS["unknown-versions-are-refused-with-kind"] = lambda bench: _of_version(bench, 2)[0] is Reason.KIND
SIGNS["acknowledgements-repeat-the-version-of-the-block"] = lambda bench: _of_version(bench, 2)[1] == 2


def _without(bench: Bench, feature: Feature) -> bool:
    return feature not in bench.info.features


@sign_of("modulation-is-there-without-its-feature")
def _(bench: Bench) -> bool:
    return _without(bench, Feature.MODULATION) and bench.send(Samples(b"\1")).reason is Reason.ACCEPTED


@sign_of("read-back-is-there-without-its-feature")
def _(bench: Bench) -> bool:
    return _without(bench, Feature.READ_BACK) and bench.read_back() is not None


@sign_of("kinds-without-their-feature-are-unknown")
def _(bench: Bench) -> bool:
    return _without(bench, Feature.MODULATION) and bench.send(Samples(b"\1")).reason is Reason.KIND


@sign_of("the-state-is-looked-at-before-the-features")
def _(bench: Bench) -> bool:
    return _without(bench, Feature.MODULATION) and bench.send(Modulation(0, 1, 1)).reason is Reason.DISABLED


@sign_of("each-block-of-ones-takes-a-place-for-ever")
def _(bench: Bench) -> bool:
    for _ in range(3):
        _sends(bench, b"\xff" * 512)
    return bench.status().free == bench.info.queue_blocks - 3


@sign_of("restart-takes-a-place-for-ever")
def _(bench: Bench) -> bool:
    for number in range(3):
        bench.must(NoOp(), restart=True, number=number)
    return bench.status().free == bench.info.queue_blocks - 3


@sign_of("counters-stop-at-255")
def _(bench: Bench) -> bool:
    bench.send_all([NoOp()] * 300)
    return bench.status().accepted == 255


@sign_of("numbers-count-on-in-16-bits")
def _(bench: Bench) -> bool:
    bench.must(NoOp(), number=0xFFFF, restart=True)
    bench.must(NoOp())
    return bool(bench.must(NoOp()).flags)


@sign_of("clock-is-2000-ppm-fast")
def _(bench: Bench) -> bool:
    ticks, seconds = bench.clock().now, bench.line.time.monotonic()
    bench.wait(1)
    passed = (bench.clock().now - ticks) / 2e6 / (bench.line.time.monotonic() - seconds)
    return abs(passed - 1) > 0.001
