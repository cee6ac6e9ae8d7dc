"""Every command as a process of its own: its output, its exit code, and that it leaves no file or process."""

from __future__ import annotations

import json
import os
import pty
import re
import select
import shutil
import signal
import subprocess
import sys
import termios
import time
import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import pytest
import typer
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat, PublicFormat
from phasewire import Sphere, TransducerArray, solve
from phasewire.cli.commands import command_line
from phasewire.cli.settings import each_command
from phasewire.solver.fields.files import save_solution

from tests.host import upgrades

pytestmark = pytest.mark.slow  # each begins processes

PATIENCE = 120.0
COMMAND = (sys.executable, "-m", "phasewire")
MARK = "PHASEWIRE_TEST_MARK"
NO_OP = "50 57 01 09"


class Row(NamedTuple):
    """A command line and its expected result."""

    line: str
    says: str
    """A regular expression for the words that it prints."""
    codes: tuple[int, ...] = (0,)
    makes: tuple[str, ...] = ()
    """Files that it adds to its folder."""
    json: bool = True


OFF = r"outputs are off"

ROWS = {
    "demo": Row("demo", r"PASS: the rebuilt drive is the intended one", makes=("demo.png",)),
    "conformance": Row(
        "conformance --only numbering --html report.html --junit report.xml",
        r"PASS: nothing broke; .*\bcases\b.* passed",
        makes=("report.html", "report.xml"),
    ),
    "budget": Row(
        "budget --link 2wire --picture budget.png", r"Sustained rate: 20,000 updates/s", makes=("budget.png",)
    ),
    "decode": Row(f"decode --hex '{NO_OP}' --format blocks", r"LENGTH BLK-\d+", codes=(1,)),
    "vectors": Row("vectors --output vectors.json", r"", makes=("vectors.json",), json=False),
    "solve": Row("solve star --output star.npz", r"30 control points, 320 transducers", makes=("star.npz",)),
    "field": Row("field solved.npz --output f.npz --step 0.01", r"strongest \d+ Pa", makes=("f.npz",)),
    "focus": Row("focus solved.npz", r"17 foci:"),
    "reproduce figure6": Row("reproduce figure6", r"Drawn to figure6.png", makes=("figure6.png",)),
    "reproduce figure7": Row("reproduce figure7", r"Drawn to figure7.png", makes=("figure7.png",)),
    "reproduce range": Row("reproduce range", r"Drawn to range.png", makes=("range.png",)),
    "reproduce figure4": Row("reproduce figure4", r"Drawn to figure4.png", makes=("figure4.png",)),
    "feel": Row("feel circle:radius=0.02 --render am --output felt.png", r"threshold", makes=("felt.png",)),
    "study": Row("study --persons 2 --trials 1 --seconds 0.5", r"chance", codes=(0, 1), makes=("study.png",)),
    "sweep": Row(
        "sweep designs.csv --on serial --output r.parquet", r"2 rows: 2 measured in .*, 0 of", makes=("r.parquet",)
    ),
    "show": Row("show solved.npz --seconds 0.1", OFF),
    "stop": Row("stop", OFF),
    "info": Row("info", r"20 × 16 transducers"),
    "devices": Row("devices", r"no device found|url", codes=(0, 3)),  # whether this computer has one
    "doctor": Row("doctor --device emulator:", r"\d+ ok, \d+ warn, 0 fail"),
    "tracker": Row("tracker gesture:sweep --seconds 0.2", r"palms of \d+ mm"),
    "read-back": Row("read-back", r"plays nothing"),
    "identify": Row("identify 2", r"light on board 2"),
    "reset": Row("reset", r"has restarted"),
    "clear-faults": Row("clear-faults", r"has no faults"),
    "watchdog": Row("watchdog 0.5", r"waits 0\.5 s"),
    "limit": Row("limit 100", r"refuses more than 100 full transducers"),
    "stream": Row("stream circle:radius=0.02 --spin 5 --rate 1000 --seconds 0.05", OFF),
    "play": Row("play circle --seconds 0.05", OFF),
    "touch": Row("touch cube --hand gesture:sweep?rate=100 --seconds 1.5", OFF),
    "view": Row("view cube --no-browser --unwatched --seconds 0.2", OFF),
    "record": Row(
        "record circle --seconds 0.01 --output c.frames", r"c\.frames: 10 frames at 1000/s", makes=("c.frames",)
    ),
    "flash": Row("flash new.dfu", r"given firmware 2\.3\.4"),
    "firmware build": Row(
        "firmware build --controller c.bin --processors p.bin --firmware-version 1.2.3 --output made.dfu",
        r"1\.2\.3",
        makes=("made.dfu",),
    ),
    "firmware inspect": Row("firmware inspect new.dfu", r"2\.3\.4"),
    "firmware sign": Row("firmware sign new.dfu --key key.pem --output signed.dfu", r"", makes=("signed.dfu",)),
    "firmware verify": Row("firmware verify new.dfu --key public.pem", r"UNSIGNED", codes=(1,)),
    "xs1 asm": Row(
        "xs1 asm play.s --output made.bin", r"made\.bin: 8 bytes; 65,528 of 65,536", makes=("made.bin", "made.map")
    ),
    "xs1 disasm": Row("xs1 disasm play.bin", r"10002 +\w+ +out res\[r0\], r1"),
    "xs1 run": Row("xs1 run play.bin --reg r0=0x10400 --ms 0.1", r"all cycles were executed +39,999"),
    "xs1 trace": Row("xs1 trace play.bin --reg r0=0x10400 --count 3", r"out res\[r0\], r1"),
    "emulate": Row("emulate --seconds 0 --port 0 --serial pty", r"Ended; the devices are gone"),
    "attach": Row("attach 127.0.0.1:1", r"", codes=(3,), json=False),
    "config": Row("config", r"show +seconds +1\.0 +built-in"),
}


class Ended(NamedTuple):
    """The result of a process."""

    code: int
    out: str
    err: str


def environment(**more: str) -> dict[str, str]:
    """Our variables without those that change a command, and with a mark that finds its children."""
    own = {name: value for name, value in os.environ.items() if name not in ("PHASEWIRE_DEVICE", "NO_COLOR")}
    return own | {MARK: uuid.uuid4().hex, "COLUMNS": "100"} | more


def left_running(marked: Mapping[str, str]) -> list[str]:
    """The command lines of processes that have inherited a mark, detached ones too."""
    entry = f"{MARK}={marked[MARK]}".encode()
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if entry in (folder / "environ").read_bytes().split(b"\0"):
                found.append((folder / "cmdline").read_text())
        except OSError:  # it has ended, or is not ours
            continue
    return found


def run(folder: Path, line: str, **more: str) -> Ended:
    """Run a command line to its end in a folder."""
    marked = environment(**more)
    words = [word.strip("'") for word in re.findall(r"'[^']*'|\S+", line)]
    with subprocess.Popen(
        [*COMMAND, *words],
        cwd=folder,
        env=marked,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as process:
        try:
            out, err = process.communicate(timeout=PATIENCE)
        finally:
            process.kill()
    assert left_running(marked) == []
    return Ended(process.returncode, out, err)


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Files that commands read."""
    folder = tmp_path_factory.mktemp("inputs")
    save_solution(folder / "solved.npz", solve(TransducerArray.grid(), Sphere().sample()))
    (folder / "new.dfu").write_bytes(upgrades.FILE)
    (folder / "designs.csv").write_text("source,columns,rows\nstar,10,8\nstar,20,16\n")
    (folder / "c.bin").write_bytes(b"controller")
    (folder / "p.bin").write_bytes(b"processors")
    (folder / "play.s").write_text("    setc res[r0], 8\nnext:\n    out res[r0], r1\n    eq r1, r1, 0\n    bu next\n")
    (folder / "play.bin").write_bytes(bytes.fromhex("08e8c4ae14b00377"))
    private = upgrades.KEY.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    (folder / "key.pem").write_bytes(private)
    public = upgrades.KEY.public_key().public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo)
    (folder / "public.pem").write_bytes(public)
    return folder


@pytest.fixture
def folder(inputs: Path, tmp_path: Path) -> Path:
    """A folder with the inputs alone."""
    return Path(shutil.copytree(inputs, tmp_path / "here"))


def test_every_command_has_a_row() -> None:
    names = [context.command_path.partition(" ")[2] for context in each_command(root())]
    assert sorted(names) == sorted(ROWS)


def root() -> typer.Context:
    return typer.Context(command_line(), info_name="phasewire")


@pytest.mark.parametrize("name", ROWS)
def test_a_command_prints_its_result_and_leaves_no_file_or_process(name: str, folder: Path) -> None:
    row = ROWS[name]
    before = {path.name for path in folder.iterdir()}
    ended = run(folder, row.line + (" --json -" if row.json else ""))
    assert ended.code in row.codes, ended.err
    assert "Traceback" not in ended.err
    assert {path.name for path in folder.iterdir()} - before == set(row.makes)
    said = ended.err if row.json else ended.out
    assert re.search(row.says, said), said
    assert "\x1b" not in ended.out + ended.err
    if row.json:
        assert re.fullmatch(r"phasewire-[a-z-]+-\d+", json.loads(ended.out)["format"])


def test_verbose_works_before_and_after_the_command(folder: Path) -> None:
    told = run(folder, "-v stop").err
    assert re.search(r"^ +0\.\d{6} s  in  request +INFO: firmware ", told, re.MULTILINE)
    assert re.search(r"^ +0\.\d{6} s  out request +DISABLE$", told, re.MULTILINE)
    ended = run(folder, "show solved.npz --seconds 0.05 -vv --json -")
    assert json.loads(ended.out)
    assert re.search(r"out block +UPDATE 1: 320 pulses", ended.err)


@contextmanager
def in_terminal(folder: Path, line: str, **more: str) -> Iterator[tuple[subprocess.Popen[bytes], int]]:
    """A command line in a terminal of its own, and the terminal's other end.

    It does not echo, and on a Ctrl-C it keeps unread output, which a terminal discards by default.
    """
    ours, theirs = pty.openpty()
    mode = termios.tcgetattr(theirs)
    mode[3] = mode[3] & ~termios.ECHO | termios.NOFLSH  # the local flags
    termios.tcsetattr(theirs, termios.TCSANOW, mode)
    marked = environment(TERM="xterm-256color", **more)

    process = subprocess.Popen(
        [*COMMAND, *line.split()], cwd=folder, env=marked, preexec_fn=lambda: os.login_tty(theirs), pass_fds=[theirs]
    )
    os.close(theirs)
    try:
        yield process, ours
    finally:
        process.kill()
        process.wait()
        os.close(ours)
    assert left_running(marked) == []


def read_until(terminal: int, pattern: str | None) -> str:
    """The output of a terminal up to a pattern, or to its end."""
    text, end = b"", time.monotonic() + PATIENCE
    while pattern is None or not re.search(pattern, text.decode(errors="replace")):
        left = end - time.monotonic()
        assert left > 0, text
        assert select.select([terminal], [], [], left)[0], text
        try:
            more = os.read(terminal, 4096)
        except OSError:  # its other end is closed
            break
        if not more:
            break
        text += more
    return text.decode(errors="replace")


COLOURS = r"\x1b\[[0-9;]*(3[0-7]|9[0-7])"


def test_a_terminal_shows_colours_unless_no_color_is_set(folder: Path) -> None:
    for more, coloured in (({}, True), ({"NO_COLOR": "1"}, False)):
        with in_terminal(folder, "info --device nothing:", **more) as (process, terminal):
            said = read_until(terminal, None)
            assert process.wait(PATIENCE) == 3
        assert bool(re.search(COLOURS, said)) == coloured, said


def orders(said: str) -> list[str]:
    """The orders that a device was given, from traffic in words."""
    return re.findall(r"out request +(\w+)", said)


def interrupted(folder: Path, line: str, pattern: str, seconds: float = 0, times: int = 1) -> int:
    """Press Ctrl-C some seconds after a pattern is shown; the exit code of a command that turned its outputs off."""
    with in_terminal(folder, line) as (process, terminal):
        said = read_until(terminal, pattern)
        time.sleep(seconds)
        for _ in range(times):
            os.write(terminal, b"\x03")
            time.sleep(0.002)
        said += read_until(terminal, None)
        code = process.wait(PATIENCE)
    assert "Traceback" not in said
    assert "ENABLE" in orders(said)
    assert orders(said)[-1] == "DISABLE"
    return code


def test_repeated_ctrl_c_leaves_the_outputs_off(folder: Path) -> None:
    """The first ends the show; the others come while it turns the outputs off, and afterwards."""
    line = "show solved.npz --forever -v --json shown.json"
    assert interrupted(folder, line, r"PLAYING at tick \d+", times=5) == 0  # the normal end of --forever
    assert json.loads((folder / "shown.json").read_text())["status"]["missed_commits"] == 0


def test_ctrl_c_before_the_time_is_over_is_code_130(folder: Path) -> None:
    line = "stream circle --seconds 60 --rate 10 -v --json streamed.json"
    assert interrupted(folder, line, "UPDATE", times=2) == 130
    assert not (folder / "streamed.json").exists()


@pytest.mark.parametrize("milliseconds", range(0, 60, 4))
def test_ctrl_c_at_any_moment_leaves_the_outputs_off(folder: Path, milliseconds: int) -> None:
    """Also while the outputs are being turned off because the time is over."""
    line = "show solved.npz --seconds 0.02 -v"
    assert interrupted(folder, line, r"plays solved\.npz", milliseconds / 1000) in (0, 130)


BEGUN = """
import signal
from phasewire.__main__ import main
real = signal.signal
def told(number, handler):
    before = real(number, handler)
    if number == signal.SIGHUP:
        signal.signal = real
        print("begun", flush=True)
    return before
signal.signal = told
main()
"""
"""A program that prints a word once it handles signals; before that Python handles them, with a traceback."""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("line", ["--help", "info", "conformance --only numbering"])
def test_a_signal_during_loading_ends_the_program_quietly(folder: Path, line: str, number: int) -> None:
    for milliseconds in (0, 20, 50, 100, 200, 400, 800):
        with subprocess.Popen(
            [sys.executable, "-c", BEGUN, *line.split()],
            cwd=folder,
            env=environment(),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        ) as process:
            assert process.stdout
            assert process.stdout.readline() == b"begun\n"
            time.sleep(milliseconds / 1000)
            process.send_signal(number)
            _, said = process.communicate(timeout=PATIENCE)
        assert process.returncode in (0, 128 + number, -number), said  # a shell reports the latter two alike
        assert b"Traceback" not in said
        assert b"Exception" not in said


def test_sigterm_leaves_the_outputs_off(folder: Path) -> None:
    command = [*COMMAND, "show", "solved.npz", "--forever", "-v", "--json", "shown.json"]
    with subprocess.Popen(command, cwd=folder, env=environment(), stderr=subprocess.PIPE) as process:
        assert process.stderr
        try:
            said = read_until(process.stderr.fileno(), r"PLAYING at tick \d+")
            process.send_signal(signal.SIGTERM)
            said += read_until(process.stderr.fileno(), None)
            assert process.wait(PATIENCE) == 128 + signal.SIGTERM
        finally:
            process.kill()
    assert "Traceback" not in said
    assert orders(said)[-1] == "DISABLE"
    assert not (folder / "shown.json").exists()


def test_compiling_is_told_once_without_a_terminal_too(folder: Path) -> None:
    for told in (["phasewire compiles its kernels: up to a minute, the first time on a machine"], []):
        ended = run(folder, "record circle --seconds 0.01 --output c.frames", NUMBA_CACHE_DIR=str(folder / "kernels"))
        assert (ended.code, ended.err.splitlines()) == (0, told)


def test_ctrl_c_in_a_computation_leaves_no_partial_file(folder: Path) -> None:
    before = {path.name for path in folder.iterdir()}
    command = [*COMMAND, "reproduce", "figure7", "--output", "f.png", "--json", "f.json"]
    with in_terminal(folder, " ".join(command[3:])) as (process, terminal):
        read_until(terminal, r"\.\.\.|⠋|⠙|timing|measuring|\w")
        os.write(terminal, b"\x03")
        said = read_until(terminal, None)
        assert process.wait(PATIENCE) == 130
    assert "Traceback" not in said
    assert {path.name for path in folder.iterdir()} == before


@pytest.mark.parametrize("line", ["vectors", "--help", "info", "stop -v 2>&1"])
def test_a_closed_pipe_ends_a_command_quietly(folder: Path, line: str) -> None:
    marked = environment()
    shell = f"set -o pipefail; {' '.join(COMMAND)} {line} | true"
    ended = subprocess.run(
        ["bash", "-c", shell], cwd=folder, env=marked, capture_output=True, text=True, timeout=PATIENCE, check=False
    )
    assert (ended.returncode, ended.stdout, ended.stderr) == (128 + signal.SIGPIPE, "", "")
    assert left_running(marked) == []
