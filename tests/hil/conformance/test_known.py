"""Files of known failures: what they say, and how they say no."""

from __future__ import annotations

from pathlib import Path

import pytest
from phasewire.base.errors import InputFileError
from phasewire.hil.conformance.known import read_known_failures


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "known-failures.toml"


def test_cases_have_their_reasons_in_the_order_of_the_file(file: Path) -> None:
    file.write_text(
        '["usb/b[high, 3]"]\nreason = "revision C"\n\n["blocks/a"]\nreason = " the sum is not looked at "\n',
        encoding="utf-8",
    )
    assert list(read_known_failures(file).items()) == [
        ("usb/b[high, 3]", "revision C"),
        ("blocks/a", "the sum is not looked at"),
    ]


def test_an_empty_file_has_no_known_failures(file: Path) -> None:
    file.write_text("", encoding="utf-8")
    assert read_known_failures(file) == {}


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("[", "is no TOML file"),
        ('["blocks/a"]\n', """["blocks/a"]: reason: it is missing; it must be text"""),
        ('["blocks/a"]\nreason = ""\n', """["blocks/a"]: reason = '': it must be text that is not empty"""),
        ('["blocks/a"]\nreason = 3\n', """["blocks/a"]: reason = 3: it must be text"""),
        ('["blocks/a"]\nreason = "x"\nuntil = "y"\n', """["blocks/a"]: until = 'y': no such key; known are reason"""),
        ('"blocks/a" = "x"\n', """blocks/a = 'x': it must be a table, which begins with ["blocks/a"]"""),
        ('[blocks]\nreason = "x"\n', 'blocks: it names no case; a table begins as in ["blocks/'),
        ('reason = "x"\n', "reason = 'x': it names no case"),
    ],
)
def test_what_is_wrong_is_named_with_the_file(file: Path, text: str, complaint: str) -> None:
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputFileError) as caught:
        read_known_failures(file)
    assert str(caught.value).startswith(str(file))
    assert complaint in str(caught.value)
