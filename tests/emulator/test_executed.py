"""Devices whose processors execute their firmware, against their models and the specification."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from numpy.typing import NDArray
from phasewire import Emulator, Pulses, open_device
from phasewire.emulator import faults
from phasewire.firmware.xmos.images import device_image
from phasewire.firmware.xs1.assembler import AssemblySource, assemble
from phasewire.hil.conformance.mutants.processors import broken_image, broken_sources, known_mutants
from phasewire.host.firmware.flashing import flash
from phasewire.host.firmware.images import read_firmware
from phasewire.protocol.blocks import Slot, Update
from phasewire.protocol.codes import Fault, Request, State, Target
from phasewire.protocol.firmware import Image, Segment, build
from phasewire.protocol.timing import FIVE_WIRE, TWO_WIRE, Link

from tests.emulator.hosts import FULL, HALF, Device
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
@settings(max_examples=8)
@given(base=BASES, steps=PROGRAMS)
def test_random_programs_play_as_the_specification_says(link: Link, base: int, steps: list[Step]) -> None:
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
    with pytest.raises(ValueError, match="firmware 'xs2'"):
        Emulator(flash=Emulator().flash, firmware="xs2")  # type: ignore[arg-type]


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


@pytest.mark.slow
def test_what_is_flashed_is_what_plays(tmp_path: Path) -> None:
    """Firmware whose pulses of width 0 are high for a whole period plays them so once it was flashed."""
    (mutant,) = (each for each in known_mutants() if each.name == "width-0-is-a-whole-period")
    image = broken_image(broken_sources(mutant, tmp_path))
    with Emulator(firmware="xs1") as emulator:
        before = silent_words(emulator)
        report = flash(emulator.url, read_firmware(build(image)), allow_downgrade=True)
        assert report.written
        after = silent_words(emulator)
    assert not before.any()
    assert (after & 0x0101_0101 == 0x0101_0101).all()


def silent_words(emulator: Emulator) -> NDArray[np.uint32]:
    """What the ports do in a period in which nothing but silent pulses play."""
    with open_device(emulator.url) as device:
        ack = device.show(Pulses.silent(320))
        emulator.run_until(ack.commit_period + 2)
        begun = 50 * ack.commit_period
        return emulator.capture().bits(begun, begun + 50)


# Tokens and firmware that go astray


@pytest.mark.parametrize("message", ["slice", "commit", "load", "collect"])
@pytest.mark.parametrize("token", [0, 1, 2])
def test_a_message_without_a_token_of_its_header_harms_nobody(message: str, token: int) -> None:
    """The next token then names the channel end, which may not exist, or another node."""
    device = executed()
    device.emulator.inject(faults.LostToken(message=message, processor=3, token=token, times=2))
    for slot in range(3):
        device.send(Slot(slot, FULL))
        device.send(Update(FULL))
        device.run(500)
    device.order(Request.CLEAR_FAULTS)
    device.send(Update(HALF))
    device.run(500)
    assert device.emulator.processors[0].number == 0


def test_firmware_that_sends_without_end_is_given_up() -> None:
    """It sends END after END to nobody, and would keep the emulator busy for ever."""
    flood = assemble([AssemblySource("flood.s", FLOOD)])
    image = device_image()
    segments = (Segment(Target.ALL_PROCESSORS, flood.image), image.segments[-1])
    emulator = Emulator(firmware=replace(image, segments=segments))
    assert Device(emulator).status().faults & Fault.PROCESSOR
    assert any("executed no more" in event.what for event in emulator.events)


FLOOD = """
    getr r0, 2
    ldc r1, 2
    setd res[r0], r1
again:
    outct res[r0], 1
    bu again
"""
