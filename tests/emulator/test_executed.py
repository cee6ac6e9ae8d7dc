"""Devices whose processors execute their firmware, against their models and the specification."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from phasewire import Emulator
from phasewire.firmware.images import device_image
from phasewire.protocol.blocks import Update
from phasewire.protocol.codes import Fault, Request, State, Target
from phasewire.protocol.firmware import Image, Segment
from phasewire.protocol.timing import FIVE_WIRE, TWO_WIRE, Link

from tests.emulator.hosts import FULL, Device
from tests.emulator.test_doors import Program
from tests.emulator.test_oracle import BASES, BOTH_LINKS, FILLED, PROGRAMS, SCRAMBLED, Bench, Step, play


def executed(link: Link = FIVE_WIRE) -> Device:
    return Device(Emulator(link=link, firmware="xs1", serial="SAME"), enabled=True)


# Against the model, and against the referee and the tick oracle, which know only the specification


@pytest.mark.parametrize("link", [FIVE_WIRE, TWO_WIRE], ids=lambda link: link.name)
@pytest.mark.parametrize("seed", range(2))
def test_executed_processors_do_what_their_models_do(seed: int, link: Link) -> None:
    model, real = (Program(seed, unfolded=True, link=link, firmware=firmware) for firmware in ("model", "xs1"))
    for program in (model, real):
        program.run(150)
    assert real.heard == model.heard
    assert real.seen() == model.seen()
    assert real.device.status().missed_commits == 0
    assert real.device.status().faults == Fault(0)
    assert max(real.device.high_periods()) > 100


def check(link: Link, base: int, steps: list[Step]) -> None:
    play(Bench(link, device=Emulator(SCRAMBLED, link=link, firmware="xs1")), base, [*FILLED, *steps])


@BOTH_LINKS
@settings(max_examples=5)
@given(base=BASES, steps=PROGRAMS)
def test_random_programs_play_as_the_specification_says(link: Link, base: int, steps: list[Step]) -> None:
    check(link, base, steps)


@pytest.mark.slow
@BOTH_LINKS
@settings(max_examples=150)
@given(base=BASES, steps=PROGRAMS)
def test_many_random_programs_play_as_the_specification_says(link: Link, base: int, steps: list[Step]) -> None:
    check(link, base, steps)


# Firmware decides


def test_what_the_flash_contains_is_what_plays() -> None:
    """A program of zeros, which traps at its first instruction, is no firmware."""
    image = device_image()
    silent = Segment(Target.ALL_PROCESSORS, bytes(64))  # stw r0, r0[0] at address 0 traps at once
    broken = replace(image, segments=(silent, image.segments[-1]))
    device = Device(Emulator(firmware=broken), enabled=False)
    assert device.state is State.FAULT
    assert device.status().faults & Fault.PROCESSOR
    assert any("stands still" in event.what for event in device.emulator.events)


def test_one_processor_may_have_a_program_of_its_own() -> None:
    image = device_image()
    program, controller = (segment.data for segment in image.segments)
    segments = [Segment(Target(place), program) for place in range(10)]
    segments[7] = Segment(Target(7), bytes(64))
    device = Device(Emulator(firmware=Image(image.version, (*segments, Segment(Target.CONTROLLER, controller)))))
    assert device.status().faults & Fault.PROCESSOR
    assert [processor.number for processor in device.emulator.processors] == [*range(7), None, None, None]


def test_an_image_and_a_flash_do_not_go_together() -> None:
    with pytest.raises(ValueError, match="a flash has its own firmware"):
        Emulator(flash=Emulator().flash, firmware=device_image())
    with pytest.raises(ValueError, match="firmware 'xs2'"):
        Emulator(firmware="xs2")  # type: ignore[arg-type]


# Time


def test_outputs_change_at_boundaries_across_the_wrap_of_the_port_counter() -> None:
    device = executed()
    device.order(Request.WATCHDOG, 1000)
    device.send(Update(FULL))
    device.run(2700)  # the counter wraps after 1310.72 periods
    words = device.emulator.capture().bits(0, 2700 * 50).reshape(-1, 50, 10)
    first = int(np.flatnonzero(words.any(axis=(1, 2)))[0])
    assert (words[first:] == words[first]).all()
    assert not words[:first].any()


def test_a_processor_without_power_executes_nothing() -> None:
    device = executed()
    processor = device.emulator.processors[4]
    device.emulator.chain.lose(4)
    before = processor.core.instructions  # type: ignore[attr-defined]
    device.run(400)
    assert processor.core.instructions == before  # type: ignore[attr-defined]
    assert device.status().faults & Fault.PROCESSOR


def test_two_runs_are_the_same_to_the_bit() -> None:
    one, other = (Program(5, unfolded=True, firmware="xs1") for _ in range(2))
    for program in (one, other):
        program.run(60)
    assert (one.heard, one.seen()) == (other.heard, other.seen())
    assert list(one.device.emulator.events) == list(other.device.emulator.events)


def test_what_is_flashed_is_what_plays(tmp_path: Path) -> None:
    """A port thread that shows the complement of each word: what plays changes, and so does the version."""
    assert pulse_width_that_plays(device_image()) == 25
    mutant = TextMutant("complement", "", "port.s", ("    out res[r0], r2\n    ldw r2, r1[1]",), (), {})
    del mutant
    image = device_image((0, 2, 0))
    with Emulator(firmware="xs1") as emulator:
        report = flash(emulator.url, read_firmware(build(image)))
        assert (str(report.before), str(report.firmware)) == ("0.1.0", "0.2.0")
        with open_device(emulator.url) as device:
            assert {each.firmware for each in device.processors()} == {(0, 2, 0)}
