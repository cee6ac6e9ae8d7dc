"""Files of known failures: what they say, and how they say no."""

from __future__ import annotations

from pathlib import Path

import pytest
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
