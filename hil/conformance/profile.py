"""Profiles: what a device's makers declare of it before it is judged, in TOML.

The revision of the specification that it keeps; what it lacks, each with a reason; its numbers on USB; and the outputs
at which a logic analyser's probes sit::

    name = "revision C without a UART"
    revision = 2

    [not-applicable]
    serial = "no UART is fitted"
    "BLK-021" = "sequences are played from a card"

    [device]
    vendor = "1209"
    product = 0x0001

    [capture.channels]
    D0 = "b2p1_07"
    D1 = "t160"
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from ...base.storage import FilePath
from ...emulator.ports.export import chosen_channels
from ...protocol.codes import PROTOCOL_REVISION
from ...protocol.wiring import Wiring
from .clauses import changes
from .tables import Table, read_table

__all__ = ["Profile", "read_profile"]

NAME, REVISION, NOT_APPLICABLE, DEVICE = "name", "revision", "not-applicable", "device"
CAPTURE, CHANNELS = "capture", "channels"
VENDOR, PRODUCT = "vendor", "product"
MOST_NUMBER = 0xFFFF
_CLAUSE = re.compile(r"[A-Z]{3}-\d{3}(/[1-9]\d*)?", re.ASCII)
_GROUP_OR_CASE = re.compile(r"[a-z][^/\s]*(/\S.*)?")


@dataclass(frozen=True)
class Profile:
    """The declaration of a device."""

    name: str = "none"
    """Its name for people."""
    not_applicable: Mapping[str, str] = field(default_factory=dict)
    """Clauses, requirements, groups and cases that do not apply, and why."""
    vendor: int | None = None
    product: int | None = None
    """Its numbers on USB; None if they are not declared."""
    probes: Mapping[str, str] = field(default_factory=dict)
    """The output of each probe of a logic analyser, such as ``b2p1_07`` or ``t160``."""
    revision: int = PROTOCOL_REVISION
    """The revision of the specification that it keeps (clause VER-009)."""

    def reason_for(self, case_id: str, group: str, clauses: tuple[str, ...], since: int = 1) -> str | None:
        """Why a case does not apply; None if it does.

        A case applies only if all its clauses do: a case that combines a missing thing with others cannot be judged. A
        clause stands for each of its requirements, a case for each of its parameters. Nor does it apply if it judges
        what a later revision asks for, ``since``.
        """
        if since > self.revision:
            changed = ", ".join(changes(clauses, self.revision))
            return f"{changed}, and the profile declares that the device keeps revision {self.revision}"
        whole = (clause.partition("/")[0] for clause in clauses)
        names = (case_id, case_id.partition("[")[0], group, *clauses, *whole)
        return next((self.not_applicable[name] for name in names if name in self.not_applicable), None)

    def channels(self, wiring: Wiring) -> dict[str, int]:
        """The output channel of each probe, on a device with this wiring."""
        return {probe: chosen_channels(output, wiring)[0] for probe, output in self.probes.items()}


def read_profile(path: FilePath) -> Profile:
    """Read the profile in a file.

    Raises `OSError` if the file cannot be read, and `InputFileError` if it is no TOML or no profile; it names the key,
    its value and what would be right.
    """
    whole = read_table(path)
    whole.check_keys([NAME, REVISION, NOT_APPLICABLE, DEVICE, CAPTURE])
    device, capture = whole.table(DEVICE), whole.table(CAPTURE)
    device.check_keys([VENDOR, PRODUCT])
    capture.check_keys([CHANNELS])
    return Profile(
        whole.text(NAME),
        _reasons(whole.table(NOT_APPLICABLE)),
        _usb_number(device, VENDOR),
        _usb_number(device, PRODUCT),
        _probes(capture.table(CHANNELS)),
        _revision(whole),
    )


def _revision(table: Table) -> int:
    value = table.values.get(REVISION, PROTOCOL_REVISION)
    if type(value) is not int or not 1 <= value <= PROTOCOL_REVISION:
        raise table.error(REVISION, f"it must be a revision of the specification, 1 to {PROTOCOL_REVISION} (VER-009)")
    return value


def _reasons(table: Table) -> dict[str, str]:
    for key in table.values:
        if _CLAUSE.fullmatch(key) is None and _GROUP_OR_CASE.fullmatch(key) is None:
            raise table.error(
                key,
                'it names nothing that may not apply; a clause ("BLK-003", "BLK-005/1"), a group ("blocks") or a case '
                '("blocks/a-flipped-bit-is-refused") would',
            )
    return {key: table.text(key) for key in table.values}


def _usb_number(table: Table, key: str) -> int | None:
    if key not in table.values:
        return None
    value = table.values[key]
    number = _hexadecimal(value) if isinstance(value, str) else value
    if type(number) is not int or not 0 <= number <= MOST_NUMBER:
        raise table.error(key, 'it must be a number of 16 bits: "1209" in hexadecimal, or 0x1209')
    return number


def _hexadecimal(text: str) -> int | None:
    return int(text, 16) if re.fullmatch(r"(0[xX])?[0-9a-fA-F]{1,4}", text) else None


def _probes(table: Table) -> dict[str, str]:
    probes: dict[str, str] = {}
    for probe in table.values:
        output = table.text(probe)
        try:
            channels = chosen_channels(output, Wiring.strips())  # the set of names does not depend on the wiring
        except ValueError as error:
            raise table.error(probe, str(error)) from error
        if len(channels) != 1:
            raise table.error(
                probe, f"a probe sits at one output, not at {len(channels)}; b2p1_07 or t160 would be one"
            )
        if output in probes.values():
            raise table.error(probe, "another probe sits at this output")
        probes[probe] = output
    return probes
