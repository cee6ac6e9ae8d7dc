"""The golden vectors: that the file is what the code makes, and that each case is right by other means than that code.

Bytes are read here with the layouts that SPEC.md prints, by construct's, by zlib, hashlib and cryptography's verifier,
or are written out; what a case says in words is taken from the file.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
import struct
import zlib
from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest
from cobs import cobs
from construct import ConstructError
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from phasewire.__main__ import main
from phasewire.errors import ChainError, ImageError
from phasewire.protocol import Action, Fault, Kind, Reason, Request, State
from phasewire.protocol.chain import decode as decode_message
from phasewire.protocol.codes import (
    AckFlag,
    Bank,
    ChannelEnd,
    ConsoleCode,
    DescriptorType,
    DfuState,
    DfuStatus,
    Feature,
    Flag,
    FrameKind,
    ImageReason,
    Memory,
    Outcome,
    StatusFlag,
    Target,
)
from phasewire.protocol.dfu import DfuEvent
from phasewire.protocol.firmware import Trust, parse
from phasewire.protocol.layout import chain, firmware, replies
from phasewire.protocol.layout.blocks import BLOCK
from phasewire.protocol.layout.serial import FRAME
from phasewire.protocol.replies import ANSWER_BYTES
from phasewire.protocol.states import Event
from phasewire.protocol.vectors import text

from tests.protocol.blocks import reason_by_construct
from tests.specification import SPEC, clauses, codes, hex_examples, layout_rows, table

FILE = Path(__file__).parents[2] / "protocol" / "vectors.json"
VECTORS: dict[str, Any] = json.loads(FILE.read_text(encoding="ascii"))

Case = dict[str, Any]
BY_ITSELF = [reason for reason in Reason if 0 < reason <= Reason.PULSE]


def cases(*parts: str) -> list[Case]:
    """The cases of some parts."""
    return [case for part in parts for case in VECTORS[part]["vectors"]]


def every(*parts: str) -> pytest.MarkDecorator:
    """Run a test with every case of some parts."""
    found = cases(*parts)
    return pytest.mark.parametrize("case", found, ids=[case["name"] for case in found])


# The file


def test_the_file_is_what_the_code_makes() -> None:
    assert FILE.read_bytes() == text().encode("ascii"), "protocol/vectors.json is old: make vectors"


def test_the_command_writes_the_file(tmp_path: Path, capfdbinary: pytest.CaptureFixture[bytes]) -> None:
    for arguments in ([], ["-o", "-"]):
        with pytest.raises(SystemExit) as exited:
            main(["vectors", *arguments])
        assert not exited.value.code
        assert capfdbinary.readouterr().out == FILE.read_bytes()
    with pytest.raises(SystemExit) as exited:
        main(["vectors", "--output", str(tmp_path / "out.json")])
    assert not exited.value.code
    assert (tmp_path / "out.json").read_bytes() == FILE.read_bytes()


def test_the_file_can_be_reviewed() -> None:
    assert FILE.stat().st_size < 400_000
    assert len(FILE.read_text(encoding="ascii").splitlines()) > sum(len(cases(part)) for part in PARTS)


PARTS = [name for name, part in VECTORS.items() if isinstance(part, dict)]
TABLES = {"modulated_widths", "powers", "device_transitions", "dfu_transitions"}


def test_every_case_has_a_name_of_its_own_and_says_what_it_shows() -> None:
    named = [case for part in PARTS for case in cases(part) if part not in TABLES or "name" in case]
    assert all(case["shows"] and case["name"] for case in named)
    assert len({case["name"] for case in named}) == len(named) > 450


def test_clauses_exist() -> None:
    refused = [case for part in PARTS if part.startswith("refused") for case in cases(part)]
    assert {case["clause"] for case in refused} <= set(clauses())
    for part in PARTS:
        named = re.findall(r"[A-Z]{3}-\d{3}", VECTORS[part]["about"])
        assert set(named) <= set(clauses())


def test_the_examples_of_the_specification_are_among_them() -> None:
    given = {case[key] for part in PARTS for case in cases(part) for key in ("hex",) if isinstance(case.get(key), str)}
    for name, data in hex_examples().items():
        on_the_chain = name in ChannelEnd.__members__
        assert (data[:-1] if on_the_chain else data).hex() in given, name


def names(parts: Iterable[str], key: str) -> set[Any]:
    """What stands under a key, in the cases of some parts or in their fields."""
    found = set()
    for case in cases(*parts):
        value = case.get(key, (case.get("fields") or {}).get(key))
        found |= set(value) if isinstance(value, list) else {value}
    return found


@pytest.mark.parametrize(
    ("parts", "key", "codes_"),
    [
        (["blocks"], "kind", Kind),
        (["blocks"], "flags", Flag),
        (["blocks"], "action", Action),
        (["refused_blocks"], "reason", BY_ITSELF),
        (["records"], "reason", Reason),
        (["records"], "state", State),
        (["records"], "faults", Fault),
        (["records"], "flags", [*AckFlag, *StatusFlag]),
        (["answers"], "features", Feature),
        (["requests"], "name", [*(f"request-{request.name}" for request in Request)]),
        (
            ["answers"],
            "request",
            [request for request in Request if request in ANSWER_BYTES and request is not Request.STATUS],
        ),
        (["chain_messages"], "kind", ChannelEnd),
        (["chain_messages"], "memory", Memory),
        (["frames"], "type", FrameKind),
        (["frames"], "outcome", Outcome),
        (["commands"], "error", [code for code in ConsoleCode if code is not ConsoleCode.REFUSED]),
        (["commands"], "command", [row[0].strip("`") for row in table("commands")]),
        (["images", "refused_images"], "reason", ImageReason),
        (["refused_images"], "dfu_status", [DfuStatus.TARGET, DfuStatus.FILE]),
        (["boot_orders"], "order", Bank),
    ],
)
def test_every_code_occurs(parts: list[str], key: str, codes_: Iterable[Any]) -> None:
    wanted = {code if isinstance(code, str) else code.name for code in codes_}
    assert wanted <= names(parts, key)


def test_every_outcome_of_a_signature_occurs() -> None:
    assert {case["outcome"] for case in cases("signatures")} == {trust.name for trust in Trust} | {"SIGNATURE"}


def test_both_records_and_every_kind_of_target_occur() -> None:
    assert {case["record"] for case in cases("records")} == {"ACK", "STATUS"}
    assert {part["target"] for case in cases("images") for part in case["segments"]} == {each.name for each in Target}


def test_every_descriptor_that_can_be_asked_for_is_answered_at_run_time() -> None:
    inside = {"INTERFACE", "ENDPOINT", "INTERFACE_ASSOCIATION", "DEVICE_CAPABILITY", "DFU_FUNCTIONAL", "CS_INTERFACE"}
    answered = {
        DescriptorType(bytes.fromhex(case["setup"])[3]).name
        for case in cases("descriptors")
        if case["hex"] and case["setup"].startswith("80")
    }
    assert answered == set(DescriptorType.__members__) - inside


# Reading by the layouts that the specification prints

CODES = {
    "kind": "Kind",
    "action": "Action",
    "reason": "Reason",
    "last_refusal": "Reason",
    "state": "State",
    "memory": "Memory",
    "bank": "Bank",
    "answer": "ChannelEnd",
}
SIGNED = {"temperature_c", "drift"}


def pulses(packed: bytes) -> list[tuple[int, int]]:
    """Phase and width of each pulse, as PUL-005 says it: 24-bit numbers, the first pulse in the low half."""
    found = []
    for at in range(0, len(packed), 3):
        both = int.from_bytes(packed[at : at + 3], "little")
        found += [(word & 0x7F, word >> 7) for word in (both & 0xFFF, both >> 12)]
    return found


def expanded(runs: list[list[int]]) -> list[tuple[int, int]]:
    return [(phase, width) for phase, width, times in runs for _ in range(times)]


def flags(mark: str) -> dict[str, int]:
    """Values of flags; the specification numbers faults by their bits."""
    return {name: 1 << value if mark == "Fault" else value for name, value in codes(mark).items()}


def read(layout: str, data: bytes) -> dict[str, bytes]:
    """The bytes of each field of a layout that the specification prints."""
    rows = layout_rows(layout)
    assert sum(size for _, size, _ in rows) == len(data)
    return {field: data[offset : offset + size] for offset, size, field in rows}


def means(field: str, raw: bytes, said: Any, flag_table: str = "") -> bool:
    """Whether a field's bytes are what a case says."""
    number = int.from_bytes(raw, "big" if field == "node" else "little", signed=field in SIGNED)
    if field == "pulses":
        return pulses(raw) == expanded(said)
    if field in ("flags", "faults", "features") and isinstance(said, list):
        table_ = flags({"faults": "Fault", "features": "Feature"}.get(field, flag_table))
        return number == sum(table_[name] if isinstance(name, str) else name for name in said)
    if field in CODES and isinstance(said, str):
        return codes(CODES[field])[said] == number
    if isinstance(said, str):
        return raw.hex() == said
    if isinstance(said, list):
        return list(raw) == said
    return number == int(said or 0)  # the bank of a processor that is not there


def sealed(data: bytes) -> bool:
    """Whether the last four bytes are the CRC-32 of all before."""
    return zlib.crc32(data[:-4]) == int.from_bytes(data[-4:], "little")


# Pulses and blocks


def test_modulated_widths_are_the_formula_s() -> None:
    """In plain double precision, value by value; PUL-006 says that no value is close to a tie."""
    rows = cases("modulated_widths")
    assert [row["sample"] for row in rows] == list(range(256))
    for row in rows:
        expected = [
            math.floor(50 / math.pi * math.asin(min(1.0, row["sample"] / 255 * math.sin(math.pi * w / 50))) + 0.5)
            for w in range(26)
        ]
        assert row["widths"] == expected
    assert rows[255]["widths"] == list(range(26))


def test_powers_are_the_specification_s() -> None:
    said = SPEC.split("<!-- power -->")[1].split("**SAF-007**")[0]
    power = [int(number) for line in re.findall(r"\| power \| (.*) \|", said) for number in line.split(" | ")]
    rows = cases("powers")
    assert [(row["width"], row["power"]) for row in rows[:26]] == list(enumerate(power))
    for row in rows[26:]:
        widths = [width for _, width in expanded(row["pulses"])]
        assert len(widths) == 320
        assert row["total_drive"] == sum(power[width] for width in widths)


@every("pulse_pairs")
def test_pulses(case: Case) -> None:
    assert pulses(bytes.fromhex(case["hex"])) == [tuple(pair) for pair in case["pulses"]]
    assert case["begins"] == [math.floor(Fraction(phase - width, 2)) % 50 for phase, width in case["pulses"]]


@every("blocks")
def test_blocks(case: Case) -> None:
    data, said = bytes.fromhex(case["hex"]), dict(case["fields"])
    assert case["reason"] == "ACCEPTED"
    assert reason_by_construct(data) is Reason.ACCEPTED
    raw = read("BLOCK", data)
    payload = raw.pop("payload")
    assert raw.pop("magic") + raw.pop("version") == b"PW\1"
    assert int.from_bytes(raw.pop("checksum"), "little") == zlib.crc32(data[:28] + bytes(4) + data[32:])
    expected = b""
    if (runs := said.pop("pulses", None)) is not None:
        assert pulses(payload) == expanded(runs)
        expected = payload
    if (entries := said.pop("entries", None)) is not None:
        expected = b"".join(struct.pack("<HH", *entry) for entry in entries)
        assert said["count"] == len(entries)
    if (samples := said.pop("samples", None)) is not None:
        expected = bytes.fromhex(samples)
        assert said["count"] == len(expected)
    assert payload == expected.ljust(480, b"\0")
    assert {field for field in raw if not means(field, raw[field], said.pop(field, 0), "Flag")} == set()
    assert not said


@every("refused_blocks")
def test_refused_blocks(case: Case) -> None:
    reason = reason_by_construct(bytes.fromhex(case["hex"]))
    assert (case["reason"], case["code"]) == (reason.name, codes("Reason")[reason.name])
    if reason is not Reason.FIELD:  # a field has clauses of its own
        said = {row[1].strip("`"): row[2] for row in table("table: Reason")}
        assert case["clause"] == said[reason.name]


def test_refused_fields_are_as_many_as_the_clause_asks_for() -> None:
    """Every field that some kind does not use is set in one that does not, and every range is left at its end."""
    changed = {case["name"] for case in cases("refused_blocks") if case["reason"] == "FIELD"}
    for field in ("period", "first", "count", "hold", "repeats", "action"):
        assert any(f"field-{field}-in-" in name for name in changed), field


@every("block_numbers")
def test_numbers(case: Case) -> None:
    """Serial arithmetic as the difference of two signed 32-bit numbers."""
    ahead = struct.unpack("<i", struct.pack("<I", (case["number"] - case["last"]) % 2**32))[0]
    assert case["follows"] == (ahead > 0)
    assert case["missing"] == (ahead - 1 if ahead > 0 else None)


# Records and answers


@every("records")
def test_records(case: Case) -> None:
    data = bytes.fromhex(case["hex"])
    raw = read(case["record"], data)
    assert sealed(data)
    assert raw["magic"] + raw["version"] == {"ACK": b"PA\1", "STATUS": b"PS\1"}[case["record"]]
    flag_table = {"ACK": "AckFlag", "STATUS": "StatusFlag"}[case["record"]]
    assert not any(raw["reserved"])
    assert set(raw) - set(case["fields"]) == {"magic", "version", "reserved", "checksum"}
    assert [field for field, said in case["fields"].items() if not means(field, raw[field], said, flag_table)] == []


@every("refused_records")
def test_refused_records(case: Case) -> None:
    data = bytes.fromhex(case["hex"])
    layout = replies.ACK if "ack" in case["name"] else replies.STATUS
    with pytest.raises(ConstructError):
        layout.parse(data)
    assert sealed(data) is not any(word in case["name"] for word in ("checksum", "short"))


def taken_apart(packet: bytes) -> list[bytes]:
    """Records by their magic: 32 bytes or 64."""
    found = []
    while packet:
        size = {b"PA": 32, b"PS": 64}[packet[:2]]
        assert len(packet) >= size
        found.append(packet[:size])
        packet = packet[size:]
    return found


@every("packets")
def test_packets(case: Case) -> None:
    known = {record["name"]: record["hex"] for record in cases("records")}
    found = taken_apart(bytes.fromhex(case["hex"]))
    assert [record.hex() for record in found] == [known[name] for name in case["records"]]
    assert len(case["hex"]) // 2 <= 512


@every("refused_packets")
def test_refused_packets(case: Case) -> None:
    with pytest.raises((KeyError, AssertionError)):
        taken_apart(bytes.fromhex(case["hex"]))


ANSWERS = {
    "INFO": (replies.INFO, "INFO"),
    "CLOCK": (replies.CLOCK, "CLOCK"),
    "PULSES": (replies.READ_BACK, "READ_BACK"),
}


@every("answers")
def test_answers(case: Case) -> None:
    data, said = bytes.fromhex(case["hex"]), case["fields"]
    if case["request"] == "WIRING":
        assert [int.from_bytes(data[at : at + 2], "little") for at in range(0, 640, 2)] == said["channels"]
        assert sorted(said["channels"]) == list(range(320))
        return
    pieces = [(data, said, ANSWERS[case["request"]][1])] if case["request"] in ANSWERS else []
    if case["request"] == "PROCESSORS":
        pieces = [(data[16 * n : 16 * n + 16], report, "PROCESSOR_REPORT") for n, report in enumerate(said["reports"])]
        assert (len(data), len(pieces)) == (160, 10)
    for piece, fields, layout in pieces:
        raw = read(layout, piece)
        assert not any(raw.get("reserved", b""))
        assert set(raw) - set(fields) <= {"reserved"}
        assert [field for field, value in fields.items() if not means(field, raw[field], value)] == []


@every("refused_answers")
def test_refused_answers(case: Case) -> None:
    data = bytes.fromhex(case["hex"])
    if case["request"] == "WIRING":
        channels = [int.from_bytes(data[at : at + 2], "little") for at in range(0, len(data), 2)]
        assert sorted(channels) != list(range(320))
        return
    layout = replies.PROCESSOR_REPORTS if case["request"] == "PROCESSORS" else ANSWERS[case["request"]][0]
    with pytest.raises(ConstructError):
        layout.parse(data)


def test_transitions_are_the_specification_s() -> None:
    rows = cases("device_transitions")
    found = {(row["state"], row["event"]): row["next"] for row in rows}
    assert len(rows) == len(found) == len(State) * len(Event)
    listed = {
        (state, event.strip("`")): behind.strip("`")
        for before, event, behind in (row[:3] for row in table("table: transitions"))
        for state in before.replace("`", "").split(", ")
    }
    for (state, event), behind in found.items():
        assert behind == ("OFF" if event == "RESTART" else listed.get((state, event), state))


# USB


@every("requests", "refused_requests")
def test_requests(case: Case) -> None:
    setup = bytes.fromhex(case["hex"])
    assert len(setup) == 8
    assert dict(zip(case["fields"], struct.unpack("<BBHHH", setup), strict=True)) == case["fields"]


@every("requests")
def test_requests_are_the_specification_s(case: Case) -> None:
    fields = case["fields"]
    rows = {int(row[0]): row for row in table("table: Request")}
    if fields["request_type"] not in (0xC1, 0x41):
        return
    _, name, direction, value, _ = rows[fields["request"]]
    assert case["name"].startswith(f"request-{name.strip('`')}")
    assert fields["request_type"] == {"in": 0xC1, "out": 0x41}[direction]
    assert fields["index"] == 0
    assert value or fields["value"] == 0
    assert (case["answer"] == "nothing") == (direction == "out")


def test_requests_ask_for_as_much_as_is_answered() -> None:
    sizes = {case["request"]: len(case["hex"]) // 2 for case in cases("answers")} | {"STATUS": 64}
    said = {case["name"]: case for case in cases("requests")}
    for name, size in sizes.items():
        assert said[f"request-{name}"]["answer"] == f"{size} bytes"
        assert said[f"request-{name}"]["fields"]["length"] == size


def test_refused_requests_differ_from_those_that_are_carried_out() -> None:
    carried_out = {case["hex"] for case in cases("requests")}
    assert not carried_out & {case["hex"] for case in cases("refused_requests")}


@every("descriptors")
def test_descriptors(case: Case) -> None:
    """Each descriptor of a chain begins with its length, and the whole with the type that was asked for."""
    request_type, request, value, index, _ = struct.unpack("<BBHHH", bytes.fromhex(case["setup"]))
    if case["hex"] is None:
        assert case["answer"] == "STALL"
        return
    data = bytes.fromhex(case["hex"])
    assert case["answer"] == f"{len(data)} bytes"
    if request_type == 0xC0:
        assert (request, value, index) == (0x20, 0, 7)
        assert struct.unpack_from("<HHIH", data) == (10, 0, 0x06030000, len(data))
        return
    assert (request_type, request) == (0x80, 6)
    assert data[1] == value >> 8
    whole = {0x02, 0x07, 0x0F}
    assert (int.from_bytes(data[2:4], "little") if data[1] in whole else data[0]) == len(data)
    at = 0
    while at < len(data):
        assert data[at] >= 2
        at += data[at]
    assert at == len(data)


def test_descriptors_are_those_of_the_specification() -> None:
    """The printed ones, and the others as USB-010 and USB-013 derive them."""
    printed = {name.removeprefix("USB_"): data for name, data in hex_examples().items() if name.startswith("USB_")}
    high = printed["CONFIGURATION"]
    full = high.replace(bytes([2, 0, 2, 1]), bytes([2, 64, 0, 1])).replace(bytes([16, 0, 9]), bytes([16, 0, 32]))
    dfu = printed["DFU_CONFIGURATION"]

    def at_other_speed(configuration: bytes) -> bytes:
        return configuration[:1] + b"\x07" + configuration[2:]

    device, qualifier = printed["DEVICE"], printed["QUALIFIER"]
    ms_os = printed["MS_OS"]
    dfu_ms_os = ms_os[:8] + (162).to_bytes(2, "little") + ms_os[-152:]
    expected = {
        "DEVICE-0": (device, device, device[:4] + bytes(3) + device[7:10] + b"\2" + device[11:]),
        "CONFIGURATION-0": (high, full, dfu),
        "OTHER_SPEED_CONFIGURATION-0": (at_other_speed(full), at_other_speed(high), at_other_speed(dfu)),
        "DEVICE_QUALIFIER-0": (qualifier, qualifier, qualifier[:4] + bytes(3) + qualifier[7:]),
        "BOS-0": (*[printed["BOS"]] * 2, printed["BOS"].replace(b"\x52\1", b"\xa2\0")),
        "MS-OS": (ms_os, ms_os, dfu_ms_os),
    }
    found = {case["name"]: case["hex"] for case in cases("descriptors")}
    for name, answers in expected.items():
        for mode, answer in zip(("run-time-high-speed", "run-time-full-speed", "DFU-mode"), answers, strict=True):
            assert found[f"descriptor-{mode}-{name}"] == answer.hex()


def test_strings_are_the_specification_s() -> None:
    columns = {"run time, high speed": 1, "DFU mode": 2}
    for mode, column in columns.items():
        said = {int(row[0]): re.sub(r" \(.*", "", row[column]) for row in table("strings")}
        said |= {2: "phasewire vectors", 3: "PW-0001"}
        for index in range(1, 7):
            name = f"descriptor-{mode.replace(', ', '-').replace(' ', '-')}-STRING-{index}-0409"
            (case,) = [case for case in cases("descriptors") if case["name"] == name]
            found = bytes.fromhex(case["hex"])[2:].decode("utf-16-le") if case["hex"] else ""
            assert found == said[index]


# The chain

LAYOUTS = {end.name: getattr(chain, end.name) for end in ChannelEnd}
UNGUARDED = {"SLICE", "COMMIT"}


@every("chain_messages")
def test_chain_messages(case: Case) -> None:
    data, said = bytes.fromhex(case["hex"]), dict(case["fields"])
    raw = read(case["kind"], data + b"\1")
    assert raw["end"] == b"\1"
    assert LAYOUTS[case["kind"]].parse(data + b"\1")
    assert int.from_bytes(raw["channel_end"], "little") == codes("ChannelEnd")[case["kind"]]
    assert case["kind"] in UNGUARDED or sealed(data)
    if "data" in raw:
        raw["data"] = raw["data"][: len(said["data"]) // 2]
    assert set(raw) - set(said) <= {"channel_end", "checksum", "end"}
    faults = said.pop("faults", None)
    assert faults is None or faults == int.from_bytes(raw["faults"], "little")
    assert [field for field, value in said.items() if not means(field, raw[field], value)] == []


@every("refused_chain_messages")
def test_refused_chain_messages(case: Case) -> None:
    data = bytes.fromhex(case["hex"])
    for layout in LAYOUTS.values():
        with pytest.raises(ConstructError):
            layout.parse(data + b"\1")
    with pytest.raises(ChainError) as refused:
        decode_message(data + b"\1")
    assert refused.value.clause == case["clause"]
    if re.match(r"refused-(load|program|collect|number|report|playing|identity)", case["name"]):
        assert sealed(data) is not any(word in case["name"] for word in ("checksum", "elsewhere"))


@every("slices_and_commits")
def test_slices_and_commits(case: Case) -> None:
    slice_, commit = (read(name.upper(), bytes.fromhex(case[name]) + b"\1") for name in ("slice", "commit"))
    assert slice_["node"] + slice_["channel_end"] == b"\0\3\1"
    assert commit["node"] + commit["channel_end"] == b"\0\3\2"
    guarded = zlib.crc32(slice_["pulses"] + commit["period"])
    assert case["plays"] == (guarded == int.from_bytes(commit["checksum"], "little"))


# Serial lines


def content(frame: bytes) -> bytes:
    """Type and body of a frame, by the cobs package and zlib."""
    assert frame.index(0) == len(frame) - 1
    found = bytes(cobs.decode(frame[:-1]))
    assert sealed(found)
    return found[:-4]


@every("frames")
def test_frames(case: Case) -> None:
    data, body = bytes.fromhex(case["hex"]), bytes.fromhex(case["body"])
    assert content(data) == bytes([case["code"]]) + body
    assert cobs.encode(cobs.decode(data[:-1])) == data[:-1]
    assert FRAME.parse(data).kind == case["code"] == codes("FrameKind")[case["type"]]
    goes = {row[1].strip("`"): row[2].split(":")[0] for row in table("table: FrameKind")}
    assert case["goes"] == goes[case["type"]]
    said = dict(case.get("fields", {}))
    if case["type"] in ("REQUEST", "REPLY"):
        outcome = said.pop("outcome", None)
        assert bytes.fromhex(said.pop("data")) == body[9 if case["type"] == "REQUEST" else 2 :]
        for offset, size, field in layout_rows(f"SERIAL_{case['type']}"):
            found = int.from_bytes(body[offset : offset + size], "little")
            assert found == (codes("Outcome")[outcome] if field == "outcome" else said[field])


def test_the_full_groups_are_where_they_are_said_to_be() -> None:
    heads = {name: bytes.fromhex(case["hex"]) for case in cases("frames") for name in [case["name"]]}
    assert heads["frame-group-253"][3] == 0xFE
    assert heads["frame-group-254"][3] == 0xFF
    assert len(heads["frame-group-254"]) == 3 + 255 + 1
    assert heads["frame-group-255"][3] == 0xFF
    assert heads["frame-group-255"][258:] == bytes([2, heads["frame-group-255"][259], 0])
    assert heads["frame-group-before-zero"][3] == 0xFF
    assert heads["frame-group-before-zero"][258] == 1
    assert max(len(data) for data in heads.values()) == 658


@every("refused_frames")
def test_refused_frames(case: Case) -> None:
    data = bytes.fromhex(case["hex"])
    assert data[-1] == 0
    if len(data) <= 658:
        with pytest.raises(ConstructError):
            FRAME.parse(data)
    if case["clause"] in ("SER-004", "SER-007", "SER-008"):
        content(data)  # nothing else is wrong with it


@every("streams")
def test_streams(case: Case) -> None:
    """SER-010 again, on all the bytes at once."""
    data, frames = bytes.fromhex(case["hex"]), False
    events: list[dict[str, Any]] = []
    while data:
        piece, zero, data = data.partition(b"\0")
        if not frames:
            events += [{"text": piece.hex()}] if piece else []
            events += [{"mode": "FRAMES"}] if zero else []
            frames = bool(zero)
        elif piece and zero:
            try:
                assert len(piece) < 658
                found = FRAME.parse(piece + zero)
                frames = found.kind != FrameKind.CONSOLE
                body = content(piece + zero)[1:]
                events.append(
                    {"frame": FrameKind(found.kind).name, "body": body.hex()} if frames else {"mode": "CONSOLE"}
                )
            except (ConstructError, AssertionError):
                events.append({"dropped": 1})
    assert case["events"] == events


TYPED = {
    "cr": (["status"], b"status\r\n"),
    "lf": (["status"], b"status\r\n"),
    "crlf": (["status", "clock"], b"status\r\nclock\r\n"),
    "lfcr": (["status", ""], b"status\r\n\r\n"),
    "backspace": (["status"], b"stut\x08 \x08\x08 \x08atus\r\n"),
    "backspace-empty": (["ok"], b"ok\r\n"),
    "cancel": (["clock"], b"abc" + b"\x08 \x08" * 3 + b"de" + b"\x08 \x08" * 2 + b"clock\r\n"),
    "unprintable": (["st\xe4tus\t"], b"st?tus?\r\n"),
    "full": (["x" * 80], b"x" * 80 + b"\r\n"),
    "too-long": (["x" * 80 + "y"], b"x" * 80 + b"\a\a\r\n"),
    "too-long-taken-back": (["x" * 80], b"x" * 80 + b"\a\a\r\n"),
    "no-echo": (["stu"], b""),
}
"""What the lines are and what the terminal gets, written out by CON-003."""


def test_typing() -> None:
    found = {
        case["name"].removeprefix("typing-"): (case["lines"], bytes.fromhex(case["shown"])) for case in cases("typing")
    }
    assert found == TYPED


@every("commands")
def test_commands(case: Case) -> None:
    """CON-006 in the words of the specification's tables."""
    line = case["line"]
    forms = {row[0].strip("`"): [int(number) for number in re.findall(r"\d+", row[1])] for row in table("commands")}
    name, *arguments = re.findall(r"[!-~]+", line) or [None]
    if len(line) > 80:
        expected = "LENGTH"
    elif not re.fullmatch(r"[ -~]*", line):
        expected = "CHARACTER"
    elif name is None:
        expected = ""
    elif name not in forms:
        expected = "COMMAND"
    elif len(arguments) != bool(forms[name]) or not all(re.fullmatch("[0-9]+", word) for word in arguments):
        expected = "ARGUMENTS"
    elif arguments and not forms[name][0] <= int(arguments[0]) <= forms[name][1]:
        expected = "RANGE"
    else:
        expected = ""
    if expected:
        assert (case["error"], case["code"]) == (expected, codes("ConsoleCode")[expected])
    else:
        assert (case["command"], case["argument"]) == (name, int(arguments[0]) if arguments else None)


def in_words(key: str, value: Any) -> str:
    """A field of another case as CON-007 writes it: its name or number, names joined by +, none where there is none."""
    if key == "hardware":
        return next(name for name, code in codes("Hardware").items() if code == value)
    if isinstance(value, list):
        return (".".join(map(str, value)) if key == "firmware" else "+".join(map(str, value))) or "none"
    return "0" if value is None else str(value)


@every("exchanges")
def test_exchanges(case: Case) -> None:
    *lines, last, prompt = case["answer"].split("\r\n")
    assert (last, prompt) == ("ok", "> ")
    known = {case["name"]: case["fields"] for case in cases("answers", "records")}
    said = [tuple(line.split(": ", 1)) for line in lines]
    of = known.get(case.get("of", ""), {})
    expected = {
        "help": [
            (f"{row[0]} {row[1].split()[0].upper()}" if row[1] else row[0], row[3])
            for row in ([cell.strip("`") for cell in row] for row in table("commands"))
        ],
        "version": [(key, in_words(key, of.get(key))) for key in ("oldest_version", "newest_version", "firmware")],
        "info": [(key, in_words(key, value)) for key, value in of.items() if key != "later"],
        "status": [(key, in_words(key, value)) for key, value in of.items()],
        "faults": [("faults", in_words("faults", of.get("faults")))],
        "boards": [
            (f"processor {n}", ", ".join(f"{key} {in_words(key, value)}" for key, value in report.items()))
            for n, report in enumerate(of.get("reports", ()))
        ],
        "clock": [(key, str(value)) for key, value in known["clock-reading"].items()],
        "pulses 17": [("phase", "0"), ("width", "2")],
        "enable": [],
    }
    assert said == expected[case["line"]]


# Firmware


def test_the_test_keys() -> None:
    rfc_8032 = "d75a980182b10ab7d54bfed3c964073a0ee172f3daa62325af021a68f707511a"
    assert cases("test_keys")[0]["public_key"] == rfc_8032
    assert VECTORS["test_keys"]["about"].startswith("TEST KEYS")
    for case in cases("test_keys"):
        public = Ed25519PrivateKey.from_private_bytes(bytes.fromhex(case["seed"])).public_key().public_bytes_raw()
        assert public.hex() == case["public_key"]
        assert hashlib.sha256(public).hexdigest()[:16] == case["key_id"]


def public_key(key_id: str) -> Ed25519PublicKey:
    (found,) = [case["public_key"] for case in cases("test_keys") if case["key_id"] == key_id]
    return Ed25519PublicKey.from_public_bytes(bytes.fromhex(found))


@every("images")
def test_images(case: Case) -> None:
    file = bytes.fromhex(case["hex"])
    assert case["reason"] == "ACCEPTED"
    image, suffix = file[:-16], read("DFU_SUFFIX", file[-16:])
    assert zlib.crc32(file[:-4]) ^ 0xFFFFFFFF == int.from_bytes(suffix["checksum"], "little")
    assert suffix["dfu_version"] + suffix["signature"] + suffix["length"] == bytes.fromhex("0001 554644 10")
    assert {name: int.from_bytes(suffix[name], "little") for name in case["suffix"]} == case["suffix"]
    assert f"{case['suffix']['release']:04x}" == "{:02d}{}{}".format(*case["version"])

    header = read("IMAGE_HEADER", image[:32])
    assert header["magic"] + header["version"] == b"PWFW\1"
    assert [header[part][0] for part in ("major", "minor", "patch")] == case["version"]
    assert int.from_bytes(header["total"], "little") == len(image)
    assert int.from_bytes(header["hardware"], "little") == codes("Hardware")[case["hardware"]]
    assert header["protocol"][0] == case["protocol"]
    assert header["key_id"].hex() == case["key_id"]
    end = 32 + 48 * len(case["segments"])
    assert int.from_bytes(header["checksum"], "little") == zlib.crc32(image[:28] + image[32:end])

    at = end
    for number, segment in enumerate(case["segments"]):
        entry = read("SEGMENT_ENTRY", image[32 + 48 * number : 80 + 48 * number])
        data = bytes.fromhex(segment["data"])
        assert entry["target"][0] == codes("Target")[segment["target"]]
        assert struct.unpack("<III", entry["offset"] + entry["size"] + entry["checksum"]) == (
            at,
            len(data),
            zlib.crc32(data),
        )
        assert entry["digest"] == hashlib.sha256(data).digest()
        padded = data + bytes(-len(data) % 4)
        assert image[at : at + len(padded)] == padded
        at += len(padded)
    assert image[at:].hex() == case["signature"]
    assert firmware.IMAGE.parse(image)
    if case["key_id"] == bytes(8).hex():
        assert case["signature"] == bytes(64).hex()
    else:
        public_key(case["key_id"]).verify(image[at:], image[:at])


@every("refused_images")
def test_refused_images(case: Case) -> None:
    """Reasons and clauses stand in the cases by hand; here the decoder is asked, and construct refuses as well."""
    file = bytes.fromhex(case["hex"])
    with pytest.raises(ImageError) as refused:
        parse(file)
    assert (ImageReason(refused.value.reason).name, refused.value.reason) == (case["reason"], case["code"])
    right = file[-16:-4].hex() == "230101000912000155464410"
    right &= zlib.crc32(file[:-4]) ^ 0xFFFFFFFF == int.from_bytes(file[-4:], "little")
    assert right is (case["reason"] != "SUFFIX")
    if right:
        with pytest.raises(ConstructError):
            firmware.IMAGE.parse(file[:-16])
    meaning = {row[1].strip("`"): row[2] for row in table("table: ImageReason")}
    assert case["clause"] in meaning[case["reason"]]
    target = case["reason"] in ("MAGIC", "HARDWARE")
    assert case["dfu_status"] == ("TARGET" if target else "FILE")
    assert case["dfu_string"] == 16 + case["code"]


@every("signatures")
def test_signatures(case: Case) -> None:
    image = bytes.fromhex(case["hex"])
    (trusted,) = case["trusts"]
    key = Ed25519PublicKey.from_public_bytes(bytes.fromhex(trusted))
    try:
        key.verify(image[-64:], image[:-64])
        verified = True
    except InvalidSignature:
        verified = False
    key_id = image[16:24]
    ours = hashlib.sha256(bytes.fromhex(trusted)).digest()[:8] == key_id
    assert verified is (case["outcome"] == "SIGNED")
    expected = {(True, True): "SIGNED", (True, False): "SIGNATURE", (False, False): "UNKNOWN_KEY"}
    assert case["outcome"] == ("UNSIGNED" if not any(key_id) else expected[ours, verified])


@every("boot_records")
def test_boot_records(case: Case) -> None:
    raw = read("BOOT_RECORD", bytes.fromhex(case["hex"]))
    guarded = b"".join(raw[name] for name in ("magic", "generation", "size", "digest"))
    valid = zlib.crc32(guarded) == int.from_bytes(raw["checksum"], "little") and raw["magic"] == b"PWBR"
    valid = valid and 1 <= int.from_bytes(raw["size"], "little") <= 721_520
    assert (case["fields"] is not None) is valid
    erased = b"\xff" * 4
    assert case["may_boot"] is (valid and (raw["started"] == erased or raw["confirmed"] != erased))
    if valid:
        assert [field for field, said in case["fields"].items() if not means(field, raw[field], said)] == []


def test_boot_orders() -> None:
    assert {case["name"]: (case["a"], case["b"], case["order"]) for case in cases("boot_orders")} == {
        "boot-empty": ("record-erased", "record-erased", ["FACTORY"]),
        "boot-a-only": ("record-specification", "record-erased", ["A", "FACTORY"]),
        "boot-b-only": ("record-cut", "record-confirmed", ["B", "FACTORY"]),
        "boot-b-newer": ("record-confirmed", "record-newer", ["B", "A", "FACTORY"]),
        "boot-a-newer": ("record-newer", "record-confirmed", ["A", "B", "FACTORY"]),
        "boot-same": ("record-specification", "record-confirmed", ["A", "B", "FACTORY"]),
        "boot-on-trial": ("record-started", "record-wrapped", ["B", "FACTORY"]),
        "boot-wrap": ("record-before-wrap", "record-wrapped", ["B", "A", "FACTORY"]),
        "boot-both-failed": ("record-started", "record-started", ["FACTORY"]),
    }


@every("dfu_replies")
def test_dfu_replies(case: Case) -> None:
    raw, said = read("DFU_STATUS", bytes.fromhex(case["hex"])), case["fields"]
    assert raw["status"][0] == codes("DfuStatus")[said["status"]]
    assert raw["state"][0] == codes("DfuState")[said["state"]]
    assert int.from_bytes(raw["poll_ms"], "little") == said["poll_ms"]
    assert raw["string"][0] == said["string"]


def test_dfu_blocks() -> None:
    """Statuses and times written out by DFU-009 and DFU-008."""
    assert {
        case["name"].removeprefix("download-"): (case["status"], case["poll_ms"]) for case in cases("dfu_blocks")
    } == {
        "first": ("OK", 128),
        "second": ("OK", 8),
        "last": ("OK", 68),
        "end": ("OK", None),
        "end-early": ("NOTDONE", None),
        "again": ("ADDRESS", None),
        "skipped": ("ADDRESS", None),
        "short": ("ADDRESS", None),
        "long": ("ADDRESS", None),
        "behind": ("ADDRESS", None),
    }


def test_dfu_transitions_are_the_drawn_ones() -> None:
    """The diagram of DFU-006, and its sentences on what is not drawn."""
    rows = {(row["state"], row["event"]): (row["next"], row["stalls"]) for row in cases("dfu_transitions")}
    assert len(rows) == len(cases("dfu_transitions")) == len(DfuState) * len(DfuEvent)
    diagram = SPEC.split("**DFU-006**")[1].split("```")[1]
    working = set(codes("DfuState")) - {"APP_IDLE", "APP_DETACH", "ERROR"}
    drawn = {
        (state, event): (behind, False)
        for before, behind, event in re.findall(r"(\w+) --> (\w+): (\w+)", diagram)
        for state in (working if before == "WORKING" else {before})
    }
    deaf, by_itself = (
        {"DNBUSY", "MANIFEST", "MANIFEST_WAIT_RESET"},
        {"REATTACHED", "POLL_TIMEOUT", "FAILURE", "BUS_RESET"},
    )
    for (state, event), found in rows.items():
        if (state, event) in drawn:
            assert found == drawn[state, event]
        elif event in by_itself or (event in ("GETSTATUS", "GETSTATUS_BUSY", "GETSTATE") and state not in deaf):
            assert found == (state, False)
        else:
            assert found == ("APP_IDLE" if state.startswith("APP") else "ERROR", True)


def test_blocks_are_read_by_construct_as_they_are_said_to_be() -> None:
    """A second reader, field by field, of those that the specification prints."""
    for case in cases("blocks"):
        parsed = BLOCK.parse(bytes.fromhex(case["hex"])).block
        assert (Kind(parsed.kind).name, parsed.sequence) == (case["fields"]["kind"], case["fields"]["sequence"])
        for field in ("period", "first", "count", "hold", "repeats"):
            assert parsed.body[field] == case["fields"].get(field, 0)
