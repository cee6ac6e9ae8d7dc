"""Vectors of the chain's messages (SPEC.md, chapter CHN)."""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np

from ..blocks import pack_pulses, unpack_pulses
from ..chain import Collect, Commit, Identity, Load, Message, Number, Playing, Program, Report, Slice
from ..codes import ChannelEnd, Memory
from ..pulses import Pulses
from .cases import Section, section, vector

__all__ = ["chain_messages", "refused_chain_messages", "slices_and_commits"]

LAST_PERIOD = 2**64 - 1
EVEN_BITS = pack_pulses(Pulses([25, 0] * 16, [25, 0] * 16))
MIXED = pack_pulses(Pulses(7 * np.arange(32) % 100, np.arange(32) % 26))
SLICE = Slice(3, EVEN_BITS)
TWO_ENTRIES = bytes([0, 0, 100, 0, 1, 0, 100, 0])

MESSAGES: dict[str, tuple[str, Message]] = {
    "slice-specification": ("the example of CHN-011", SLICE),
    "slice-first": ("the first processor; bit n has phase 7n mod 100 and width n mod 26", Slice(0, MIXED)),
    "slice-last": ("the last processor, silent", Slice(9, bytes(48))),
    "commit-specification": ("the example of CHN-011", Commit.of(1000, SLICE)),
    "commit-last": ("the last processor and the last period", Commit.of(LAST_PERIOD, Slice(9, bytes(48)))),
    "load-specification": ("the example of CHN-012", Load(3, Memory.ENTRIES, 12, TWO_ENTRIES)),
    "load-slot": ("slot 255", Load(0, Memory.SLOTS, 255, MIXED)),
    "load-entries": (
        "twelve entries, as many as a load holds, up to the end",
        Load(9, Memory.ENTRIES, 1012, TWO_ENTRIES * 6),
    ),
    "load-sample": ("one sample in the last place; it may be 0", Load(1, Memory.SAMPLES, 4095, bytes(1))),
    "load-samples": ("48 samples up to the end", Load(1, Memory.SAMPLES, 4048, bytes(range(208, 256)))),
    "program-specification": ("the example of CHN-014", Program(3, Memory.ENTRIES, 1000, 0, 2)),
    "program-sequence": (
        "the whole table, as often as can be said, in the last period",
        Program(9, Memory.ENTRIES, LAST_PERIOD, 0, 1024, repeats=65535),
    ),
    "program-modulation": ("the last sample", Program(0, Memory.SAMPLES, 1000, 4095, 1, hold=65535)),
    "program-stop-sequence": ("a count of 0 stops", Program(0, Memory.ENTRIES, 2000, 0, 0)),
    "program-stop-modulation": ("so it does here", Program(0, Memory.SAMPLES, 2000, 0, 0)),
    "collect-specification": ("the example of CHN-016", Collect(3, ChannelEnd.REPORT)),
    "collect-playing": ("asks for what plays", Collect(9, ChannelEnd.PLAYING)),
    "number-specification": ("the example of CHN-022", Number(3)),
    "number-last": ("number 9, after which the chain must end", Number(9)),
    "report-specification": ("the example of CHN-016", Report(3, 31, 0, (1, 0, 0), -1, 250_000, 2, 1)),
    "report-coldest": (
        "least temperature and drift, the most of everything else",
        Report(9, -128, 0xFFFF, (255, 255, 255), -128, 2**32 - 1, 2**32 - 1, 2**32 - 1),
    ),
    "report-hottest": ("greatest temperature and drift", Report(0, 127, 0, (0, 0, 0), 127, 0, 0, 0)),
    "playing-specification": ("the example of CHN-016", Playing(3, 1000, EVEN_BITS)),
    "playing-last": ("since the last period", Playing(9, LAST_PERIOD, MIXED)),
    "identity-specification": ("the example of CHN-022", Identity(3, False, (1, 0, 0), 0x0123456789ABCDEF)),
    "identity-last": ("the last of the chain", Identity(9, True, (99, 9, 9), 2**64 - 1)),
}


def _fields(message: Message) -> dict[str, Any]:
    """What a message says, under the names of the specification."""
    fields = {"node": message.node} | vars(message)
    if "packed" in fields:
        fields["pulses"] = unpack_pulses(fields.pop("packed"))
    if fields["node"] == fields.get("processor"):
        del fields["processor"]
    if isinstance(message, Load):
        fields["count"] = message.count
    return fields


def _tokens(message: Message) -> bytes:
    """Its tokens without END, which is no byte on the links."""
    return message.encode()[:-1]


def chain_messages() -> Section:
    """Messages of all kinds."""
    return section(
        "Messages of the chain (CHN). hex is the tokens that hold data, route header first; the control token END "
        "follows them on the link, and appears as 01 in the examples of the specification. Fields have the names of "
        "the layouts; data is without the zeros after it.",
        (
            vector(name, shows, hex=_tokens(message), kind=message.CHANNEL_END, fields=_fields(message))
            for name, (shows, message) in MESSAGES.items()
        ),
    )


def slices_and_commits() -> Section:
    """Which commits let a slice play."""
    slice_, commit = _tokens(SLICE), Commit.of(1000, SLICE)
    damaged = slice_[:20] + bytes([slice_[20] ^ 1]) + slice_[21:]
    cases = {
        "good": ("slice and commit of the specification", slice_, commit, True),
        "damaged-slice": ("a bit of the slice was flipped on its way", damaged, commit, False),
        "damaged-period": ("a bit of the period was", slice_, Commit(3, 1001, commit.checksum), False),
        "other-slice": ("the mailbox holds what another commit was meant for", _tokens(Slice(3, MIXED)), commit, False),
    }
    return section(
        "A slice in a mailbox and the commit that comes for it: whether it plays, or the commit is missed (CHN-004, "
        "CHN-011).",
        (
            vector(f"commit-{name}", shows, slice=slice_, commit=_tokens(commit), plays=plays)
            for name, (shows, slice_, commit, plays) in cases.items()
        ),
    )


def _changed(name: str, offset: int, *octets: int) -> bytes:
    """One of `MESSAGES` with other tokens from an offset on and the CRC-32 that belongs to them."""
    data = bytearray(_tokens(MESSAGES[name][1])[:-4])
    data[offset : offset + len(octets)] = bytes(octets)
    return bytes(data) + zlib.crc32(data).to_bytes(4, "little")


def _flipped(name: str, offset: int) -> bytes:
    data = bytearray(_tokens(MESSAGES[name][1]))
    data[offset] ^= 1
    return bytes(data)


def refused_chain_messages() -> Section:
    """Messages that their receivers drop."""
    slice_, collect = _tokens(SLICE), _tokens(Collect(3, ChannelEnd.REPORT))
    refusals = {
        "nothing": ("END alone", "CHN-002", b""),
        "header": ("a route header alone", "CHN-010", slice_[:3]),
        "end-0": ("channel end 0", "CHN-009", collect[:2] + bytes([0]) + collect[3:]),
        "end-10": ("channel end 10", "CHN-009", collect[:2] + bytes([10]) + collect[3:]),
        "slice-short": ("a slice that lost a token", "CHN-010", slice_[:-1]),
        "slice-long": ("a slice with one token more", "CHN-010", slice_ + bytes(1)),
        "slice-node": ("a slice for processor 10", "CHN-011", bytes([0, 10]) + slice_[2:]),
        "slice-controller": ("a slice for the controller", "CHN-011", bytes([0, 0xFF]) + slice_[2:]),
        "commit-short": ("a commit that lost a token", "CHN-010", _tokens(MESSAGES["commit-last"][1])[:-1]),
        "load-checksum": ("a bit of the data is flipped", "CHN-010", _flipped("load-slot", 30)),
        "load-elsewhere": (
            "the node was changed on the way, the checksum was not",
            "CHN-010",
            _flipped("load-slot", 1),
        ),
        "load-memory": ("memory 4", "CHN-012", _changed("load-sample", 3, 4)),
        "load-none": ("no items", "CHN-012", _changed("load-sample", 6, 0)),
        "load-two-slots": ("two slots", "CHN-012", _changed("load-slot", 4, 0, 0, 2)),
        "load-13-entries": ("more entries than 48 bytes hold", "CHN-012", _changed("load-specification", 6, 13)),
        "load-beyond": ("48 samples from place 4049 on", "CHN-012", _changed("load-samples", 4, 0xD1, 0x0F)),
        "load-behind": ("a byte after the sample", "CHN-012", _changed("load-sample", 54, 1)),
        "program-slots": ("slots cannot be started", "CHN-014", _changed("program-specification", 3, 1)),
        "program-beyond": ("two entries from place 1023 on", "CHN-014", _changed("program-specification", 4, 0xFF, 3)),
        "program-hold": ("a sequence with a hold", "CHN-014", _changed("program-specification", 8, 1)),
        "program-no-hold": ("a modulation without one", "CHN-014", _changed("program-modulation", 8, 0, 0)),
        "program-repeats": ("a modulation with repeats", "CHN-014", _changed("program-modulation", 10, 1)),
        "program-stop-first": ("a stop that names an item", "CHN-014", _changed("program-stop-sequence", 4, 1)),
        "collect-slice": ("a slice cannot be asked for", "CHN-016", _changed("collect-specification", 3, 1)),
        "number-10": ("number 10", "CHN-022", _changed("number-last", 3, 10)),
        "number-node": ("a number for processor 0, which has one", "CHN-022", _changed("number-last", 0, 0, 0)),
        "report-processor": ("processor 10 answers", "CHN-016", _changed("report-hottest", 3, 10)),
        "report-node": ("a report to processor 0", "CHN-016", _changed("report-hottest", 0, 0, 0)),
        "report-checksum": ("a bit of a count is flipped", "CHN-010", _flipped("report-hottest", 12)),
        "playing-processor": ("processor 10 answers", "CHN-016", _changed("playing-last", 3, 10)),
        "identity-neither": ("neither last nor not last", "CHN-022", _changed("identity-last", 4, 2)),
    }
    return section(
        "Messages that are damaged, or were never allowed: their receiver drops them (CHN-010). END follows hex.",
        (vector(f"refused-{name}", shows, hex=data, clause=clause) for name, (shows, clause, data) in refusals.items()),
    )
