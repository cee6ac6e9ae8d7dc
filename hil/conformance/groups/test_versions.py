"""Versions and features: what a device claims to support, and what it does with the rest (chapter VER)."""

from __future__ import annotations

import struct
import zlib

import pytest
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import NotApplicable, Risk, case, expect
from phasewire.hil.conformance.tools.steps import SILENT, Wrong, begin, cut, far, forge, raw_records, refuse, some
from phasewire.hil.conformance.transports.usb import CONSOLE_OUT
from phasewire.protocol.blocks import (
    AmplitudeModulation,
    Body,
    Clock,
    Entries,
    Entry,
    NoOp,
    Output,
    PlaySequence,
    Samples,
    Slot,
    Update,
)
from phasewire.protocol.codes import Action, Feature, Reason, Request, State
from phasewire.protocol.replies import ANSWER_BYTES
from phasewire.protocol.requests import Setup

IN, OUT = 0xC1, 0x41


@case("VER-001", "VER-002")
def test_every_version_that_info_names_is_spoken(bench: Bench) -> None:
    """A NO_OP of each version from the oldest to the newest is accepted, because a device supports all between."""
    bench.must(NoOp())
    for version in range(bench.info.oldest_version, bench.info.newest_version + 1):
        (ack,) = bench.send_raw(forge(bench, NoOp(), version=version))
        expect(f"the reason for version {version}", ack.reason, Reason.ACCEPTED)


@case("VER-001", "VER-003", "USB-005")
def test_info_says_version_1(bench: Bench) -> None:
    """INFO names a range of versions that includes 1: protocol 01 of interface 0, and SPEC.md, are version 1."""
    oldest, newest = bench.ask(Request.INFO)[:2]
    assert oldest <= 1 <= newest, f"it speaks versions {oldest} to {newest}, should speak version 1"
    if bench.line.kind == "usb":
        expect("protocol of interface 0", bench.usb.device.get_active_configuration()[(0, 0)].bInterfaceProtocol, 1)


@case("VER-002", "VER-003", "ACK-002")
def test_an_unknown_version_is_answered_so_that_all_understand(bench: Bench) -> None:
    """The answer to a block of an unknown version has its number, and a version that device and host may both know."""
    begin(bench)
    oldest, newest = bench.info.oldest_version, bench.info.newest_version
    for version in some(bench, [version for version in (0, 2, 3, 127, 128, 255) if not bench.info.speaks(version)]):
        block = forge(bench, NoOp(), version=version, kind=bench.random.randrange(256), reserved=7)
        (record,) = raw_records(bench, [block])
        expect("bytes of the acknowledgement", len(record), 32)
        expect("magic", record[:2], b"PA")
        expect(f"version in the answer to version {version}", record[2], newest if version > newest else oldest)
        expect("reason", record[3], Reason.VERSION)
        expect("sequence", record[4:8], block[4:8])
        expect("checksum", int.from_bytes(record[28:], "little"), zlib.crc32(record[:28]))


@case("VER-002", "BLK-008", "NUM-004")
def test_a_block_of_another_version_has_no_effect(bench: Bench) -> None:
    """A block of an unsupported version is refused whatever its kind and flags, and changes no number."""
    begin(bench)
    other = (bench.info.newest_version + 1) % 256
    named = far(bench)
    bodies: list[Body] = [Update(SILENT, named), Slot(0, SILENT), Output(Action.DISABLE), Clock()]
    number = bench.must(NoOp()).sequence
    wrong = [Wrong("another version", forge(bench, body, version=other, flags=1), Reason.VERSION) for body in bodies]
    refuse(bench, wrong)
    expect("flags after them", bench.must(NoOp(), number=(number + 1) % 2**32).flags, 0)


# Features

NEEDED: dict[str, tuple[Feature, list[Body]]] = {
    "sequences": (Feature.SEQUENCES, [Slot(0, SILENT), Entries((Entry(0, 1),)), PlaySequence(0, 1)]),
    "modulation": (Feature.MODULATION, [Samples(b"\1"), AmplitudeModulation(0, 1, 1), Output(Action.END_MODULATION)]),
    "unattended": (Feature.UNATTENDED, [PlaySequence(0, 1, unattended=True)]),
}
"""Blocks that need a feature."""


@case("VER-005", "ACK-003", "REQ-002")
@pytest.mark.parametrize("name", list(NEEDED))
def test_a_block_that_needs_a_feature_is_unsupported_without_it(bench: Bench, name: str) -> None:
    """Without the feature its blocks are refused with UNSUPPORTED, off or on, and after FIELD and PULSE."""
    feature, bodies = NEEDED[name]
    if feature in bench.info.features:
        raise NotApplicable(f"it has the feature {feature.name}")
    bench.must(NoOp())
    refuse(bench, [Wrong(f"{feature.name} while off", forge(bench, body), Reason.UNSUPPORTED) for body in bodies])
    begin(bench)
    refuse(bench, [Wrong(f"{feature.name} while on", forge(bench, body), Reason.UNSUPPORTED) for body in bodies])
    refuse(bench, [Wrong("a field", forge(bench, body, reserved=1), Reason.FIELD) for body in bodies])


@case("VER-005", "ACK-003")
@pytest.mark.parametrize("name", list(NEEDED))
def test_a_feature_that_info_names_is_there(bench: Bench, name: str) -> None:
    """With the feature in INFO none of its blocks is refused with UNSUPPORTED."""
    feature, bodies = NEEDED[name]
    if feature not in bench.info.features:
        raise NotApplicable(f"it lacks the feature {feature.name}")
    begin(bench)
    for body in bodies:
        reason = bench.send(body).reason
        assert reason in (Reason.ACCEPTED, Reason.EMPTY), f"{body.KIND.name} is refused with {reason.name}"


@case("VER-005", "REQ-001", "REQ-007")
def test_pulses_is_answered_with_stall_without_read_back(bench: Bench) -> None:
    """A device without READ_BACK answers STALL to PULSES in every state, instead of invented data."""
    check_stall(bench, Feature.READ_BACK, Setup(IN, Request.PULSES, 0, 0, ANSWER_BYTES[Request.PULSES]))


@case("VER-005", line="usb", allow=(Risk.RESET,))
def test_detach_is_answered_with_stall_without_dfu(bench: Bench) -> None:
    """A device that takes no firmware over USB answers STALL to DETACH, and does not change."""
    check_stall(bench, Feature.DFU, Setup(0x21, 0, 1000, 3, 0))


@case("VER-005", "REQ-001", "REQ-014", allow=(Risk.RESET, Risk.FLASH))
def test_revert_is_answered_with_stall_without_its_feature(bench: Bench) -> None:
    """A device without a factory image answers STALL to REVERT, and does not restart."""
    check_stall(bench, Feature.REVERT, Setup(OUT, Request.REVERT, 0, 0, 0))


def check_stall(bench: Bench, feature: Feature, setup: Setup) -> None:
    """Check that a request is answered with STALL while off and while something plays, if a feature is missing."""
    if feature in bench.info.features:
        raise NotApplicable(f"it has the feature {feature.name}")
    expect(f"the answer without {feature.name} while off", bench.request(setup), None)
    expect("the state", bench.status().state, State.OFF)
    begin(bench)
    bench.wait_until(bench.must(Update(SILENT)).commit_period)
    expect(f"the answer without {feature.name} while an update plays", bench.request(setup), None)
    expect("the state", bench.status().state, State.PLAYING)


@case("VER-005", "REQ-007", features=Feature.READ_BACK)
def test_read_back_is_there(bench: Bench) -> None:
    """With READ_BACK in INFO PULSES is answered in every state that a case can bring about by itself."""
    bench.read_back()
    begin(bench)
    bench.read_back()
    bench.wait_until(bench.must(Update(SILENT)).commit_period)
    bench.read_back()


@case("VER-005", "VER-008", "SER-010", "CON-002")
def test_frames_and_text_come_together(bench: Bench) -> None:
    """With CONSOLE in INFO a serial line has frames and text; without it the device has no serial line."""
    if bench.line.kind == "usb" and Feature.CONSOLE not in bench.info.features:
        expect("bytes that a missing console takes", bench.usb.write(CONSOLE_OUT, b"\r", 0.05), 0)
        return
    assert Feature.CONSOLE in bench.info.features, "INFO does not name CONSOLE, and this is a serial line"
    line = bench.serial
    line.enter_console()
    answer = line.command("faults")
    assert answer.endswith("ok\r\n"), f"the command faults is answered {answer!r}, should be with ok"
    line.enter_frames()
    expect("INFO in frames", line.request(Setup(IN, Request.INFO, 0, 0, 64)), bench.info.encode())


@case("VER-007", "ACK-002", "REQ-003", "REQ-006", "REQ-008")
def test_version_1_sends_nothing_but_version_1(bench: Bench) -> None:
    """A device that supports version 1 sends only the codes, bits and reserved bytes of version 1."""
    begin(bench)
    blocks = [
        forge(bench, NoOp()),
        forge(bench, Clock()),
        forge(bench, Update(SILENT, 1)),
        forge(bench, NoOp(), kind=0),
    ]
    for record in raw_records(bench, blocks):
        expect("version of an acknowledgement", record[2], 1)
        assert record[3] <= 16, f"reason is {record[3]}, should be 0 to 16"
        expect("unknown flags of an acknowledgement", record[24] & ~0b11, 0)
        assert record[26] <= 6, f"state is {record[26]}, should be 0 to 6"
        expect("the reserved byte of an acknowledgement", record[27], 0)
    bench.order(Request.WATCHDOG, 10)
    bench.outlast(0.05)
    for record in [bench.ask(Request.STATUS), *cut(bench.line.receive_records(0.05))]:
        _, version, state, faults, refusal, flags = struct.unpack_from("<2sBBHBB", record)
        expect("version of a status", version, 1)
        assert state <= 6, f"state is {state}, should be 0 to 6"
        expect("unknown faults", faults & ~0x7F, 0)
        assert refusal <= 16, f"last_refusal is {refusal}, should be 0 to 16"
        expect("unknown flags of a status", flags & ~0b111, 0)
        expect("the reserved bytes of a status", record[58:60], bytes(2))
    expect("the reserved bytes of CLOCK", bench.ask(Request.CLOCK)[20:], bytes(4))
    reports = bench.ask(Request.PROCESSORS)
    expect("the reserved bytes of PROCESSORS", reports[15::16], bytes(10))
    expect("unknown faults in PROCESSORS", [fault & ~0x7F for fault in reports[0::16]], [0] * 10)
    expect("unknown faults in PROCESSORS", reports[1::16], bytes(10))
