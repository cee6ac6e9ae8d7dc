"""Profiles: what they say, and how they say no."""

from __future__ import annotations

from pathlib import Path

import pytest
from phasewire.base.errors import InputFileError
from phasewire.hil.conformance.profile import Profile, read_profile
from phasewire.protocol.codes import PROTOCOL_REVISION

WHOLE = """
name = "revision C"
revision = 1

[not-applicable]
serial = "no UART is fitted"
"BLK-021" = "no sequences"
"BLK-005/2" = "one sentence alone"
"blocks/a-flipped-bit-is-refused[update]" = "known to the makers"
"usb/a-packet-is-short" = "all parameters"

[device]
vendor = "1209"
product = 0xF00D

[capture.channels]
D0 = "b2p1_07"
D1 = "t0"
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "device.toml"


@pytest.fixture
def whole(file: Path) -> Profile:
    file.write_text(WHOLE, encoding="utf-8")
    return read_profile(file)


def test_everything_that_a_profile_says_is_read(whole: Profile) -> None:
    assert (whole.name, whole.vendor, whole.product) == ("revision C", 0x1209, 0xF00D)
    assert whole.probes == {"D0": "b2p1_07", "D1": "t0"}
    assert whole.revision == 1


@pytest.mark.parametrize("written", ["0", str(PROTOCOL_REVISION + 1), '"1"', "true"])
def test_a_revision_is_one_that_there_is(file: Path, written: str) -> None:
    file.write_text(f'name = "x"\nrevision = {written}', encoding="utf-8")
    with pytest.raises(InputFileError, match=f"revision.* 1 to {PROTOCOL_REVISION}"):
        read_profile(file)


def test_what_is_newer_than_the_revision_does_not_apply() -> None:
    old = Profile(revision=1)
    assert old.reason_for("serial/a", "serial", ("CON-003", "SAF-003"), 2) == (
        "CON-003 changed in revision 2, SAF-003 changed in revision 3, "
        "and the profile declares that the device keeps revision 1"
    )
    assert old.reason_for("serial/a", "serial", ("CON-003", "SAF-003"), 1) is None
    assert Profile(revision=2).reason_for("serial/a", "serial", ("CON-003",), 2) is None


@pytest.mark.parametrize("written", ['"0x1209"', '"1209"', "0x1209", "4617"])
def test_a_number_of_usb_is_hexadecimal_text_or_a_number(file: Path, written: str) -> None:
    file.write_text(f'name = "x"\n[device]\nvendor = {written}', encoding="utf-8")
    assert read_profile(file).vendor == 4617


@pytest.mark.parametrize(
    ("case", "clauses", "reason"),
    [
        ("serial/anything", ("SER-001",), "no UART is fitted"),
        ("serials/anything", ("SER-001",), None),
        ("blocks/other", ("BLK-021",), "no sequences"),
        ("blocks/other", ("BLK-003", "BLK-021/2"), "no sequences"),
        ("blocks/other", ("BLK-005/2",), "one sentence alone"),
        ("blocks/other", ("BLK-005/1", "BLK-005"), None),
        ("blocks/a-flipped-bit-is-refused[update]", ("BLK-003",), "known to the makers"),
        ("blocks/a-flipped-bit-is-refused[slot]", ("BLK-003",), None),
        ("usb/a-packet-is-short[1]", ("USB-001",), "all parameters"),
        ("usb/a-packet-is-short-enough", ("USB-001",), None),
    ],
)
def test_what_does_not_apply_has_its_reason(
    whole: Profile, case: str, clauses: tuple[str, ...], reason: str | None
) -> None:
    assert whole.reason_for(case, case.partition("/")[0], clauses) == reason


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("name = ", "is no TOML file"),
        ("", "name: it is missing; it must be text"),
        ("name = ' '", "name = ' ': it must be text that is not empty"),
        ("name = 7", "name = 7: it must be text"),
        ("name = 'x'\nvendor = 1", "vendor = 1: no such key; known are name, revision, not-applicable, device"),
        ("name = 'x'\ndevice = 7", "device = 7: it must be a table, which begins with [device]"),
        ("name = 'x'\n[device]\nserial = 'A'", "[device]: serial = 'A': no such key; known are vendor, product"),
        ("name = 'x'\n[device]\nvendor = 65536", "[device]: vendor = 65536: it must be a number of 16 bits"),
        ("name = 'x'\n[device]\nproduct = true", "[device]: product = True: it must be a number"),
        ("name = 'x'\n[device]\nproduct = '12345'", "product = '12345': it must be a number"),
        ("name = 'x'\n[device]\nproduct = '-1'", "product = '-1': it must be a number"),
        ("name = 'x'\n[not-applicable]\n'BLK-3' = 'no'", "[not-applicable]: BLK-3 = 'no': it names nothing"),
        ("name = 'x'\n[not-applicable]\nserial = ''", "[not-applicable]: serial = '': it must be text"),
        ("name = 'x'\n[capture]\nchannel = 1", "[capture]: channel = 1: no such key; known are channels"),
        ("name = 'x'\n[capture.channels]\nD0 = 'pin7'", "[capture.channels]: D0 = 'pin7': 'pin7' chooses no output"),
        ("name = 'x'\n[capture.channels]\nD0 = 't320'", "D0 = 't320': there is no transducer 320; 0 to 319"),
        ("name = 'x'\n[capture.channels]\nD0 = 'b2p1'", "D0 = 'b2p1': a probe sits at one output, not at 32"),
        (
            "name = 'x'\n[capture.channels]\nD0 = 't1'\nD1 = 't1'",
            "[capture.channels]: D1 = 't1': another probe sits at this output",
        ),
    ],
)
def test_what_is_wrong_is_named_with_the_file(file: Path, text: str, complaint: str) -> None:
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputFileError) as caught:
        read_profile(file)
    assert str(caught.value).startswith(str(file))
    assert complaint in str(caught.value)
