"""The command line: its output, its files, and its errors."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import typer
from phasewire import ControlPoints, Emulator, Medium, Sphere, Transducer, TransducerArray, open_device, pressure, solve
from phasewire.base.signals import unwinding
from phasewire.cli.commands import PANELS, command_line
from phasewire.cli.settings import each_command
from phasewire.solver import METHODS, Star
from phasewire.solver.fields.files import load_field, load_solution, save_solution

from .runner import Run


@pytest.fixture
def solved(tmp_path: Path) -> Path:
    path = tmp_path / "sphere.npz"
    save_solution(path, solve(TransducerArray.grid(), Sphere().sample()))
    return path


def test_the_demo_passes_draws_and_writes_a_record(phasewire: Run, tmp_path: Path) -> None:
    outcome = phasewire("demo", "--json", "demo.json")
    assert outcome.code == 0
    assert "PASS" in outcome.out
    assert "all ten processors play" in outcome.err
    assert (tmp_path / "demo.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    record = json.loads((tmp_path / "demo.json").read_text())
    assert record["verdict"] == "pass"
    assert len(record["control_points_m"]) == 17


def test_the_demo_fails_when_something_is_broken(phasewire: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("phasewire.cli.demo.Emulator", lambda: Emulator(clock_offset_ticks={2: 1}))
    outcome = phasewire("demo", "--json", "-")
    assert outcome.code == 1
    assert json.loads(outcome.out)["verdict"] == "fail"
    assert "FAIL" in outcome.err


def test_solve_field_and_show_read_each_other_s_files(phasewire: Run, tmp_path: Path) -> None:
    outcome = phasewire("solve", "sphere:radius=0.04,palm=0.18", "-o", "s.npz", "--json", "-")
    assert outcome.code == 0
    record = json.loads(outcome.out)
    assert record["transducers"] == 320
    assert min(record["pressure_pa"]) > 100
    outcome = phasewire("field", "s.npz", "-o", "f.png", "--step", "0.004")
    assert (outcome.code, (tmp_path / "f.png").exists()) == (0, True)
    assert "strongest" in outcome.out
    assert phasewire("field", "s.npz", "-o", "f.npz", "--step", "0.004", "--height", "0.1").code == 0
    with np.load(tmp_path / "f.npz") as field:
        np.testing.assert_allclose(field["centre"], [0, 0, 0.1])
    outcome = phasewire("show", "s.npz", "--seconds", "0.1", "--json", "-")
    assert outcome.code == 0
    status = json.loads(outcome.out)["status"]
    assert (status["state"], status["accepted"], status["missed_commits"]) == ("PLAYING", 2, 0)


def test_solve_takes_any_option_of_a_method_and_any_transducer_and_air(phasewire: Run, tmp_path: Path) -> None:
    settings = ("--set", "gamma=0.5", "--set", "steps=3", "--set", "output=phase", "--method", "wgs")
    air = ("--temperature", "30", "--humidity", "40", "--transducer", "MA40S4S-10Vrms", "--model", "monopole")
    assert phasewire("solve", "star", "-o", "s.npz", *settings, *air).code == 0
    solution = load_solution(tmp_path / "s.npz")
    medium = Medium(30, absorbing=True, humidity=40)
    array = TransducerArray.grid(transducer=Transducer(strength=8.49, model="monopole"))
    expected = solve(array, Star().sample(), gamma=0.5, steps=3, output="phase", medium=medium)
    np.testing.assert_array_equal(solution.drive, expected.drive)
    assert (solution.medium, solution.array.transducer.strength) == (medium, 8.49)


def test_the_help_of_solve_names_every_method_and_option(phasewire: Run) -> None:
    text = " ".join(phasewire("solve", "--help").out.split())
    for name, method in METHODS.items():
        assert f"{name}: {method.summary}" in text
        assert all(option in text for option in method.options)


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """A file solved for one point with a few transducers, which takes no time to look at."""
    path = tmp_path / "small.npz"
    save_solution(path, solve(TransducerArray.grid(4, 3), ControlPoints([[0.01, 0, 0.05], [-0.03, 0, 0.05]], [1, 0])))
    return path


@pytest.mark.parametrize(
    ("options", "shape", "corner"),
    [
        (("--plane", "xy"), (5, 5), (-0.02, -0.02, 0.05)),
        (("--plane", "xz"), (5, 5), (-0.02, 0, 0.03)),
        (("--plane", "yz", "--at", "0.01"), (5, 5), (0.01, -0.02, 0.03)),
        (("--plane", "yz", "--extent", "0.1"), (11, 11), (0, -0.05, 0.01)),
        (("--plane", "box"), (5, 5, 5), (-0.02, -0.02, 0.03)),
    ],
)
def test_field_samples_planes_and_boxes(
    phasewire: Run, small: Path, tmp_path: Path, options: tuple[str, ...], shape: tuple[int, ...], corner: tuple[float]
) -> None:
    """Standing ones are centred on the point's height, but begin 1 cm above the array."""
    outcome = phasewire("field", "small.npz", "-o", "f.npz", "--extent", "0.04", "--step", "0.01", *options)
    assert outcome.code == 0
    field = load_field(tmp_path / "f.npz")
    assert field.pressure.shape == shape
    np.testing.assert_allclose(field.grid.positions()[(0,) * len(shape)], corner, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "begin"), [("f.vti", b"<?xml"), ("f.png", b"\x89PNG"), ("f.svg", b"<?xml"), ("f.npz", b"PK")]
)
def test_field_writes_the_format_of_the_name(
    phasewire: Run, small: Path, tmp_path: Path, name: str, begin: bytes
) -> None:
    outcome = phasewire("field", "small.npz", "-o", name, "--plane", "xz", "--extent", "0.04", "--step", "0.01")
    assert outcome.code == 0
    assert (tmp_path / name).read_bytes().startswith(begin)


@pytest.mark.parametrize("quantity", ["intensity", "radiation", "oil"])
def test_field_draws_quantities(phasewire: Run, small: Path, tmp_path: Path, quantity: str) -> None:
    assert phasewire("field", "small.npz", "-o", "f.png", "--step", "0.004", "--quantity", quantity).code == 0
    assert (tmp_path / "f.png").read_bytes().startswith(b"\x89PNG")


def test_field_without_a_gpu_says_so_and_uses_the_processor(
    phasewire: Run, small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "jax", None)
    command = ("field", "small.npz", "--step", "0.01", "-o")
    assert "warning" not in phasewire(*command, "here.npz").err
    outcome = phasewire(*command, "there.npz", "--backend", "cuda")
    assert outcome.code == 0
    assert outcome.err.count("warning: backend 'cuda' is replaced by 'cpu': a GPU needs the package jax") == 1
    here, there = (load_field(tmp_path / name).pressure for name in ("here.npz", "there.npz"))
    assert here.tobytes() == there.tobytes()


def test_field_reports_the_strongest_sample(phasewire: Run, small: Path) -> None:
    outcome = phasewire("field", "small.npz", "-o", "f.npz", "--height", "0.05", "--step", "0.002", "--json", "-")
    record = json.loads(outcome.out)
    solution = load_solution(small)
    where = [record["strongest"][name] for name in ("x_m", "y_m", "z_m")]
    assert record["centre_m"] == [0, 0, 0.05]
    at = abs(pressure(solution.array, solution.drive, [where])[0])
    assert record["strongest"]["pa"] == pytest.approx(at, rel=1e-4)


def test_focus_reports(phasewire: Run, small: Path) -> None:
    outcome = phasewire("focus", "small.npz", "--json", "-")
    assert outcome.code == 0
    assert "1 focus:" in outcome.err
    assert "null, " in outcome.err
    record = json.loads(outcome.out)
    assert record["format"] == "phasewire-focus-1"
    assert record["foci"][0]["position"] == [0.01, 0, 0.05]
    assert record["nulls"][0]["index"] == 1
    assert max(len(line) for line in phasewire("focus", "small.npz").out.splitlines()[:6]) <= 80


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("p.csv", "0,0,0.2\n0.02,0,0.2\n"),
        ("p.json", '{"positions": [[0,0,0.2],[0.02,0,0.2]]}'),
        ("p.txt", "0 0 0.2\n0.02 0 0.2\n"),
    ],
)
def test_points_come_from_files(phasewire: Run, tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
    outcome = phasewire("solve", name, "-o", "p.npz", "--columns", "8", "--rows", "8", "--pitch", "0.01")
    assert outcome.code == 0
    assert "2 control points, 64 transducers" in outcome.out


@pytest.mark.parametrize(
    ("source", "options", "count"),
    [
        ("star", (), 30),
        ("star", ("--spacing", "0.0182"), 20),
        ("polygon:sides=3,radius=0.03", (), 9),
        ("polyline:vertices=line.txt,closed=yes", ("--spacing", "0.02"), 6),
    ],
)
def test_shapes_have_their_own_spacing_unless_one_is_given(
    phasewire: Run, tmp_path: Path, source: str, options: tuple[str, ...], count: int
) -> None:
    """The triangle's sides measure 52 mm, nearest to three steps of 15 mm; the line is 3 + 4 + 5 cm long."""
    (tmp_path / "line.txt").write_text("0 0 0.2\n0.03 0 0.2\n0.03 0.04 0.2\n")
    outcome = phasewire("solve", source, "-o", "s.npz", "--columns", "8", "--rows", "8", *options)
    assert outcome.code == 0
    assert outcome.out.startswith(f"{count} control points")


def test_raw_pulses_can_be_shown(phasewire: Run, tmp_path: Path) -> None:
    width = np.zeros(320, np.uint8)
    width[17] = 25
    np.savez(tmp_path / "one.npz", phase=np.full(320, 25, np.uint8), width=width)
    with Emulator(serial="RAW") as emulator:
        outcome = phasewire("show", "one.npz", "--device", "emulator:RAW", "--seconds", "0", "--json", "-")
        emulator.run(5)
        capture = emulator.capture()
    assert outcome.code == 0
    drive = capture.drive(json.loads(outcome.out)["commit_period"])
    assert np.flatnonzero(np.abs(drive)).tolist() == [17]
    assert not capture.drive(capture.periods - 1).any()


def test_info_describes_the_device(phasewire: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    outcome = phasewire("info", "--device", "emulator:?link=2wire")
    assert outcome.code == 0
    assert "5 boards of 2 processors, 2-wire links" in outcome.out
    assert "20000 updates/s" in outcome.out
    with Emulator(serial="FROM-ENV"):
        monkeypatch.setenv("PHASEWIRE_DEVICE", "emulator:FROM-ENV")
        assert "FROM-ENV" in phasewire("info").out
        assert "FROM-ENV" not in phasewire("info", "--device", "emulator:").out
    with Emulator(serial="FIRED") as emulator, open_device(emulator.url) as device:
        assert "watchdog has" not in phasewire("info", "--device", "emulator:FIRED?door=serial").out
        device.enable()
        emulator.run(5000)
        assert (
            "off (OFF); the watchdog has turned them off"
            in phasewire("info", "--device", "emulator:FIRED?door=serial").out
        )


UNITS = (" m.", " m;", "°C", " s.", " s;", " ns", " Hz", "Frequency", "per second", "Of the modulation.")


def test_every_command_and_option_is_explained(phasewire: Run) -> None:
    for context in each_command(typer.Context(command_line(), info_name="phasewire")):
        command, path = context.command, context.command_path.split()[1:]
        assert (command.help or "").strip().endswith("."), path
        outcome = phasewire(*path, "--help")
        assert (outcome.code, outcome.err) == (0, "")
        assert max(map(len, outcome.out.splitlines())) <= 100
        assert re.search(rf"\n  Example: phasewire {' '.join(path)}\b", outcome.out), path
        for parameter in command.params:
            explanation = getattr(parameter, "help", None)
            assert explanation, f"{path} {parameter.name}"
            assert explanation.endswith("."), f"{path} {parameter.name}"
            if isinstance(getattr(parameter, "default", None), float):
                assert any(unit in explanation for unit in UNITS), f"{path} {parameter.name}"
    assert "Exit codes" in phasewire("--help").out


def test_a_device_that_is_in_use_elsewhere_is_code_4(phasewire: Run) -> None:
    with Emulator(serial="TAKEN") as emulator, open_device(emulator.url):
        outcome = phasewire("info", "--device", "emulator:TAKEN")
    assert outcome.code == 4
    assert "another program is using the device" in outcome.err


def test_too_little_memory_is_code_2(phasewire: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def exhausted(*arguments: object, **options: object) -> None:
        raise MemoryError

    monkeypatch.setattr("phasewire.cli.solving.Solver", exhausted)
    outcome = phasewire("solve", "circle", "-o", "x.npz")
    assert (outcome.code, "not enough memory" in outcome.err) == (2, True)


def test_show_lasts_for_its_seconds_and_feeds_the_watchdog(phasewire: Run, solved: Path) -> None:
    with Emulator(serial="LASTING"):
        outcome = phasewire("show", solved.name, "--device", "emulator:LASTING", "--seconds", "0.5", "--json", "-")
    record = json.loads(outcome.out)
    lasted = record["status"]["now"] // 50 - record["commit_period"]
    assert 0.49 * 40_000 <= lasted <= 0.51 * 40_000, "five times as long as the watchdog waits, of the device's time"


def test_show_reports_that_the_watchdog_fired(phasewire: Run, solved: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with Emulator(serial="STALLED") as emulator:
        held_up = lambda keeper, seconds: emulator.run(5000)  # noqa: E731  # for 125 ms
        monkeypatch.setattr("phasewire.emulator.doors.device_time.DeviceTime.sleep", held_up)
        outcome = phasewire("show", solved.name, "--device", "emulator:STALLED", "--seconds", "5")
    assert outcome.code == 4
    assert "has turned its outputs off: it heard nothing for 0.1 s" in outcome.err


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="only Linux has a disk that is always full")
def test_a_full_disk_names_the_standard_output(tmp_path: Path) -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "phasewire", "config"], stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert (done.returncode, done.stderr) == (2, "phasewire: standard output: No space left on device\n")


def test_the_help_lists_every_summary_in_full_under_its_panel(phasewire: Run) -> None:
    said = " ".join(phasewire("--help").out.split())
    for panel, homes in PANELS.items():
        said = said[said.index(f" {panel}: ") :]
        for name, home in homes.items():
            said = said[said.index(f" {name} {home.help}") :]


@pytest.mark.parametrize(
    ("name", "raised"), [("SIGINT", KeyboardInterrupt), ("SIGTERM", SystemExit), ("SIGHUP", SystemExit)]
)
def test_the_first_signal_unwinds_and_later_ones_are_ignored(name: str, raised: type[BaseException]) -> None:
    number = signal.Signals[name]
    before = signal.getsignal(number)
    with unwinding(last=False):
        with pytest.raises(raised) as error:
            signal.raise_signal(number)
        for later in (number, signal.SIGINT, signal.SIGTERM):
            signal.raise_signal(later)
    assert signal.getsignal(number) == before
    if isinstance(error.value, SystemExit):
        assert error.value.code == 128 + number


def test_a_signal_counts_again_if_the_first_was_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    """NumPy drops an exception of an attribute that it asks for, with no word."""

    class Pressed(type):
        def __getattr__(cls, name: str) -> object:
            signal.raise_signal(signal.SIGINT)
            raise AttributeError(name)

    class Operand(metaclass=Pressed):
        pass

    monkeypatch.setattr("phasewire.base.signals.DEAF_SECONDS", 0)
    with unwinding(last=False):
        _ = np.zeros(2) == Operand()
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_lost_in_a_callback_is_raised_again(number: int) -> None:
    """An exception in ``__del__`` goes no further."""

    class Gone:
        def __del__(self) -> None:
            signal.raise_signal(number)

    def work() -> None:
        Gone()
        time.sleep(60)

    with unwinding(last=False), pytest.raises((KeyboardInterrupt, SystemExit)):
        work()


def test_a_signal_that_is_ignored_stays_so_and_at_the_end_all_are() -> None:
    """As Ctrl-C is under nohup, or in a shell's background."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    try:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        with unwinding(last=True):
            signal.raise_signal(signal.SIGINT)
        assert {signal.getsignal(number) for number in before} == {signal.SIG_IGN}
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


BAD = [
    # (arguments, exit code, a part of the message)
    (
        ("solve", "cube", "-o", "x.npz"),
        2,
        "'cube' is no shape or file of points; it is an object for `phasewire touch`",
    ),
    (("play", "cup.STL:scale=0.001"), 2, "; it is an object for `phasewire touch`"),
    (("solve", "sphere:radus=1"), 2, "sphere has no parameter 'radus'; it has height, palm"),
    (("solve", "sphere:radius=0.04"), 2, "Missing option '--output' / '-o'"),
    (("solve", "sphere:palm=0.5", "-o", "x.npz"), 2, "misses the sphere, which spans 0.12 to 0.22 m"),
    (
        ("solve", "circle:height=3", "-o", "sphere.npz"),
        2,
        "out of reach, more than 2 m away; coordinates are in metres",
    ),
    (("solve", "circle:height=200", "-o", "x.npz"), 2, "positive and at most 5 m; lengths are in metres"),
    (
        ("solve", "circle", "-o", "x.npz", "--pitch", "10.3"),
        2,
        "pitch 10.3 m must be positive and at most 5 m; lengths are in metres: 10.3 mm is 0.0103",
    ),
    (
        ("solve", "circle", "-o", "x.npz", "--columns", "99999999"),
        2,
        "columns 99999999 must be a whole number from 1 to 1000000",
    ),
    (("solve", "circle", "-o", "x.txt"), 2, "x.txt: the name of a solved file ends in .npz"),
    (("solve", "circle", "-o", "no/such/x.npz"), 2, "no/such/x.npz cannot be written: there is no folder no/such"),
    (
        ("solve", "circle", "-o", "x.npz", "--method", "magic"),
        2,
        "unknown method 'magic'; known are wgs, polish, tikhonov",
    ),
    (("solve", "circle", "-o", "x.npz", "--set", "gamma"), 2, "--set 'gamma' must be a name, = and a value"),
    (("solve", "circle", "-o", "x.npz", "--set", "gamma=x"), 2, "gamma 'x' must be a number"),
    (("solve", "circle", "-o", "x.npz", "--set", "mu=1", "--set", "mu=2"), 2, "--set mu is given twice"),
    (
        ("solve", "circle", "-o", "x.npz", "--set", "precision=double"),
        2,
        "wgs has no option 'precision'; it has",
    ),
    (("solve", "circle", "-o", "x.npz", "--transducer", "T"), 2, "unknown transducer 'T'; known are MA40S4S"),
    (("solve", "circle", "-o", "x.npz", "--model", "point"), 2, "unknown transducer model 'point'; known are monopole"),
    (("solve", "circle", "-o", "x.npz", "--humidity", "101"), 2, "humidity 101.0 % must be from 0 to 100 %"),
    (("solve", "circle", "-o", "x.npz", "--rows", "0"), 2, "rows 0 must be a whole number from 1"),
    (("solve", "circle", "-o", "x.npz", "--spacing", "0"), 2, "spacing 0.0 m must be positive"),
    (("solve", "circle", "-o", "x.npz", "--temperature", "-400"), 2, "temperature -400.0 °C"),
    (("solve", "behind.csv", "-o", "x.npz"), 2, "control point 1 at [0.0, 0.0, -0.1] m is on the array or behind it"),
    (("solve", "nan.csv", "-o", "x.npz"), 2, "nan.csv: control point 0 is [0.0, nan, 0.2]"),
    (("solve", "missing.csv", "-o", "x.npz"), 2, "missing.csv"),
    (("show", "missing.npz"), 2, "phasewire: missing.npz: No such file or directory"),
    (("show", "truncated.npz"), 2, "truncated.npz is truncated, corrupted or not an NPZ file"),
    (("show", "corrupted.npz"), 2, "corrupted.npz is truncated, corrupted or not an NPZ file"),
    (("show", "other.npz"), 2, "other.npz holds neither a solution nor pulses"),
    (("show", "short.npz"), 2, "short.npz is for 64 transducers, but the device has 320"),
    (("show", "wide.npz"), 2, "wide.npz: width 26 of transducer 0 is outside 0 to 25 ticks"),
    (
        ("show", "sphere.npz", "--device", "nonsense:"),
        3,
        "the URL of a device begins with one of emulator:, rfc2217:, serial:, socket:, usb:, usbip:",
    ),
    (("show", "sphere.npz", "--device", "emulator:NOT-THERE"), 3, "no device at 'emulator:NOT-THERE'"),
    (("show", "sphere.npz", "--seconds", "-1"), 2, "Invalid value for '--seconds'"),
    (("info", "--device", "COM3"), 3, "for this serial port write serial:COM3"),
    (("conformance", "--device", "COM3"), 3, "for this serial port write serial:COM3"),
    (("info", "--device", "/dev/ttyACM0"), 3, "for this serial port write serial:///dev/ttyACM0"),
    (("info", "--device", "emulator:?door=serail"), 2, "unknown door 'serail'; known are usb, serial"),
    (("info", "--device", "serial:COM3?baud=fast"), 2, "baud 'fast' is no rate; write bits per second"),
    (("stream", "sphere.npz", "--device", "emulator:?door=serial"), 2, "its URL says so: ?baud=RATE"),
    (("flash", "sphere.npz"), 2, "sphere.npz is a zip archive, such as a solved file (.npz), and no firmware image"),
    (("info", "--device", "emulator:?link=9wire"), 2, "unknown link '9wire'; known are 5wire, 2wire"),
    (("stop", "--device", "usb:no-such-serial"), 3, "no device at 'usb:no-such-serial'"),
    (("field", "truncated.npz", "-o", "f.png"), 2, "truncated.npz is truncated, corrupted"),
    (("field", "sphere.npz", "-o", "f.bmp"), 2, "f.bmp: a picture's name ends in .png, .svg, .pdf"),
    (("field", "sphere.npz", "-o", "f.png", "--plane", "zz"), 2, "unknown plane 'zz'; known are xy, xz, yz, box"),
    (("field", "sphere.npz", "-o", "f.png", "--plane", "box"), 2, "f.png: a box cannot be drawn"),
    (("field", "sphere.npz", "-o", "f.npz", "--plane", "box", "--at", "1"), 2, "--at 1.0 has no meaning for a box"),
    (("field", "sphere.npz", "-o", "f.png", "--quantity", "taste"), 2, "unknown quantity 'taste'; known are pressure"),
    (("field", "sphere.npz", "-o", "f.png", "--plane", "xz", "--quantity", "oil"), 2, "oil lies level"),
    (("field", "sphere.npz", "-o", "f.vti", "--quantity", "oil"), 2, "f.vti: --quantity chooses what a picture shows"),
    (("field", "sphere.npz", "-o", "f.npz", "--backend", "gpu"), 2, "backend 'gpu' must be one of cpu, cuda"),
    (("field", "sphere.npz", "-o", "f.npz", "--height", "-1"), 2, "height -1.0 m must be positive"),
    (("focus", "truncated.npz"), 2, "truncated.npz is truncated, corrupted"),
    (("focus", "sphere.npz", "--json", "sphere.npz"), 2, "sphere.npz cannot be written: it is also what is read"),
    (("field", "sphere.npz", "-o", "f.png", "--step", "0"), 2, "step 0.0 m must be positive"),
    (("field", "sphere.npz", "-o", "f.png", "--height", "0.0001"), 2, "the model 'piston' needs at least 4.50 mm"),
    (("field", "sphere.npz", "-o", "sphere.npz"), 2, "sphere.npz cannot be written: it is also what is read"),
    (("show", "sphere.npz", "--json", "sphere.npz"), 2, "sphere.npz cannot be written: it is also what is read"),
    (("solve", "polyline:vertices=on.csv", "-o", "x.npz"), 2, "all of whose corners lie at [0.0, 0.0, 0.0] m has no"),
    (("solve", "polyline:vertices=missing.csv", "-o", "x.npz"), 2, "missing.csv"),
    (
        ("solve", "polyline:closed=yes,vertices=on.csv", "-o", "x.npz", "--json", "on.csv"),
        2,
        "on.csv cannot be written: it is also what is read",
    ),
    (("solve", "on.csv", "-o", "x.npz", "--json", "on.csv"), 2, "on.csv cannot be written: it is also what is read"),
    (("solve", "circle", "-o", "x.npz", "--json", "x.npz"), 2, "x.npz cannot be written: it is to be written twice"),
    (("show", "sphere.npz", "--json", "."), 2, "'.' cannot be written: it is a folder"),
    (
        ("field", "sphere.npz", "-o", "f.png", "--extent", "1e200"),
        2,
        "extent 1e+200 m must be positive and at most 5 m",
    ),
    (("reproduce", "figure6", "-o", "x.txt"), 2, "x.txt: a picture's name ends in .png"),
    (("demo", "--picture", "demo.gif"), 2, "demo.gif: a picture's name ends in"),
    (("demo", "--json", "no/such/demo.json"), 2, "there is no folder no/such"),
    (("field", "sphere.npz", "-o", "no/such/f.png"), 2, "there is no folder no/such"),
    (("dance",), 2, "No such command 'dance'"),
    (("solve",), 2, "Missing argument"),
]


@pytest.mark.parametrize(("arguments", "code", "message"), BAD, ids=[" ".join(case[0]) for case in BAD])
def test_bad_input_gets_a_clear_error(
    phasewire: Run, solved: Path, tmp_path: Path, arguments: tuple[str, ...], code: int, message: str
) -> None:
    (tmp_path / "behind.csv").write_text("0,0,0.2\n0,0,-0.1\n")
    (tmp_path / "on.csv").write_text("0,0,0\n")
    (tmp_path / "nan.csv").write_text("0,nan,0.2\n")
    whole = solved.read_bytes()
    (tmp_path / "truncated.npz").write_bytes(whole[:5000])
    drive_at = whole.index(b"drive.npy") + 1000
    (tmp_path / "corrupted.npz").write_bytes(whole[:drive_at] + b"\xff" + whole[drive_at + 1 :])
    np.savez(tmp_path / "other.npz", a=np.ones(3))
    np.savez(tmp_path / "short.npz", phase=np.zeros(64, int), width=np.zeros(64, int))
    np.savez(tmp_path / "wide.npz", phase=np.zeros(320, int), width=np.full(320, 26))
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}

    outcome = phasewire(*arguments)

    assert outcome.code == code
    assert message in " ".join(outcome.err.split())
    assert "Traceback" not in outcome.err + outcome.out
    written = {path: path.read_bytes() for path in tmp_path.iterdir()}
    assert written == before


def test_names_are_printed_literally(phasewire: Run, tmp_path: Path) -> None:
    (tmp_path / "[").mkdir()
    assert "Written to [/b]:key:.npz" in phasewire("solve", "circle", "-o", "[/b]:key:.npz").out
    assert "[/b].png" in phasewire("field", "[/b]:key:.npz", "-o", "[/b].png", "--step", "0.01").out
    assert "[red]:key:.npz: No such file" in phasewire("show", "[red]:key:.npz").err
