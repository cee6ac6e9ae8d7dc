"""Broken handling of versions of the protocol and of features (chapter VER)."""

from __future__ import annotations

import zlib
from dataclasses import replace
from typing import Any

from ....base.errors import BlockError
from ....emulator.control import controller
from ....emulator.control.admission import Admission
from ....emulator.control.controller import Controller
from ....emulator.control.requests import Requests
from ....protocol.blocks import AmplitudeModulation, Output, Samples, checksum
from ....protocol.codes import BLOCK_BYTES, CHECKSUM_OFFSET, PROTOCOL_VERSION, RECORD_BYTES, Action, Feature, Reason
from .patching import Patch, mutant

VERSION_AT = 2
CHECKSUM_BYTES = 4


def _take_versions(patch: Patch, taken: Any) -> None:
    """Judge blocks of some versions as if they had version 1."""

    @patch.around(controller, "unpack")
    def unpack(original: Any, packet: bytes) -> Any:
        sound = len(packet) == BLOCK_BYTES and checksum(packet) == _stated(packet)
        return original(_of_version(packet, PROTOCOL_VERSION) if sound and packet[VERSION_AT] in taken else packet)


def _stated(packet: bytes) -> int:
    return int.from_bytes(packet[CHECKSUM_OFFSET : CHECKSUM_OFFSET + CHECKSUM_BYTES], "little")


def _of_version(packet: bytes, version: int) -> bytes:
    """The same block with another version and a matching checksum."""
    other = packet[:VERSION_AT] + bytes([version]) + packet[VERSION_AT + 1 :]
    stated = checksum(other).to_bytes(CHECKSUM_BYTES, "little")
    return other[:CHECKSUM_OFFSET] + stated + other[CHECKSUM_OFFSET + CHECKSUM_BYTES :]


@mutant("VER-002", "ACK-003")
def later_versions_are_taken_as_version_1(patch: Patch) -> None:
    """A block of any later version is carried out as version 1: the byte is not checked."""
    _take_versions(patch, range(2, 256))


@mutant("VER-002", "ACK-003")
def version_0_is_taken_as_version_1(patch: Patch) -> None:
    """A block of version 0 is carried out: only newer versions are refused."""
    _take_versions(patch, (0,))


@mutant("VER-002", "ACK-003", wraps=(controller, "unpack"))
def unknown_versions_are_refused_with_kind(original: Any, packet: bytes) -> Any:
    """A block of an unknown version is refused as an unknown kind: both use the same branch."""
    try:
        return original(packet)
    except BlockError as error:
        if error.reason == Reason.VERSION:
            raise BlockError(str(error), Reason.KIND) from None
        raise


@mutant("VER-001", "VER-002", wraps=(Requests, "info"))
def info_promises_a_version_that_is_refused(original: Any, self: Any) -> Any:
    """INFO names version 2, but its blocks are refused: the number was raised too early."""
    return replace(original(self), newest_version=PROTOCOL_VERSION + 1)


@mutant("ACK-002", "VER-002")
def acknowledgements_repeat_the_version_of_the_block(patch: Patch) -> None:
    """The acknowledgement of a block has the block's version, even one that the device does not support."""

    @patch.around(Controller, "accept")
    def of_accept(original: Any, self: Any, packet: bytes, *given: Any) -> None:
        self.answered = packet[VERSION_AT : VERSION_AT + 1] or bytes([PROTOCOL_VERSION])
        original(self, packet, *given)

    def of_ack(original: Any) -> Any:
        return lambda self, *fields: _Echo(original(self, *fields).encode(), self.answered)

    patch.wrap(Controller, "_ack", of_ack)


class _Echo:
    """An acknowledgement encoded with another version."""

    def __init__(self, record: bytes, version: bytes) -> None:
        self._body = record[:VERSION_AT] + version + record[VERSION_AT + 1 : RECORD_BYTES - CHECKSUM_BYTES]

    def encode(self) -> bytes:
        return self._body + zlib.crc32(self._body).to_bytes(CHECKSUM_BYTES, "little")


# Features


def _lack(patch: Patch, feature: Feature) -> None:
    """Remove a feature from INFO, but leave it working."""

    @patch.around(Requests, "info")
    def info(original: Any, self: Any) -> Any:
        told = original(self)
        samples = 0 if feature is Feature.MODULATION else told.modulation_samples
        return replace(told, features=told.features & ~feature, modulation_samples=samples)


@mutant("VER-005")
def modulation_is_there_without_its_feature(patch: Patch) -> None:
    """INFO does not name MODULATION, but its blocks are carried out: features are not checked."""
    _lack(patch, Feature.MODULATION)


@mutant("VER-005")
def read_back_is_there_without_its_feature(patch: Patch) -> None:
    """INFO does not name READ_BACK, but PULSES is answered: it was left in from a larger firmware."""
    _lack(patch, Feature.READ_BACK)


@mutant("VER-005")
def serial_lines_are_there_without_their_feature(patch: Patch) -> None:
    """INFO does not name CONSOLE, but the console's endpoints take frames and text."""
    _lack(patch, Feature.CONSOLE)


@mutant("VER-005", "ACK-003")
def kinds_without_their_feature_are_unknown(patch: Patch) -> None:
    """Without MODULATION its kinds are refused with KIND instead of UNSUPPORTED: they are not compiled in."""
    _lack(patch, Feature.MODULATION)

    @patch.around(controller, "unpack")
    def unpack(original: Any, packet: bytes) -> Any:
        block = original(packet)
        if isinstance(block.body, Samples | AmplitudeModulation):
            raise BlockError("an unknown kind", Reason.KIND)
        return block


@mutant("VER-005", "ACK-003")
def the_state_is_looked_at_before_the_features(patch: Patch) -> None:
    """Without MODULATION a change that needs it is refused with DISABLED or FAULT before UNSUPPORTED is checked."""
    _lack(patch, Feature.MODULATION)

    @patch.around(Admission, "_judge_state")
    def judge(original: Any, self: Any, body: Any) -> None:
        original(self, body)
        ends = isinstance(body, Output) and body.action is Action.END_MODULATION
        if ends or isinstance(body, Samples | AmplitudeModulation):
            raise BlockError("MODULATION is not there", Reason.UNSUPPORTED)
