"""Images that cases send, and devices that are not waited for without end."""

from __future__ import annotations

import pytest
from phasewire.hil.conformance.cases import Inconclusive, NotApplicable
from phasewire.hil.conformance.mutants.catalogue import MUTANTS
from phasewire.hil.conformance.mutants.patching import applied
from phasewire.hil.conformance.running import RunOptions, open_bench
from phasewire.hil.conformance.tools.dfu import dfu_mode
from phasewire.hil.conformance.tools.images import of_whole_blocks
from phasewire.protocol.codes import Target
from phasewire.protocol.firmware import Image, Segment
from phasewire.protocol.versions import Version


def an_image(controller_bytes: int) -> Image:
    segments = (Segment(Target.ALL_PROCESSORS, b"\1" * 1001), Segment(Target.CONTROLLER, b"\2" * controller_bytes))
    return Image(Version(1, 2, 3), segments)


@pytest.mark.parametrize("controller_bytes", [1, 2, 3, 4, 2000, 4095, 5000])
def test_an_image_grows_to_whole_blocks_by_zeros_after_its_last_segment(controller_bytes: int) -> None:
    image = an_image(controller_bytes)
    grown = of_whole_blocks(image.encode())
    assert len(grown) % 2048 == 0
    assert 0 <= len(grown) - len(image.encode()) < 2048
    found = Image.decode(grown)
    assert found.segments[0] == image.segments[0]
    assert found.segments[1].data.rstrip(b"\0") == image.segments[1].data
    assert of_whole_blocks(grown) == grown


def test_an_image_that_cannot_grow_is_left_alone() -> None:
    with pytest.raises(Inconclusive, match="no room for"):
        of_whole_blocks(an_image(65_536).encode())
    signed = an_image(100).encode()
    with pytest.raises(NotApplicable, match="signed"):
        of_whole_blocks(signed[:16] + b"\1" * 8 + signed[24:])


def test_an_endless_upload_is_given_up() -> None:
    with (
        applied(MUTANTS["upload-never-ends"]),
        open_bench(RunOptions("emulator:")) as bench,
        dfu_mode(bench) as line,
        pytest.raises(AssertionError, match="the upload goes on after 721520 bytes"),
    ):
        line.image()


def test_waiting_for_a_clock_that_restarts_ends() -> None:
    with (
        applied(MUTANTS["ticks-wrap-at-32-bits"]),
        open_bench(RunOptions("emulator:")) as bench,
        pytest.raises(AssertionError, match="the clock does not reach tick"),
    ):
        bench.wait_until(2**32 // 50 + 100)
