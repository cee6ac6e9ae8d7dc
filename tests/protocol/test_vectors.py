"""The golden vectors: the code makes the file, and each case is right by other means than that code.

Bytes are read by `tests.from_spec`, which was written from SPEC.md alone, and by construct's layouts; the
values of a case are taken from the file.
"""

from __future__ import annotations

import hashlib
import json
import re
import struct
from collections.abc import Callable, Iterable
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest
from construct import ConstructError
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from phasewire.__main__ import main
from phasewire.base.errors import BlockError, ChainError, FrameError, ImageError, ReplyError
from phasewire.protocol import Ack, Action, Fault, Kind, Reason, Request, State, Status, unpack
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
from phasewire.protocol.framing import decode as decode_frame
from phasewire.protocol.layout import chain, firmware, replies
from phasewire.protocol.layout.serial import FRAME
from phasewire.protocol.replies import ANSWER_BYTES
from phasewire.protocol.states import StateEvent
from phasewire.protocol.vectors import text

from tests import from_spec as spec
from tests.protocol.blocks import reason_by_construct
from tests.specification import SPEC, clauses, codes, hex_examples, table

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


def test_every_case_has_its_own_name_and_a_description() -> None:
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
    """The values under a key, in the cases of some parts or in their fields."""
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


def test_every_possible_descriptor_is_answered_at_run_time() -> None:
    inside = {"INTERFACE", "ENDPOINT", "INTERFACE_ASSOCIATION", "DEVICE_CAPABILITY", "DFU_FUNCTIONAL", "CS_INTERFACE"}
    answered = {
        DescriptorType(bytes.fromhex(case["setup"])[3]).name
        for case in cases("descriptors")
        if case["hex"] and case["setup"].startswith("80")
    }
    assert answered == set(DescriptorType.__members__) - inside


# The values of a case, and its bytes by the specification

CODES = {
    "kind": "Kind",
    "action": "Action",
    "reason": "Reason",
    "last_refusal": "Reason",
    "state": "State",
    "memory": "Memory",
    "bank": "Bank",
    "answer": "ChannelEnd",
    "status": "DfuStatus",
    "outcome": "Outcome",
}


def expanded(runs: list[list[int]]) -> list[tuple[int, int]]:
    return [(phase, width) for phase, width, times in runs for _ in range(times)]


def as_read(field: str, said: Any, flag_table: str = "") -> Any:
    """The value that a case states of a field, as `tests.from_spec` reads it."""
    if field == "pulses":
        return expanded(said)
    if field == "entries":
        return [tuple(entry) for entry in said]
    if field in ("flags", "faults", "features") and isinstance(said, list):
        named = codes({"faults": "Fault", "features": "Feature"}.get(field, flag_table))
        values = {name: 1 << value for name, value in named.items()} if field == "faults" else named
        return sum(values[name] if isinstance(name, str) else name for name in said)
    if field in CODES and isinstance(said, str):
        return codes(CODES[field])[said]
    if isinstance(said, str):
        return bytes.fromhex(said)
    return bytes(said) if isinstance(said, list) else said or 0  # the bank of an absent processor


def assert_says(found: spec.Fields, said: Case, unsaid: set[str], flag_table: str = "") -> None:
    """Each field has the value of the case, and the case leaves out only those."""
    assert {name: found[name] for name in said} == {name: as_read(name, said[name], flag_table) for name in said}
    assert set(found) - set(said) <= unsaid


# Pulses and blocks


def test_modulated_widths_are_the_formula_s() -> None:
    for sample, row in enumerate(cases("modulated_widths")):
        assert (row["sample"], row["widths"]) == (sample, [spec.modulated_width(width, sample) for width in range(26)])
    assert sample == 255


def test_powers_are_the_specification_s() -> None:
    said = SPEC.split("<!-- power -->")[1].split("**SAF-007**")[0]
    power = [int(number) for line in re.findall(r"\| power \| (.*) \|", said) for number in line.split(" | ")]
    rows = cases("powers")
    assert [(row["width"], row["power"]) for row in rows[:26]] == list(enumerate(power))
    for row in rows[26:]:
        assert row["total_drive"] == spec.total_drive(expanded(row["pulses"]))


@every("pulse_pairs")
def test_pulses(case: Case) -> None:
    assert spec.unpack_pulses(bytes.fromhex(case["hex"])) == [tuple(pair) for pair in case["pulses"]]
    assert case["begins"] == [int(Fraction(phase - width, 2) // 1) % 50 for phase, width in case["pulses"]]


@every("blocks")
def test_blocks(case: Case) -> None:
    data = bytes.fromhex(case["hex"])
    found = spec.read_block(data)
    assert case["reason"] == reason_by_construct(data).name == "ACCEPTED"
    unused = {name for name, value in found.items() if value == 0}
    counted = {"count"} if {"entries", "samples"} & set(found) else set()
    assert_says(found, case["fields"], unused | counted, "Flag")


@every("refused_blocks")
def test_refused_blocks(case: Case) -> None:
    data = bytes.fromhex(case["hex"])
    reason = reason_by_construct(data)
    assert (case["reason"], case["code"]) == (reason.name, codes("Reason")[reason.name])
    assert case["code"] == spec.judge_block(data)
    with pytest.raises(BlockError) as refused:
        unpack(data)
    assert refused.value.reason == case["code"]
    if reason is not Reason.FIELD:  # a field has clauses of its own
        said = {row[1].strip("`"): row[2] for row in table("table: Reason")}
        assert case["clause"] == said[reason.name]


def test_refused_fields_are_as_many_as_the_clause_requires() -> None:
    """Each field is set in a kind that does not use it."""
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

RECORDS = {"ACK": (spec.read_ack, "AckFlag"), "STATUS": (spec.read_status, "StatusFlag")}
ANSWERS: dict[str, tuple[Any, Callable[[bytes], Any]]] = {
    "INFO": (replies.INFO, spec.read_info),
    "CLOCK": (replies.CLOCK, spec.read_clock),
    "PULSES": (replies.READ_BACK, spec.read_back),
    "PROCESSORS": (replies.PROCESSOR_REPORTS, spec.read_processors),
}


@every("records")
def test_records(case: Case) -> None:
    read, flag_table = RECORDS[case["record"]]
    unsaid = {"magic", "version", "reserved", "checksum"}
    assert_says(read(bytes.fromhex(case["hex"])), case["fields"], unsaid, flag_table)


@every("refused_records")
def test_refused_records(case: Case) -> None:
    data = bytes.fromhex(case["hex"])
    kind = "ACK" if "ack" in case["name"] else "STATUS"
    with pytest.raises(ConstructError):
        getattr(replies, kind).parse(data)
    with pytest.raises(spec.Refused) as refused:
        RECORDS[kind][0](data)
    assert (str(refused.value) in ("checksum", "size")) is any(word in case["name"] for word in ("checksum", "short"))
    with pytest.raises(ReplyError):
        (Ack if kind == "ACK" else Status).decode(data)


@every("packets")
def test_packets(case: Case) -> None:
    known = {record["name"]: record["hex"] for record in cases("records")}
    assert case["hex"] == "".join(known[name] for name in case["records"])
    assert len(spec.read_records(bytes.fromhex(case["hex"]))) == len(case["records"])
    assert len(case["hex"]) // 2 <= 512


@every("refused_packets")
def test_refused_packets(case: Case) -> None:
    with pytest.raises(spec.Refused):
        spec.read_records(bytes.fromhex(case["hex"]))


def wiring_of(data: bytes) -> list[int]:
    return [int.from_bytes(data[at : at + 2], "little") for at in range(0, len(data), 2)]


@every("answers")
def test_answers(case: Case) -> None:
    data, said = bytes.fromhex(case["hex"]), case["fields"]
    if case["request"] == "WIRING":
        assert wiring_of(data) == said["channels"]
        assert sorted(said["channels"]) == list(range(320))
    elif case["request"] == "PROCESSORS":
        for found, report in zip(spec.read_processors(data), said["reports"], strict=True):
            assert_says(found, report, {"reserved"})
    elif case["request"] in ANSWERS:
        assert_says(ANSWERS[case["request"]][1](data), said, {"reserved"})


@every("refused_answers")
def test_refused_answers(case: Case) -> None:
    data = bytes.fromhex(case["hex"])
    if case["request"] == "WIRING":
        assert sorted(wiring_of(data)) != list(range(320))
        return
    layout, read = ANSWERS[case["request"]]
    with pytest.raises(ConstructError):
        layout.parse(data)
    with pytest.raises(spec.Refused):
        read(data)


def test_transitions_are_the_specification_s() -> None:
    found = {(row["state"], row["event"]): row["next"] for row in cases("device_transitions")}
    assert len(found) == len(cases("device_transitions")) == len(State) * len(StateEvent)
    assert found == {pair: spec.after(*pair) for pair in found}


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


def test_requests_ask_for_the_length_of_the_answer() -> None:
    sizes = {case["request"]: len(case["hex"]) // 2 for case in cases("answers")} | {"STATUS": 64}
    said = {case["name"]: case for case in cases("requests")}
    for name, size in sizes.items():
        assert said[f"request-{name}"]["answer"] == f"{size} bytes"
        assert said[f"request-{name}"]["fields"]["length"] == size


def test_refused_requests_differ_from_accepted_ones() -> None:
    carried_out = {case["hex"] for case in cases("requests")}
    assert not carried_out & {case["hex"] for case in cases("refused_requests")}


@every("descriptors")
def test_descriptors(case: Case) -> None:
    """Each descriptor of a chain begins with its length, and the whole with the requested type."""
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


@every("chain_messages")
def test_chain_messages(case: Case) -> None:
    data, said = bytes.fromhex(case["hex"]) + b"\1", dict(case["fields"])
    found = spec.decode_message(data)
    assert found.pop("message") == case["kind"]
    assert LAYOUTS[case["kind"]].parse(data)
    if "pulses" in said:
        found["pulses"] = spec.unpack_pulses(found["pulses"])
    if "data" in said:
        said["data"] = said["data"].ljust(96, "0")
    if "unique_id" in said:
        said["unique_id"] = said["unique_id"].to_bytes(8, "little").hex()
    assert_says(found, said, {"checksum"})


@every("refused_chain_messages")
def test_refused_chain_messages(case: Case) -> None:
    data = bytes.fromhex(case["hex"]) + b"\1"
    for layout in LAYOUTS.values():
        with pytest.raises(ConstructError):
            layout.parse(data)
    with pytest.raises(ChainError) as refused:
        decode_message(data)
    assert refused.value.clause == case["clause"]
    with pytest.raises(spec.Refused) as reason:
        spec.decode_message(data)
    if re.match(r"refused-(load|program|collect|number|report|playing|identity)", case["name"]):
        assert (str(reason.value) == "checksum") is any(word in case["name"] for word in ("checksum", "elsewhere"))


@every("slices_and_commits")
def test_slices_and_commits(case: Case) -> None:
    slice_, commit = (spec.decode_message(bytes.fromhex(case[name]) + b"\1") for name in ("slice", "commit"))
    assert (slice_["message"], commit["message"], slice_["node"], commit["node"]) == ("SLICE", "COMMIT", 3, 3)
    assert case["plays"] == (spec.commit_checksum(slice_["pulses"], commit["period"]) == commit["checksum"])


# Serial lines

BOTH_WAYS = (*spec.TO_DEVICE, *spec.TO_HOST)


@every("frames")
def test_frames(case: Case) -> None:
    data, body = bytes.fromhex(case["hex"]), bytes.fromhex(case["body"])
    assert spec.decode_frame(data[:-1], BOTH_WAYS) == (case["code"], body)
    assert data[-1:] == b"\0"
    assert FRAME.parse(data).kind == case["code"] == codes("FrameKind")[case["type"]]
    goes = {row[1].strip("`"): row[2].split(":")[0] for row in table("table: FrameKind")}
    assert case["goes"] == goes[case["type"]]
    if case["type"] in ("REQUEST", "REPLY"):
        read = spec.read_request if case["type"] == "REQUEST" else spec.read_reply
        assert_says(read(body), case["fields"], set())


def test_the_full_groups_are_in_the_named_places() -> None:
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
    with pytest.raises(spec.Refused) as refused:
        spec.decode_frame(data[:-1], BOTH_WAYS)
    with pytest.raises(FrameError):
        decode_frame(data)
    if len(data) <= 658:
        with pytest.raises(ConstructError):
            FRAME.parse(data)
    if case["clause"] in ("SER-004", "SER-007", "SER-008"):
        assert str(refused.value) == "type or body"


@every("streams")
def test_streams(case: Case) -> None:
    events: list[dict[str, Any]] = []
    for what, data in spec.read_line(bytes.fromhex(case["hex"]), BOTH_WAYS):
        if what == "text":
            events.append({"text": data.hex()})
        elif what == "frame":
            events.append({"frame": FrameKind(data[0]).name, "body": data[1:].hex()})
        else:
            events.append({"dropped": 1} if what == "damaged" else {"mode": what.upper()})
    assert case["events"] == events


@every("typing")
def test_typing(case: Case) -> None:
    lines, shown = spec.typed(bytes.fromhex(case["typed"]), case["echo"])
    assert case["lines"] == [line.decode("latin-1") for line in lines]
    assert case["shown"] == shown.hex()


@every("commands")
def test_commands(case: Case) -> None:
    expected = spec.parse_command(case["line"].encode("latin-1", "replace"))
    if isinstance(expected, int):
        assert (codes("ConsoleCode")[case["error"]], case["code"]) == (expected, expected)
    else:
        assert (case["command"], case["argument"]) == (expected or (None, None))


def in_words(key: str, value: Any) -> str:
    """A field of another case as CON-007 writes it: its name or number, names joined by +, or none."""
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


@every("images")
def test_images(case: Case) -> None:
    file = bytes.fromhex(case["hex"])
    image = file[:-16]
    assert case["reason"] == "ACCEPTED"
    assert spec.judge_file(file) == 0
    assert file[-16:] == spec.suffix_of(image, **case["suffix"])
    assert f"{case['suffix']['release']:04x}" == "{:02d}{}{}".format(*case["version"])
    header = spec.take(image, spec.IMAGE_HEADER)
    assert [header[part] for part in ("major", "minor", "patch", "protocol")] == [*case["version"], case["protocol"]]
    assert header["hardware"] == codes("Hardware")[case["hardware"]]
    assert (header["key_id"].hex(), image[-64:].hex()) == (case["key_id"], case["signature"])
    assert [(codes("Target")[each["target"]], each["data"]) for each in case["segments"]] == [
        (entry["target"], image[entry["offset"] : entry["offset"] + entry["size"]].hex())
        for entry in spec.segment_table(image)
    ]
    assert firmware.IMAGE.parse(image)
    keys = [bytes.fromhex(each["public_key"]) for each in cases("test_keys")]
    assert spec.signature_of(image, keys) == ("trusted" if any(header["key_id"]) else "unsigned")


@every("refused_images")
def test_refused_images(case: Case) -> None:
    file = bytes.fromhex(case["hex"])
    assert case["code"] == spec.judge_file(file) == codes("ImageReason")[case["reason"]]
    with pytest.raises(ImageError) as refused:
        parse(file)
    assert refused.value.reason == case["code"]
    if case["reason"] != "SUFFIX":
        with pytest.raises(ConstructError):
            firmware.IMAGE.parse(file[:-16])
    meaning = {row[1].strip("`"): row[2] for row in table("table: ImageReason")}
    assert case["clause"] in meaning[case["reason"]]
    assert (case["dfu_status"], case["dfu_string"]) == spec.dfu_status_of(case["code"])


@every("signatures")
def test_signatures(case: Case) -> None:
    outcomes = {"trusted": "SIGNED", "wrong": "SIGNATURE", "unknown": "UNKNOWN_KEY", "unsigned": "UNSIGNED"}
    found = spec.signature_of(bytes.fromhex(case["hex"]), [bytes.fromhex(key) for key in case["trusts"]])
    assert case["outcome"] == outcomes[found]


@every("boot_records")
def test_boot_records(case: Case) -> None:
    data = bytes.fromhex(case["hex"])
    found = spec.read_boot_record(data)
    assert (case["fields"] is None) is (found is None)
    assert case["may_boot"] is spec.may_boot(found)
    if found is not None:
        assert_says(spec.take(data, spec.BOOT_RECORD), case["fields"], {"magic", "checksum"})


@every("boot_orders")
def test_boot_orders(case: Case) -> None:
    records = {each["name"]: spec.read_boot_record(bytes.fromhex(each["hex"])) for each in cases("boot_records")}
    assert case["order"] == spec.banks_to_try(records[case["a"]], records[case["b"]])


@every("dfu_replies")
def test_dfu_replies(case: Case) -> None:
    said = case["fields"] | {"state": codes("DfuState")[case["fields"]["state"]]}
    assert_says(spec.take(bytes.fromhex(case["hex"]), spec.layout_of("DFU_STATUS")), said, set())


@every("dfu_blocks")
def test_dfu_blocks(case: Case) -> None:
    arguments = (case["block"], case["length"], case["received"], case["total"])
    assert case["status"] == spec.dfu_judge_block(*arguments)
    assert case["poll_ms"] == (spec.dfu_poll_ms(case["block"]) if case["status"] == "OK" and case["length"] else None)


def test_dfu_transitions_are_those_of_the_diagram() -> None:
    rows = {(row["state"], row["event"]): (row["next"], row["stalls"]) for row in cases("dfu_transitions")}
    assert len(rows) == len(cases("dfu_transitions")) == len(DfuState) * len(DfuEvent)
    assert rows == {pair: spec.dfu_after(*pair) for pair in rows}
