"""The text console: commands and answers, editing, refusals, and effects (chapter CON)."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from enum import IntEnum, IntFlag
from typing import TypeVar

import numpy as np
import pytest
from phasewire.emulator.faults import WrongSupply
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Need, Risk, TooSlow, case, expect
from phasewire.hil.conformance.sight.capture import Seen
from phasewire.hil.conformance.sight.waveforms import SILENCE, check_play, expected_words, only
from phasewire.hil.conformance.tools.exchange import fill_queue, same_but
from phasewire.hil.conformance.tools.frames import frame, request_frame
from phasewire.hil.conformance.tools.steps import LONG_MS, enable, expect_all, require
from phasewire.hil.conformance.transports.serial import RawSerialLine
from phasewire.protocol.blocks import (
    AmplitudeModulation,
    Entries,
    Entry,
    NoOp,
    PlaySequence,
    Samples,
    Slot,
    Update,
    pack,
)
from phasewire.protocol.board import CHANNELS, TICK_HZ, TICKS_PER_PERIOD
from phasewire.protocol.codes import AckFlag, Fault, Feature, FrameKind, Hardware, Reason, Request, State, StatusFlag
from phasewire.protocol.replies import Ack, Status
from phasewire.protocol.requests import Setup

LENGTH, CHARACTER, COMMAND, ARGUMENTS, RANGE, REFUSED = range(1, 7)
"""Codes of errors (clause CON-006)."""
MOST_CHARACTERS = 80
TEST_WIDTH_TICKS = 2
TYPED_WATCHDOG_MS = 400
LEAVE_SECONDS = 0.3
"""After a device has said that it restarts, it answers no more."""

INFO_KEYS = (
    "oldest_version newest_version hardware firmware boards unique_id carrier_hz features channels columns rows "
    "pitch_um processors_per_board ticks_per_period max_width_ticks link_wires cycles_per_symbol queue_blocks "
    "periods_per_update queue_records slots sequence_entries modulation_samples drive_limit watchdog_ms"
)
STATUS_KEYS = (
    "state faults last_refusal flags now since_period accepted refused late lost missed_commits damaged_messages free "
    "temperature_c watchdog_ms drive_limit dropped_frames"
)
VERSION_KEYS = "oldest_version newest_version firmware"
CLOCK_KEYS = "now sync_period sync_pulses"
PROCESSOR_KEYS = "faults temperature_c bank missed_commits damaged_messages firmware"

HELP = {
    "help": "list the commands",
    "version": "versions of protocol and firmware",
    "info": "what this device is",
    "status": "what it is doing",
    "faults": "the faults that are set",
    "clock": "its time",
    "boards": "one line for each processor",
    "pulses TRANSDUCER": "the pulse that a transducer plays",
    "identify BOARD": "blink the light of a board",
    "enable": "enable the outputs",
    "stop": "silence and disable the outputs; works at any time",
    "test TRANSDUCER": "drive one transducer alone, weakly",
    "watchdog MS": "set the watchdog time in ms",
    "limit TRANSDUCERS": "set the limit on the total drive",
    "clear": "clear the faults",
    "reset": "start again as from power-up",
    "dfu": "restart in DFU mode",
    "frames": "how to go over to frames",
    "echo ON": "send back what is typed",
}
"""Each command as it is written, and its meaning (clause CON-005)."""

Answered = TypeVar("Answered")


@dataclass(frozen=True)
class ConsoleReply:
    """The answer to a command: its keys and values, and code and text of its error; the code is None for ok."""

    fields: tuple[tuple[str, str], ...]
    code: int | None
    text: str

    @property
    def keys(self) -> str:
        """The keys, in order."""
        return " ".join(key for key, _ in self.fields)

    def __getitem__(self, key: str) -> str:
        """The value of a key."""
        values = [value for name, value in self.fields if name == key]
        assert len(values) == 1, f"an answer has {len(values)} keys {key!r}, should have one; its keys are {self.keys}"
        return values[0]


def parse(answer: str) -> ConsoleReply:
    """Parse an answer; fails unless it has the form of CON-002."""
    assert answer.endswith("\r\n"), f"an answer ends with {answer[-10:]!r}, should with the end of a line, CR LF"
    *lines, last = answer.removesuffix("\r\n").split("\r\n")
    odd = [line for line in [*lines, last] if not re.fullmatch("[ -~]*", line)]
    assert not odd, f"a line of an answer should be printable ASCII and end with CR LF, not {odd[0]!r}"
    fields = [re.fullmatch(r"(\S[^:]*): (.*\S)", line) for line in lines]
    for line, field in zip(lines, fields, strict=True):
        assert field, f"a line of an answer should be 'key: value', not {line!r}"
    error = re.fullmatch(r"error ([0-9]+) (\S.*)", last)
    assert last == "ok" or error, f"an answer should end with 'ok' or 'error CODE TEXT', not {last!r}"
    pairs = tuple((field[1], field[2]) for field in fields if field)
    return ConsoleReply(pairs, int(error[1]) if error else None, error[2] if error else "")


def told(console: RawSerialLine, *lines: str) -> ConsoleReply:
    """Give commands that must be carried out; returns the answer to the last."""
    for line in lines:
        answer = parse(console.command(line))
        assert answer.code is None, f"{line!r} is answered with error {answer.code} {answer.text}, should be with ok"
    return answer


def refused(console: RawSerialLine, line: str, code: int) -> str:
    """Give a line that must be refused with a code; returns the text of the refusal."""
    answer = parse(console.command(line))
    expect(f"the error of {line!r}", answer.code, code)
    return answer.text


def by_request(bench: Bench, console: RawSerialLine, ask: Callable[[], Answered]) -> Answered:
    """Do something by requests or blocks meanwhile; a line that also carries those switches to frames for it."""
    if console is not bench.line:
        return ask()
    console.enter_frames()
    answer = ask()
    console.enter_console()
    return answer


def status_of(bench: Bench, console: RawSerialLine) -> Status:
    """STATUS by request."""
    return by_request(bench, console, bench.status)


# Contents of an answer


def says(text: str, value: object) -> bool:
    """Whether a text shows a record's value as CON-007 prints it."""
    match value:
        case IntFlag():
            return text == ("+".join(str(flag.name) for flag in value) or "none")
        case IntEnum():
            return text == value.name
        case bytes():
            return text == value.hex()
        case tuple():
            return text == ".".join(map(str, value))
    return text == str(value)


def check_fields(fields: Iterable[tuple[str, str]], before: object, after: object) -> None:
    """Fail unless the values are those of a record read before or after, or numbers in between."""
    for key, text in fields:
        one, other = getattr(before, key), getattr(after, key)
        between = (
            isinstance(one, int)
            and re.fullmatch("-?[0-9]+", text)
            and min(one, other) <= int(text) <= max(one, other)
            and text == str(int(text))
        )
        assert between or says(text, one) or says(text, other), (
            f"{key} is {text!r}; the record has {one!r} before and {other!r} after it"
        )


@case("CON-002", "CON-005", "CON-007", since=2)
def test_info_tells_the_record(bench: Bench, console: RawSerialLine) -> None:
    """The command `info` prints the keys and values of INFO, in its order, so that a person sees what a host does."""
    answer = told(console, "info")
    expect("the keys of info", answer.keys, INFO_KEYS)
    hardware = bench.info.hardware
    record = replace(bench.info, hardware=Hardware(hardware)) if hardware in set(Hardware) else bench.info
    check_fields(answer.fields, record, record)


@case("CON-005", "CON-007")
def test_version_tells_versions(bench: Bench, console: RawSerialLine) -> None:
    """The command `version` prints the versions of protocol and firmware, which a person looks for first."""
    answer = told(console, "version")
    expect("the keys of version", answer.keys, VERSION_KEYS)
    check_fields(answer.fields, bench.info, bench.info)


@case("CON-005", "CON-007", since=2)
def test_status_tells_the_record(bench: Bench, console: RawSerialLine) -> None:
    """The command `status` prints the keys and values of STATUS, in its order, even after many events."""
    told(console, "watchdog 12345")
    refused(console, "test 0", REFUSED)
    for _ in range(2):
        before = status_of(bench, console)
        answer = told(console, "status")
        expect("the keys of status", answer.keys, STATUS_KEYS)
        check_fields(answer.fields, before, status_of(bench, console))
        told(console, "enable", "test 0")
    assert answer["state"] == "PLAYING", f"state is {answer['state']!r} after test, should be PLAYING"


@case("CON-005", "CON-007")
def test_clock_tells_the_record(bench: Bench, console: RawSerialLine) -> None:
    """The command `clock` prints the keys and values of CLOCK, in its order, and its time advances."""
    for _ in range(2):
        before = by_request(bench, console, bench.clock)
        answer = told(console, "clock")
        after = by_request(bench, console, bench.clock)
        expect("the keys of clock", answer.keys, CLOCK_KEYS)
        check_fields(answer.fields, before, after)
        assert before.now < int(answer["now"]) < after.now, f"now is {answer['now']}, should be between the requests"


@case("CON-005", "CON-007")
def test_faults_tells_what_is_set(console: RawSerialLine) -> None:
    """The command `faults` prints `none` if there is none, because a set of bits is printed by its names."""
    expect("the answer to faults", told(console, "faults").fields, (("faults", "none"),))


@case("CON-005", "CON-007")
def test_boards_tells_every_processor(bench: Bench, console: RawSerialLine) -> None:
    """The command `boards` prints a line for each of ten processors, with names and values of its report."""
    before = by_request(bench, console, bench.processors)
    answer = told(console, "boards")
    after = by_request(bench, console, bench.processors)
    expect("the keys of boards", answer.keys, " ".join(f"processor {node}" for node in range(10)))
    for (_, text), one, other in zip(answer.fields, before, after, strict=True):
        fields = [tuple(field.split(" ", 1)) for field in text.split(", ")]
        expect("the names in a line of boards", " ".join(field[0] for field in fields), PROCESSOR_KEYS)
        check_fields([(field[0], field[1]) for field in fields], one, other)


@case("CON-005", "CON-007", features=Feature.READ_BACK)
def test_pulses_tells_what_a_transducer_plays(bench: Bench, console: RawSerialLine) -> None:
    """The command `pulses` prints phase and width of each transducer as played, and 0 while nothing plays."""
    asked = (0, 1, 2, 17, 31, 32, CHANNELS // 2, CHANNELS - 2, CHANNELS - 1)
    for transducer in asked[:2]:
        expect("pulses while nothing plays", told(console, f"pulses {transducer}").fields, fields_of(0, 0))
    pulses = bench.weak()

    def play() -> None:
        enable(bench)
        bench.wait_until(bench.must(Update(pulses)).commit_period + 1)

    by_request(bench, console, play)
    loud = [int(transducer) for transducer in np.flatnonzero(pulses.width)[:4]]
    for transducer in (*asked, *loud):
        if pulses.width[transducer]:  # the phase of a silent pulse means nothing
            wanted = fields_of(int(pulses.phase[transducer]), int(pulses.width[transducer]))
            expect(f"pulses of transducer {transducer}", told(console, f"pulses {transducer}").fields, wanted)
        else:
            expect(f"width of transducer {transducer}", told(console, f"pulses {transducer}")["width"], "0")


def fields_of(phase: int, width: int) -> tuple[tuple[str, str], ...]:
    """The fields of `pulses`."""
    return (("phase", str(phase)), ("width", str(width)))


@case("CON-005", "CON-007")
def test_help_lists_every_command(console: RawSerialLine) -> None:
    """The command `help` lists each command with its argument in capitals and its meaning."""
    answer = told(console, "help")
    expect("the number of lines of help", len(answer.fields), len(HELP))
    expect("help", dict(answer.fields), HELP)


@case("CON-005", "CON-009")
def test_frames_tells_the_way(bench: Bench, console: RawSerialLine) -> None:
    """The command `frames` names the byte 00 and changes nothing, and that byte leads to frames."""
    answer = told(console, "frames")
    assert any("00" in value for _, value in answer.fields), f"frames should tell of the byte 00, not {answer.fields}"
    told(console, "echo 0")
    console.write(b"\0")
    expect("the answer to the byte 00", console.answer(), b"\0")
    expect("INFO", console.request(Setup(0xC1, Request.INFO, 0, 0, 64)), bench.info.encode())


# Requests


@case("CON-004/1", "CON-005")
def test_commands_do_what_requests_do(bench: Bench, console: RawSerialLine) -> None:
    """Commands that stand for a request have its effect, with their argument as its value: STATUS shows each."""
    for milliseconds in (10, 777, 60_000):
        told(console, f"watchdog {milliseconds}")
        expect("the watchdog time", status_of(bench, console).watchdog_ms, milliseconds)
    for transducers in (0, 1, bench.drive_limit):
        told(console, f"limit {transducers}")
        expect("the drive limit", status_of(bench, console).drive_limit, transducers)
    for command, state in (("enable", State.READY), ("enable", State.READY), ("stop", State.OFF), ("stop", State.OFF)):
        told(console, command)
        expect(f"the state after {command}", status_of(bench, console).state, state)
    for board in range(min(bench.info.boards, 5)):
        told(console, f"identify {board}")
    told(console, "clear", "  watchdog   0001000  ")
    expect("the watchdog time", status_of(bench, console).watchdog_ms, 1000)


@case("CON-004/1", "CON-006", "REQ-010")
def test_what_a_request_would_stall_is_refused(bench: Bench, console: RawSerialLine) -> None:
    """If a request would stall, its command is REFUSED and has no effect, such as `limit` while enabled."""
    told(console, f"watchdog {LONG_MS}", "enable")
    before = status_of(bench, console)
    for transducers in (0, 5, CHANNELS):
        refused(console, f"limit {transducers}", REFUSED)
    same_but(before, status_of(bench, console))
    told(console, "stop")
    if bench.info.drive_limit < CHANNELS:
        refused(console, f"limit {bench.info.drive_limit + 1}", REFUSED)
    for board in range(bench.info.boards, 5):
        refused(console, f"identify {board}", REFUSED)
    if Feature.READ_BACK not in bench.info.features:
        refused(console, "pulses 0", REFUSED)


def to_playing(bench: Bench) -> None:
    """Play an update."""
    enable(bench)
    bench.wait_until(bench.must(Update(bench.weak())).commit_period + 1)


def to_unattended(bench: Bench) -> None:
    """Play an unattended sequence."""
    require(bench, Feature.SEQUENCES | Feature.UNATTENDED)
    play_sequence(bench, unattended=True)


def play_sequence(bench: Bench, unattended: bool = False) -> None:
    """Enable the outputs, and play an endless sequence."""
    enable(bench)
    bench.must(Slot(3, bench.weak()))
    bench.must(Entries((Entry(3, 50),), 0))
    bench.wait_until(bench.must(PlaySequence(0, 1, unattended=unattended)).commit_period + 1)


WAYS: dict[str, tuple[State, Callable[[Bench], None]]] = {
    "off": (State.OFF, lambda _: None),
    "ready": (State.READY, enable),
    "playing": (State.PLAYING, to_playing),
    "unattended": (State.UNATTENDED, to_unattended),
}


@case("CON-004/2", "STA-005", "SAF-004/1")
@pytest.mark.parametrize("state", WAYS)
def test_stop_works_in_every_state(bench: Bench, console: RawSerialLine, state: str) -> None:
    """The command `stop` turns the outputs off in every state, because an alarmed person types it first."""
    wanted, way = WAYS[state]
    by_request(bench, console, lambda: way(bench))
    expect("the state before", told(console, "status")["state"], wanted.name)
    before = status_of(bench, console).flags & StatusFlag.WATCHDOG_FIRED  # of an earlier case, until ENABLE
    told(console, "stop")
    expect_all(status_of(bench, console), state=State.OFF, since_period=0, flags=before)
    refused(console, "test 1", REFUSED)


SIGNS = ("status", "faults", "enable", "test 7")
NO_SIGNS = (
    *("version", "info", "clock", "boards", "pulses 7", "identify 0", "watchdog 400", "limit 5", "clear"),
    *("help", "frames", "echo 0", "foo", "enable 1", f"test {CHANNELS}", ""),
)


@case("CON-004/1", "CON-008", "SAF-003")
@pytest.mark.parametrize("command", SIGNS)
def test_commands_are_signs_of_life_where_requests_are(bench: Bench, console: RawSerialLine, command: str) -> None:
    """Commands that stand for STATUS and ENABLE, and `test`, keep the outputs on, as the requests do."""
    asked = type_for_long(bench, console, command)
    status = status_of(bench, console)
    gap = max(after - before for before, after in zip(asked[::2], [*asked[3::2], status.now], strict=True))
    if gap >= TYPED_WATCHDOG_MS * bench.slowness * TICK_HZ // 1000:
        raise TooSlow(f"up to {gap} ticks passed between two commands, which is longer than the watchdog's time")
    expect_all(status, f", although {command!r} was repeated", state=State.PLAYING, flags=StatusFlag(0))


@case("CON-004/1", "SAF-003")
@pytest.mark.parametrize("command", NO_SIGNS, ids=lambda command: command.replace(" ", "-") or "an-empty-line")
def test_other_commands_are_no_signs_of_life(bench: Bench, console: RawSerialLine, command: str) -> None:
    """Other commands, and refused lines, do not keep the outputs on: they are no signs of life."""
    type_for_long(bench, console, command)
    expect_all(status_of(bench, console), state=State.OFF, flags=StatusFlag.WATCHDOG_FIRED)


def type_for_long(bench: Bench, console: RawSerialLine, command: str) -> list[int]:
    """Play a test, repeat a command for longer than the watchdog's time; returns ticks before and after each."""
    asked = []
    told(console, f"watchdog {TYPED_WATCHDOG_MS * bench.slowness}")
    for line in ("enable", "test 0", *[command] * 8):
        asked.append(clock_of(console))  # which is no sign of life
        console.command(line)
        asked.append(clock_of(console))
        if line == command:
            wait_typing(bench, console, 0.1 * bench.slowness)
    return asked


def clock_of(console: RawSerialLine) -> int:
    """The device's tick, read by the console."""
    return int(told(console, "clock")["now"])


def wait_typing(bench: Bench, console: RawSerialLine, seconds: float) -> None:
    """Let time pass on the device, by its own clock if that is not the host's."""
    due = clock_of(console) + round(seconds * TICK_HZ) if bench.is_far else 0
    bench.wait(seconds)
    while bench.is_far and (left := due - clock_of(console)) > 0:
        bench.wait(left / TICK_HZ)


# Refusals

LONG = " " * MOST_CHARACTERS
ERRORS: dict[str, tuple[str, int]] = {
    "long-line": ("watchdog 500" + LONG, LENGTH),
    "long-line-of-spaces": (LONG + " ", LENGTH),
    "long-line-with-a-control-character": (LONG + "\x01", LENGTH),
    "long-line-with-no-command": ("halt\x01" + LONG, LENGTH),
    "tab": ("watchdog\t500", CHARACTER),
    "escape": ("watchdog 500\x1b", CHARACTER),
    "control-character-in-no-command": ("ha\x02lt", CHARACTER),
    "control-character-alone": ("\x04", CHARACTER),
    "no-command": ("halt", COMMAND),
    "capitals": ("WATCHDOG 500", COMMAND),
    "a-capital": ("Watchdog 500", COMMAND),
    "begins-like-one": ("watch 500", COMMAND),
    "goes-on-behind-one": ("watchdog500", COMMAND),
    "no-command-with-arguments": ("halt 1 2 3", COMMAND),
    "a-number": ("500", COMMAND),
    "argument-for-status": ("status 1", ARGUMENTS),
    "argument-for-enable": ("enable 1", ARGUMENTS),
    "argument-for-stop": ("stop now", ARGUMENTS),
    "argument-for-help": ("help help", ARGUMENTS),
    "argument-for-frames": ("frames 00", ARGUMENTS),
    "argument-for-clear": ("clear 0", ARGUMENTS),
    "watchdog-of-nothing": ("watchdog", ARGUMENTS),
    "watchdog-of-two": ("watchdog 500 600", ARGUMENTS),
    "watchdog-of-two-out-of-range": ("watchdog 5 5", ARGUMENTS),
    "watchdog-of-a-word": ("watchdog long", ARGUMENTS),
    "watchdog-with-a-sign": ("watchdog +500", ARGUMENTS),
    "watchdog-below-nothing": ("watchdog -500", ARGUMENTS),
    "watchdog-in-hexadecimal": ("watchdog 0x1F4", ARGUMENTS),
    "watchdog-with-a-fraction": ("watchdog 500.0", ARGUMENTS),
    "watchdog-with-a-unit": ("watchdog 500ms", ARGUMENTS),
    "watchdog-with-an-underscore": ("watchdog 1_000", ARGUMENTS),
    "limit-of-nothing": ("limit", ARGUMENTS),
    "test-of-nothing": ("test", ARGUMENTS),
    "test-of-a-word": ("test all", ARGUMENTS),
    "echo-of-a-word": ("echo on", ARGUMENTS),
    "watchdog-of-9": ("watchdog 9", RANGE),
    "watchdog-of-60001": ("watchdog 60001", RANGE),
    "watchdog-of-16-bits-and-500": (f"watchdog {2**16 + 500}", RANGE),
    "watchdog-of-32-bits-and-500": (f"watchdog {2**32 + 500}", RANGE),
    "watchdog-of-64-bits-and-500": (f"watchdog {2**64 + 500}", RANGE),
    "watchdog-of-70-digits": ("watchdog " + 70 * "9", RANGE),
    "limit-of-321": ("limit 321", RANGE),
    "limit-of-16-bits-and-1": (f"limit {2**16 + 1}", RANGE),
    "pulses-of-320": (f"pulses {CHANNELS}", RANGE),
    "test-of-320-while-disabled": (f"test {CHANNELS}", RANGE),
    "test-of-8-bits-less-1-and-320": (f"test {2**16 - 1}", RANGE),
    "identify-of-5": ("identify 5", RANGE),
    "echo-of-2": ("echo 2", RANGE),
    "test-while-disabled": (f"test {CHANNELS - 1}", REFUSED),
}
"""Lines, and the code of their first failure in the order of CON-006."""


@case("CON-001", "CON-002", "CON-005", "CON-006")
@pytest.mark.parametrize("what", ERRORS)
def test_a_line_that_is_wrong_is_refused(bench: Bench, console: RawSerialLine, what: str) -> None:
    """A wrong line is refused with the first code that applies, and changes only the counts of a refused test."""
    line, code = ERRORS[what]
    before = status_of(bench, console)
    refused(console, line, code)
    after = status_of(bench, console)
    if code == REFUSED:
        same_but(before, after, refused=1, last_refusal=Reason.DISABLED - before.last_refusal)
    else:
        same_but(before, after)


@case("CON-006")
def test_range_comes_before_refusal(console: RawSerialLine) -> None:
    """Arguments and their range are checked before the request: the first failure gives the code."""
    told(console, f"watchdog {LONG_MS}", "enable")
    for line, code in (("limit", ARGUMENTS), ("limit x", ARGUMENTS), ("limit 321", RANGE), ("limit 5", REFUSED)):
        refused(console, line, code)


@case("CON-001")
def test_spaces_do_not_matter(bench: Bench, console: RawSerialLine) -> None:
    """Spaces before, after and between words do not matter, up to 80 characters, because people type them."""
    for line in ("watchdog 500", "  watchdog 501", "watchdog 502   ", "watchdog    503", " watchdog 504".ljust(80)):
        told(console, line)
        expect("the watchdog time", status_of(bench, console).watchdog_ms, int(line.split()[1]))


@case("CON-002")
@pytest.mark.parametrize("line", ["", " ", LONG], ids=["empty", "a-space", "80-spaces"])
def test_a_line_without_words_is_answered_with_the_prompt(console: RawSerialLine, line: str) -> None:
    """A line without words is answered with only the prompt: a person presses return to see if the device is there."""
    expect("the answer before the prompt", console.command(line), "")


# Editing

BACK = b"\b \b"
OK = b"ok\r\n> "
FULL_LINE = b"echo 1".ljust(MOST_CHARACTERS)
EDITS: dict[str, tuple[bytes, bytes]] = {
    "cr": (b"echo 1\r", b"echo 1\r\n" + OK),
    "lf": (b"echo 1\n", b"echo 1\r\n" + OK),
    "cr-lf": (b"echo 1\r\n", b"echo 1\r\n" + OK),
    "lf-cr": (b"echo 1\n\r", b"echo 1\r\n" + OK + b"\r\n> "),
    "cr-cr": (b"\r\r", b"\r\n> \r\n> "),
    "lf-lf": (b"\n\n", b"\r\n> \r\n> "),
    "cr-lf-lf": (b"\r\n\n", b"\r\n> \r\n> "),
    "cr-lf-cr-lf": (b"\r\n\r\n", b"\r\n> \r\n> "),
    "cr-word-lf": (b"\recho 1\n", b"\r\n> echo 1\r\n" + OK),
    "spaces": (b"   \r", b"   \r\n> "),
    "backspace": (b"echp\bo 1\r", b"echp" + BACK + b"o 1\r\n" + OK),
    "delete": (b"echp\x7fo 1\r", b"echp" + BACK + b"o 1\r\n" + OK),
    "backspace-on-nothing": (b"\b\x7fecho 1\r", b"echo 1\r\n" + OK),
    "backspace-on-more-than-all": (b"ab\b\b\b\becho 1\r", b"ab" + 2 * BACK + b"echo 1\r\n" + OK),
    "backspace-on-a-space": (b"echo  \b1\r", b"echo  " + BACK + b"1\r\n" + OK),
    "control-c": (b"stop it\x03echo 1\r", b"stop it" + 7 * BACK + b"echo 1\r\n" + OK),
    "control-u": (b"stop it\x15echo 1\r", b"stop it" + 7 * BACK + b"echo 1\r\n" + OK),
    "control-c-on-nothing": (b"\x03\x15\r", b"\r\n> "),
    "control-character-taken-back": (b"\x01\becho 1\r", b"?" + BACK + b"echo 1\r\n" + OK),
    "high-byte-taken-back": (b"\xe9\x7fecho 1\r", b"?" + BACK + b"echo 1\r\n" + OK),
    "tab-in-a-line-taken-back": (b"a\tb\x15echo 1\r", b"a?b" + 3 * BACK + b"echo 1\r\n" + OK),
    "80-characters": (FULL_LINE + b"\r", FULL_LINE + b"\r\n" + OK),
    "80-spaces": (80 * b" " + b"\r", 80 * b" " + b"\r\n> "),
    "81-characters-taken-back": (FULL_LINE + b"x\x15echo 1\r", FULL_LINE + b"\a" + 80 * BACK + b"echo 1\r\n" + OK),
}
"""Typed bytes with echo, and the bytes that come back (clause CON-003)."""


@case("CON-003", "CON-001", "CON-002")
@pytest.mark.parametrize("what", EDITS)
def test_what_is_typed_is_shown(console: RawSerialLine, what: str) -> None:
    """Typed text comes back as a terminal needs it, and the edited line is what counts."""
    typed, shown = EDITS[what]
    told_with_echo(console)
    console.write(typed)
    expect("what comes back", console.answer(len(shown)), shown)


def told_with_echo(console: RawSerialLine) -> None:
    """Turn the echo on."""
    console.write(b"echo 1\n")
    expect("the answer to echo 1 while the echo is off", console.answer(), OK)


@case("CON-003", "CON-006")
@pytest.mark.parametrize(
    ("typed", "shown", "code"),
    [
        (b"echo\t1\r", b"echo?1\r\n", CHARACTER),
        (b"\x1b[A\r", b"?[A\r\n", CHARACTER),
        (b"caf\xc3\xa9\r", b"caf??\r\n", CHARACTER),
        (b"\x1f\x80\xff\r", b"???\r\n", CHARACTER),
        (FULL_LINE + b"x\r", FULL_LINE + b"\a\r\n", LENGTH),
        (FULL_LINE + b" \r", FULL_LINE + b"\a\r\n", LENGTH),
        (81 * b" " + b"\r", 80 * b" " + b"\a\r\n", LENGTH),
        (FULL_LINE + b"xyz\n", FULL_LINE + b"\a\a\a\r\n", LENGTH),
    ],
    ids=["tab", "escape", "utf-8", "edges", "81-characters", "a-space-too-many", "81-spaces", "83-characters"],
)
def test_what_is_too_much_or_not_printable_is_refused(
    console: RawSerialLine, typed: bytes, shown: bytes, code: int
) -> None:
    """An unprintable character comes back as ?, an excess one as the bell, and either makes the line refused."""
    told_with_echo(console)
    console.write(typed)
    came = console.answer(len(shown))
    assert came.startswith(shown), f"{typed!r} is shown as {came!r}, should be as {shown!r}"
    answer = came.removeprefix(shown)
    assert answer.endswith(b"\r\n> "), f"an answer should end with the prompt, not be {answer!r}"
    expect("the code", parse(answer.removesuffix(b"> ").decode("latin-1")).code, code)
    console.write(b"echo 0\r")
    expect("the next line", console.answer(), b"echo 0\r\n" + OK)


@case("CON-003")
def test_a_character_too_many_can_be_taken_back(console: RawSerialLine) -> None:
    """A line with 81 characters is carried out after one is deleted, because then it has 80."""
    for taken_back in (b"\b", b"\x7f"):
        console.write(FULL_LINE + b"x" + taken_back + b"\r")
        expect("the answer", console.answer(), OK)
        console.write(b"echo 0\r")
        console.answer()


@case("CON-003")
def test_without_echo_only_answers_come(console: RawSerialLine) -> None:
    """With `echo 0` no typed character comes back, not even a bell: programs do not want their own words."""
    for typed in (b"echo", b"\b\b\x7f\x03", b"\x01\t", b"\x15", 90 * b" ", b"\x15"):
        console.write(typed)
        expect("what comes back", console.rest(), b"")
    console.write(b"\r\n\r\n")
    expect("what comes back for two lines", console.answer(), b"> > ")
    expect("what comes back for a command", console.command("echo 0"), "ok\r\n")


@case("CON-003")
def test_each_character_is_shown_at_once(bench: Bench, console: RawSerialLine) -> None:
    """Each character comes back as it is typed, and a line feed long after its return still belongs to it."""
    told_with_echo(console)
    for typed in "clock":
        console.write(typed.encode())
        expect("what comes back for a character", console.answer(), typed.encode())
    console.write(b"\r")
    came = console.answer(200)
    assert came.startswith(b"\r\n"), f"the end of a line comes back as {came[:4]!r}, should be as CR LF"
    assert came.endswith(OK), f"clock is answered {came!r}"
    bench.wait(0.2)
    console.write(b"\n")
    expect("what comes back for the line feed of CR LF", console.rest(), b"")


@case("CON-003", "SER-010", since=2)
def test_a_line_starts_with_echo(bench: Bench, console: RawSerialLine) -> None:
    """A line after a hang-up, or never used before, echoes typed text, because a person may come next."""
    console.command("echo 0")
    if bench.line.kind == "usb":
        bench.usb.set_configuration()
    console.assume_console()
    console.hang_up()
    console.rest()
    console.write(b"\x15clock")
    came = console.answer()
    if bench.line.kind == "usb":
        expect("what comes back for a word", came, b"clock")
    console.write(b"\x15\r")
    assert console.answer().endswith(b"> "), "the end of a line is not answered with the prompt"


# test N


@case("CON-008", "CON-004/1", features=Feature.READ_BACK)
@pytest.mark.parametrize("transducer", [0, 1, CHANNELS // 2, CHANNELS - 1])
def test_one_transducer_plays_alone(bench: Bench, console: RawSerialLine, transducer: int) -> None:
    """`test N` plays phase 0 and width 2 on transducer N and silences all others, so that one can be heard alone."""
    by_request(bench, console, lambda: to_playing(bench))
    before = status_of(bench, console)
    told(console, f"test {transducer}")
    wait_typing(bench, console, 0.01)
    read = by_request(bench, console, bench.read_back)
    after = status_of(bench, console)
    widths = np.zeros(CHANNELS, int)
    widths[transducer] = TEST_WIDTH_TICKS
    expect("the widths that play", read.pulses.width.tolist(), widths.tolist())
    expect("the phase that plays", int(read.pulses.phase[transducer]), 0)
    now = before.now // TICKS_PER_PERIOD
    assert now < read.since_period <= after.now // TICKS_PER_PERIOD, (
        f"it plays since period {read.since_period}, should be since one after {now}, when it was typed"
    )
    same_but(before, after, accepted=1, since_period=read.since_period - before.since_period)


@case("CON-008", "TIM-003", "PUL-004", needs=(Need.CAPTURE,))
@pytest.mark.parametrize("transducer", [0, 45, CHANNELS - 1])
def test_the_outputs_play_one_transducer(bench: Bench, console: RawSerialLine, transducer: int) -> None:
    """`test N` gives one pulse of two ticks around the beginning of the period, at the output of transducer N."""
    by_request(bench, console, lambda: enable(bench))
    told(console, f"test {transducer}")
    wait_typing(bench, console, 0.01)
    since = status_of(bench, console).since_period
    assert since, "nothing plays after test"
    told(console, "stop")
    if console is bench.line:
        console.enter_frames()
    words = expected_words(only(transducer, width=TEST_WIDTH_TICKS), bench.wiring)

    def check(seen: Seen) -> None:
        check_play(seen, [(since - 10, SILENCE), (since, words)])

    bench.judge(since - 10, since + 100, check)


@case("CON-008", "CON-006")
def test_a_test_is_refused_as_an_update_is(bench: Bench, console: RawSerialLine) -> None:
    """`test N` is REFUSED if an update would be, with the reason's name first, and counts like a refused block."""
    before = status_of(bench, console)
    text = refused(console, "test 17", REFUSED)
    assert re.match(r"DISABLED\b", text), f"the refusal before enable should begin with DISABLED, not be {text!r}"
    after = status_of(bench, console)
    same_but(before, after, refused=1, last_refusal=Reason.DISABLED - before.last_refusal)
    told(console, f"watchdog {LONG_MS}", "limit 0", "enable")
    before = status_of(bench, console)
    text = refused(console, "test 17", REFUSED)
    assert re.match(r"DRIVE\b", text), f"the refusal above the limit should begin with DRIVE, not be {text!r}"
    same_but(before, status_of(bench, console), refused=1, last_refusal=Reason.DRIVE - before.last_refusal)
    told(console, "stop", "limit 1", "enable", "test 17")


@case("CON-008", "NUM-002")
def test_a_test_has_no_number(bench: Bench, console: RawSerialLine) -> None:
    """`test N` does not change the numbering of blocks and is not acknowledged, because no host has sent it."""
    numbers = []

    def begin() -> None:
        enable(bench)
        numbers.append(bench.must(NoOp()).sequence)

    by_request(bench, console, begin)
    told(console, "test 17")
    if bench.line.kind == "usb":
        expect("acknowledgements by USB", [each for each in bench.listen() if isinstance(each, Ack)], [])

    def go_on() -> None:
        before = bench.status()
        (ack,) = bench.send_raw(pack(bench.numbered(NoOp(), number=numbers[0])))
        expect("the reason of a block of the same number", ack.reason, Reason.SEQUENCE)
        expect("the flags of the next block", bench.must(NoOp()).flags, AckFlag(0))
        same_but(before, bench.status(), accepted=1, refused=1, last_refusal=Reason.SEQUENCE - before.last_refusal)

    by_request(bench, console, go_on)


@case("CON-008", "BLK-012", features=Feature.SEQUENCES)
def test_a_test_ends_a_sequence(bench: Bench, console: RawSerialLine) -> None:
    """`test N` ends a sequence, as an update does, and needs no other command first."""
    by_request(bench, console, lambda: play_sequence(bench))
    expect("the flags before", told(console, "status")["flags"], "SEQUENCE")
    told(console, "test 17")
    wait_typing(bench, console, 0.01)
    answer = told(console, "status")
    expect("the flags after it", answer["flags"], "none")
    expect("the state after it", answer["state"], "PLAYING")


@case("CON-008", "BLK-012", features=Feature.MODULATION)
def test_a_test_leaves_the_modulation(bench: Bench, console: RawSerialLine) -> None:
    """`test N` does not change a modulation, as an update does not."""

    def begin() -> None:
        enable(bench)
        bench.must(Samples(bytes([255, 128]), 0))
        bench.wait_until(bench.must(AmplitudeModulation(0, 2, 100)).commit_period + 1)

    by_request(bench, console, begin)
    told(console, "test 17")
    wait_typing(bench, console, 0.01)
    answer = told(console, "status")
    expect("the flags", answer["flags"], "MODULATION")
    expect("the state", answer["state"], "PLAYING")


@case("CON-008", "SAF-003")
def test_the_watchdog_silences_a_test(bench: Bench, console: RawSerialLine) -> None:
    """A test ends when the watchdog fires, so that it does not go on after its person has left."""
    told(console, "watchdog 300", "enable", "test 17")
    wait_typing(bench, console, 0.5)
    expect_all(status_of(bench, console), state=State.OFF, flags=StatusFlag.WATCHDOG_FIRED, since_period=0)


@case("CON-008", "SER-011")
def test_a_test_does_not_wait_for_room(bench: Bench, console: RawSerialLine) -> None:
    """`test N` is REFUSED while the queue has no room, and does not play later, when it would surprise."""
    by_request(bench, console, lambda: fill_queue(bench, 4))
    before = status_of(bench, console)
    refused(console, "test 17", REFUSED)
    expect_all(status_of(bench, console), accepted=before.accepted, free=0)
    told(console, "stop", "enable")
    wait_typing(bench, console, 0.01)
    expect("what plays after there is room", status_of(bench, console).since_period, 0)


# Bytes that are no text


@case("CON-009", "CON-006")
def test_rubbish_is_refused_line_by_line(bench: Bench, console: RawSerialLine) -> None:
    """Random bytes are read as lines and refused, with a prompt for each, and the next command is understood."""
    before = status_of(bench, console)
    allowed = bytes(byte for byte in range(1, 256) if byte not in b"\b\n\r\x03\x15\x7f")
    for size in (1, 40, 79, 80, 81, 300):
        typed = bytes(bench.random.choice(allowed) for _ in range(size - 1)) + b"\xa5"
        console.write(typed + b"\r")
        answer = console.answer(size)
        assert answer.endswith(b"\r\n> "), f"{size} bytes of rubbish and a return are answered {answer!r}"
        code = LENGTH if size > MOST_CHARACTERS else CHARACTER
        expect(f"the code for {size} bytes", parse(answer.removesuffix(b"> ").decode("latin-1")).code, code)
    mixed = bytes(bench.random.randrange(1, 256) for _ in range(600))
    console.write(mixed + b"\x15\r")
    came = console.answer(5000)
    ends = len(re.findall(b"\r\n|\r|\n", mixed + b"\r"))
    expect("the prompts for rubbish with ends of lines in it", len(re.findall(rb"(?:^|\n|(?<=> ))> ", came)), ends)
    expect("the answer to a command after it", console.command("echo 0"), "ok\r\n")
    same_but(before, status_of(bench, console))


@case("CON-009", "SER-010", "SER-006")
def test_frames_that_meet_a_console_lead_to_frames(bench: Bench, console: RawSerialLine) -> None:
    """The zero that ends a frame leads a console to frames: that frame is dropped uncounted, the next is understood."""
    before = status_of(bench, console)
    body = bytes([1]) + Setup(0x41, Request.ENABLE, 0, 0, 0).encode()
    first = frame(FrameKind.REQUEST, body)[: frame(FrameKind.REQUEST, body).index(b"\0")] + b"\0"
    console.write(first + request_frame(2, Setup(0xC1, Request.INFO, 0, 0, 0)))
    came = console.answer().replace(b"\0\0", b"\0")  # a zero may come before a frame, too (SER-005)
    expect("what answers", came, b"\0" + frame(FrameKind.REPLY, bytes([2, 0])))
    console.enter_console()
    same_but(before, status_of(bench, console))


# Restarts


@case("CON-004/1", "CON-005", "REQ-013", "CON-002", allow=(Risk.RESET,))
def test_reset_is_answered_and_then_carried_out(bench: Bench, console: RawSerialLine) -> None:
    """`reset` is answered with ok, then the device starts with fresh counts and sends nothing by itself."""
    refused(console, "reset 1", ARGUMENTS)
    told(console, "watchdog 9999", "enable")
    old = by_request(bench, console, bench.clock).now
    told(console, "reset")
    bench.restart(lambda: bench.wait(LEAVE_SECONDS))
    if console is not bench.line:
        console.assume_console()
    now, status = bench.clock().now, bench.status()
    assert now < old + TICK_HZ * LEAVE_SECONDS, f"tick {now} is no beginning of time after tick {old}"
    expect_all(status, state=State.OFF, watchdog_ms=bench.info.watchdog_ms, accepted=0)
    if bench.line.kind == "usb":
        expect("what a console sends when it starts", console.rest(), b"")
        console.wire.set_dtr(True)
        expect("what it sends once DTR is set", console.rest(), b"")
    console.enter_console()
    expect("the state", told(console, "status")["state"], "OFF")


@case("CON-004", "CON-005", "DFU-002", allow=(Risk.RESET,), line="usb")
def test_dfu_leads_to_dfu_mode(bench: Bench, console: RawSerialLine) -> None:
    """`dfu` is answered with ok, silences the outputs and leads to DFU mode, as DETACH does; a bus reset leads back."""
    refused(console, "dfu now", ARGUMENTS)
    if Feature.DFU not in bench.info.features:
        refused(console, "dfu", REFUSED)
        return
    told(console, f"watchdog {LONG_MS}", "enable", "test 3", "dfu")

    def upgrade_nothing() -> None:
        bench.usb.wait_for("DFU", bench.return_seconds)
        bench.usb.reset()

    bench.restart(upgrade_nothing)
    console.assume_console()
    expect_all(bench.status(), state=State.OFF, faults=Fault(0))


# Faults


@case("CON-004/1", "CON-004/2", "CON-007", "SAF-007/1", needs=(Need.FAULTS,))
def test_a_silencing_fault_refuses_commands(bench: Bench, console: RawSerialLine) -> None:
    """In the state FAULT `enable` and `test` are REFUSED, `stop` is not, and `clear` works after the cause is gone."""
    bench.levers.cause(WrongSupply(millivolts=5000, periods=8000))
    bench.wait(0.1)
    expect("faults", told(console, "faults").fields, (("faults", "SUPPLY"),))
    expect("the state", told(console, "status")["state"], "FAULT")
    refused(console, "enable", REFUSED)
    text = refused(console, "test 5", REFUSED)
    assert re.match(r"FAULT\b", text), f"the refusal of test should begin with FAULT, not be {text!r}"
    told(console, "stop", "clear")
    expect("the state while the cause is there", told(console, "status")["state"], "FAULT")
    bench.wait(0.3)
    expect("faults after the cause is gone", told(console, "faults").fields, (("faults", "SUPPLY"),))
    told(console, "clear")
    expect("faults after they were cleared", told(console, "faults").fields, (("faults", "none"),))
    expect("the state after they were cleared", status_of(bench, console).state, State.OFF)
