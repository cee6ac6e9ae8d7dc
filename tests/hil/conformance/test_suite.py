"""The cases themselves: what they say of themselves, and that a sound device fails none of them, by whatever line."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterable
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from phasewire import Emulator
from phasewire.emulator.control.controller import Controller
from phasewire.emulator.doors.umockdev import run_under_mock
from phasewire.emulator.firmware.loader import DeviceIdentity, make_flash
from phasewire.hil.conformance import Run, Verdict
from phasewire.hil.conformance.cases import NOT_USB, Need, Risk, unmet
from phasewire.hil.conformance.clauses import revisions
from phasewire.hil.conformance.matrix import Matrix
from phasewire.hil.conformance.plugin import CatalogueCase
from phasewire.hil.conformance.profile import Profile
from phasewire.hil.conformance.running import GROUPS, RunOptions, catalogue, run_conformance
from phasewire.protocol.codes import State, Target
from phasewire.protocol.firmware import Image, Segment, sign
from phasewire.protocol.versions import Version
from phasewire.protocol.wiring import Wiring

from tests.emulator.test_umockdev import needs
from tests.host.serving import served_url

# What cases say of themselves


@pytest.fixture(scope="module")
def entries() -> list[CatalogueCase]:
    return catalogue()


def test_every_must_has_a_case_or_a_reason_and_none_has_both(entries: list[CatalogueCase]) -> None:
    matrix = Matrix.of(entry.claim for entry in entries)
    assert [row.name for row in matrix.missing()] == []
    assert [row.name for row in matrix.needless()] == []


BY_UNIT_TESTS = {("FWU-020", 3)}
"""What a device answers on a UART before USB has configured it: no bench has both."""


def test_every_change_of_a_revision_has_a_case_that_asks_for_it(entries: list[CatalogueCase]) -> None:
    asked = {(clause.partition("/")[0], each.about.since) for each in entries for clause in each.about.clauses}
    changed = {(clause, number) for clause, numbers in revisions().items() for number in numbers}
    assert len(changed) > 10
    assert changed - asked == BY_UNIT_TESTS


def test_every_case_has_a_name_of_its_own_and_says_in_one_or_two_sentences_what_it_does(
    entries: list[CatalogueCase],
) -> None:
    names = [entry.identifier for entry in entries]
    assert len(set(names)) == len(names) > 1000
    for entry in entries:
        sentence = entry.about.sentence
        assert re.fullmatch(r"[A-Z0-9`].*\.", sentence), f"{entry.identifier}: {sentence}"
        assert len(re.findall(r"\.(?= [A-Z])", sentence)) <= 1, f"{entry.identifier}: {sentence}"


# A sound device

YOUNG = "the device has been on for too short a time: N periods are left"
NO_CONNECTION = "this line has no connection to close; one by socket: has"
OF_A_BUS = {
    "this applies to UARTs",
    "this applies to a device that is used over a serial line alone",
    NO_CONNECTION,
    YOUNG,
}
PARTS = "only at full speed can a part of a block arrive, and this bus runs at high speed"
"""A packet of 512 bytes is a whole block."""
OF_A_UART = {
    NOT_USB,
    YOUNG,
    "a serial line cannot carry updates while PULSES are read",
    "the line is too slow for a stream",
    NO_CONNECTION,
    "the line is so slow that the queue never fills",
    "this line is slower than the chain: no store waits on the device",
    "the line is so slow that so many blocks take an hour",
}

REASONS = {
    "emulator:": OF_A_BUS | {PARTS},
    "emulator:?speed=full&link=2wire": OF_A_BUS | {PARTS},
    "emulator:?firmware=xs1": OF_A_BUS | {PARTS, unmet(Need.FREE_TIME)},
    "emulator:?door=serial": OF_A_UART
    | {
        "in N attempts no block came exactly N periods ahead of its change",
        "what had to be over before period N was over in period N: a slow line",
    },
    "emulator:?door=serial&baud=3000000": OF_A_UART,
}
"""Why a case is inconclusive on an emulator; numbers are N."""


def alike(reasons: Iterable[str]) -> set[str]:
    """Texts whose numbers are all N."""
    return {re.sub(r"\d+", "N", reason) for reason in reasons}


def check_sound(run: Run) -> None:
    """Fail if anything speaks against a device that is sound."""
    against = [result for result in run.results if result.verdict in (Verdict.FAIL, Verdict.WARN)]
    assert not against, "\n".join(f"{result.case}: {result.reason}" for result in against)
    assert run.passed, run.trouble


def check_no_case_speaks_against(url: str, *groups: str) -> Run:
    run = run_conformance(RunOptions(url, groups=groups))
    check_sound(run)
    assert alike(result.reason for result in run.results if result.verdict is Verdict.INCONCLUSIVE) <= REASONS[url]
    return run


NAMES = sorted(path.stem.removeprefix("test_").replace("_", "-") for path in GROUPS.glob("test_*.py"))
QUICK = ("limits", "numbering", "outputs", "robustness", "sorting", "versions")
"""Groups that `make test` tries too; CI tries all."""
ALL_BUT_LONG = tuple(name for name in NAMES if name != "long-run")
"""All groups but that of long runs, which one run on each device is enough for."""
ABOUT_A_LINE = ("acknowledgements", "console", "doors", "flow", "numbering", "outputs", "serial", "timing", "versions")
"""Groups for a line of the usual rate, by which many others can judge too little."""


@pytest.mark.parametrize(
    "group", [pytest.param(name, marks=() if name in QUICK else pytest.mark.slow) for name in NAMES]
)
def test_no_case_of_a_group_speaks_against_the_emulator(group: str) -> None:
    """The emulator as a black box is tested by these cases; tests/emulator has what no case can see."""
    run = check_no_case_speaks_against("emulator:", group)
    assert run.count(Verdict.PASS) > len(run.results) / 2


EXECUTED = (
    *("chain", "combinations", "modulation", "outputs", "power", "pulses", "safety", "sequences", "sorting", "states"),
    *("stores", "successions", "timing"),
)
"""Groups about what the processors do, and what depends on it."""


@pytest.mark.parametrize(
    "group", [pytest.param(name, marks=() if name == "sorting" else pytest.mark.slow) for name in EXECUTED]
)
def test_no_case_of_a_group_speaks_against_executed_firmware(group: str) -> None:
    """What `emulator:?firmware=xs1` may not judge is only what takes hours: here a second takes seconds."""
    run = check_no_case_speaks_against("emulator:?firmware=xs1", group)
    assert run.count(Verdict.PASS) >= len(run.results) - 3


@pytest.mark.slow
@pytest.mark.parametrize(
    ("url", "groups", "passes"),
    [
        ("emulator:?speed=full&link=2wire", ALL_BUT_LONG, 1300),
        ("emulator:?door=serial", ABOUT_A_LINE, 200),
        ("emulator:?door=serial&baud=3000000", ALL_BUT_LONG, 900),
    ],
)
def test_no_case_speaks_against_the_emulator_by_another_line(url: str, groups: tuple[str, ...], passes: int) -> None:
    assert check_no_case_speaks_against(url, *groups).count(Verdict.PASS) > passes


@pytest.mark.slow
def test_what_is_not_allowed_or_cannot_be_seen_is_never_passed(entries: list[CatalogueCase]) -> None:
    run = run_conformance(RunOptions("emulator:", capture="none", allowed=frozenset()))
    check_sound(run)
    needy = {entry.identifier for entry in entries if entry.about.risks or Need.CAPTURE in entry.about.needs}
    passed = {result.case for result in run.results if result.verdict is Verdict.PASS}
    assert len(needy) > 300
    assert not needy & passed
    assert len(passed) > 400


# Firmware that only its maker can sign

KEY = Ed25519PrivateKey.from_private_bytes(bytes(range(32)))
IMAGE = Image(
    Version(1, 0, 0),
    (Segment(Target.ALL_PROCESSORS, bytes(range(256)) * 20), Segment(Target.CONTROLLER, bytes(range(250)) * 24)),
)
"""Large enough for the cases of DFU."""


@pytest.mark.slow
def test_no_case_speaks_against_a_device_that_trusts_a_key() -> None:
    flash = make_flash(DeviceIdentity("TRUSTS-A-KEY", Wiring.strips(), (KEY.public_key(),)), sign(IMAGE, KEY))
    with Emulator(flash=flash) as emulator:
        run = run_conformance(RunOptions(emulator.url, groups=("dfu", "flash")))
    check_sound(run)
    by_name = {result.case: result for result in run.results}
    assert by_name["flash/keys-decide-whose-images-are-taken"].verdict is Verdict.PASS
    assert {result.reason for result in run.results if result.verdict is not Verdict.PASS} == {
        "the firmware is signed, so that only its maker can make it longer",
        "the firmware is signed, so that only its maker can give it another version",
        "the first segment of the firmware has no padding after it",
    }


# Real lines, by the clock on the wall

SOME = (
    "acknowledgements",
    "numbering",
    "outputs",
    "states",
    "flow",
    "serial/a-host",
    "serial/one",
    "console/what-is-t",
)
NO_BREAK = Profile(
    name="a pseudo-terminal",
    not_applicable={"serial/a-host-that-hangs-up-leaves-a-console": "the server's own port cannot break"},
)


@pytest.mark.slow
# By pyserial's client of RFC 2217.
@pytest.mark.filterwarnings("ignore:set(Daemon|Name)\\(\\) is deprecated:DeprecationWarning")
@pytest.mark.parametrize("scheme", ["serial", "rfc2217", "usbip"])
def test_no_case_speaks_against_the_emulator_at_the_end_of_a_line(scheme: str) -> None:
    with served_url(scheme) as (url, _):
        profile = NO_BREAK if scheme == "rfc2217" else Profile()
        groups = tuple({name.partition("/")[0]: None for name in SOME})
        run = run_conformance(RunOptions(url, only=SOME, groups=groups, profile=profile))
    check_sound(run)
    assert run.count(Verdict.PASS) > 100


CONFORMANCE = """
import sys, usb.backend.libusb1, libusb_package
from phasewire.__main__ import main
# The libusb of the system: that of libusb-package does not hear under umockdev that a device has come back.
libusb_package.get_libusb1_backend = usb.backend.libusb1.get_backend
main(["conformance", "--device", "usb:", *sys.argv[1:]])
"""
ON_A_BUS = (
    "acknowledgements/",
    "endpoints/",
    "requests/",
    "enumeration/",
    "dfu/a-device-waits",
    "dfu/blocks-out-of-turn",
)
"""Cases that need the bus; of DFU only some, because the flash takes its time by the wall clock."""
NO_LEVERS = {
    *map(unmet, Need),
    "the line was too slow: the device was asked N.N s after it had block N",
    "this line is too slow: the watchdog may have fired before the request arrived",
    "this computer's system does not send such a request",
    "the computer configures the device by itself before a program can reset it",
    PARTS,
    *OF_A_BUS,
}


@needs()
@pytest.mark.slow
def test_no_case_speaks_against_the_emulator_on_the_bus_of_a_kernel(tmp_path: Path) -> None:
    (tmp_path / "conformance.py").write_text(CONFORMANCE)
    options = [f"--json={tmp_path / 'run.json'}", *(f"--only={cases}" for cases in ON_A_BUS)]
    options += [f"--allow={risk}" for risk in Risk]
    command = [sys.executable, str(tmp_path / "conformance.py"), *options]
    flash = make_flash(DeviceIdentity("ON-A-BUS", Wiring.strips()), IMAGE)
    with (tmp_path / "output").open("wb") as output:
        bounded = ["timeout", "--signal=KILL", "300", *command]
        code = run_under_mock(bounded, [Emulator(flash=flash)], stdout=output, stderr=output)
    assert code == 0, (tmp_path / "output").read_text()
    results = json.loads((tmp_path / "run.json").read_text())["results"]
    verdicts = {result["verdict"] for result in results}
    assert verdicts <= {"pass", "inconclusive", "not applicable"}
    assert alike(result["reason"] for result in results if result["verdict"] == "inconclusive") <= NO_LEVERS
    assert {result["case"].partition("/")[0] for result in results if result["verdict"] == "pass"} == {
        cases.partition("/")[0] for cases in ON_A_BUS
    }


# Ctrl-C

LONG = "sequences/the-entry-that-plays-is-read-back"
"""A case that takes seconds, out of the watchdog's reach."""


@pytest.mark.slow
def test_ctrl_c_ends_a_run_and_leaves_the_device_off_and_all_reports(tmp_path: Path) -> None:
    reports = [f"--json={tmp_path / 'run.json'}", f"--html={tmp_path / 'run.html'}", f"--junit={tmp_path / 'run.xml'}"]
    with served_url("serial") as (url, emulator):
        command = [sys.executable, "-m", "phasewire", "conformance", "--device", url, "--only", LONG, *reports]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
            await_playing(emulator)
            process.send_signal(signal.SIGINT)
            told, _ = process.communicate(timeout=60)
        status = controller_of(emulator).status()
    assert process.returncode == 130, told
    assert "Traceback" not in told
    assert (status.state, status.watchdog_fired) == (State.OFF, False)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run.html", "run.json", "run.xml"]


def controller_of(emulator: Emulator) -> Controller:
    assert emulator.controller is not None
    return emulator.controller


def await_playing(emulator: Emulator) -> None:
    end = time.monotonic() + 60
    while controller_of(emulator).status().state is not State.PLAYING:
        assert time.monotonic() < end
        time.sleep(0.01)
