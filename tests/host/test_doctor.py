"""The doctor: each thing that can be wrong, brought about, and what it finds and says."""

from __future__ import annotations

import dataclasses
import errno
import itertools
import re
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import usb.core
from phasewire import Emulator, open_device
from phasewire.base.errors import DeviceLostError, DeviceTimeoutError
from phasewire.emulator import faults
from phasewire.emulator.doors.backend import EmulatorBackend
from phasewire.emulator.doors.station import Pace
from phasewire.emulator.faults import InjectedFault
from phasewire.host.finding import device_checks
from phasewire.host.finding.computer_checks import BUS_CHECKS, COMPUTER_CHECKS, Computer, udev_rule
from phasewire.host.finding.discovery import Search
from phasewire.host.finding.doctor import CHECKS, examine
from phasewire.host.finding.findings import CheckVerdict, Finding
from phasewire.host.streaming.device import Device
from phasewire.host.transports.transport import Found
from phasewire.protocol.codes import Fault, Feature
from phasewire.protocol.enumeration import FULL_SPEED
from phasewire.protocol.replies import ClockReading, Info, ProcessorReport, ReadBack, Status

from tests.host.buses import raising
from tests.host.serving import Served

OK, WARN, FAIL, SKIPPED = CheckVerdict.OK, CheckVerdict.WARN, CheckVerdict.FAIL, CheckVerdict.SKIPPED
GUIDE = Path(__file__).parents[2] / "docs" / "how-to/first-connection.md"


def found_by(url: str, **options: Any) -> dict[str, Finding]:
    findings = list(examine(url, **options))
    assert tuple(finding.name for finding in findings) == CHECKS
    return {finding.name: finding for finding in findings}


def bad(findings: dict[str, Finding]) -> dict[str, CheckVerdict]:
    """Findings about the device or its line; those about the computer that runs this test are left out."""
    return {
        name: finding.verdict
        for name, finding in findings.items()
        if finding.verdict in (WARN, FAIL) and name not in COMPUTER_CHECKS
    }


def is_off(emulator: Emulator) -> bool:
    return emulator.running.state.name in ("OFF", "FAULT")


# A device that is well


def test_a_device_that_is_well_passes_every_check(emulator: Emulator) -> None:
    findings = found_by(emulator.url)
    assert bad(findings) == {}
    assert not [finding for finding in findings.values() if finding.verdict is FAIL]
    assert findings["transducers"].verdict is SKIPPED
    assert "--play" in findings["transducers"].seen
    assert is_off(emulator)


def drives_by_latch(emulator: Emulator) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Magnitudes of all drives that began to play, in the order of time, (k, 320)."""
    captured = emulator.capture()
    periods = sorted({tick // 50 for ticks in captured.latches for tick in ticks})
    return np.array([abs(captured.drive(period)) for period in periods])


def test_the_self_test_makes_no_sound(emulator: Emulator) -> None:
    found_by(emulator.url)
    drives = drives_by_latch(emulator)
    patterns, silenced = 2 + device_checks.TRIED_BLOCKS, 2  # of self-test and of blocks
    assert len(drives) == patterns + silenced  # they did reach the processors
    assert drives.max() == 0


def heard(emulator: Emulator) -> tuple[list[int], float]:
    """The transducers that played, each alone, in the order of time, and the greatest strength."""
    drives = drives_by_latch(emulator)
    sounding = drives > 1e-6
    assert sounding.sum(axis=1).max() == 1
    order = np.argmax(sounding[sounding.any(axis=1)], axis=1)
    return list(dict.fromkeys(order.tolist())), float(drives.max())


def test_one_transducer_alone_plays_softly(emulator: Emulator, monkeypatch: pytest.MonkeyPatch) -> None:
    """CON-008's width 2: sin(2π/50) of the full amplitude (PUL-003)."""
    monkeypatch.setattr(device_checks, "range", lambda channels: [300, 17, 0], raising=False)
    assert found_by(emulator.url, play=True)["transducers"].verdict is OK
    order, loudest = heard(emulator)
    assert order == [300, 17, 0]
    assert loudest == pytest.approx(np.sin(2 * np.pi / 50), rel=1e-3)
    assert is_off(emulator)
    assert emulator.running.status().drive_limit == 320


@pytest.mark.slow
def test_with_play_every_transducer_plays_alone(emulator: Emulator) -> None:
    assert found_by(emulator.url, play=True)["transducers"].verdict is OK
    assert heard(emulator)[0] == list(range(320))


# What can go wrong with it, and what is found

SEEN: dict[str, tuple[InjectedFault, dict[str, tuple[CheckVerdict, str]]]] = {
    "a slice loses a token": (
        faults.LostToken(message="slice", processor=3),
        {
            "self-test": (FAIL, "32 pulses came back wrong, from board 1 processor 1"),
            "chain": (WARN, "board 1 processor 1: 1 missed commits and 1 damaged messages"),
            "faults": (WARN, r"CHAIN \(board 1 processor 1\)"),
        },
    ),
    "a commit has a token twice": (
        faults.DoubledToken(message="commit", processor=4),
        {
            "self-test": (FAIL, "32 pulses came back wrong, from board 2 processor 0"),
            "chain": (WARN, "board 2 processor 0: 1 damaged messages"),
            "faults": (WARN, r"CHAIN \(board 2 processor 0\)"),
        },
    ),
    "a link is so slow that it is broken": (
        faults.SlowLink(link=2, cycles_per_symbol=2000),
        {
            "self-test": (FAIL, r"turned its outputs off \(FAULT\)"),
            "chain": (FAIL, "a processor was lost"),
            "faults": (FAIL, "PROCESSOR"),
        },
    ),
    "a processor dies": (
        faults.DeadProcessor(processor=5),
        {"chain": (FAIL, "a processor was lost while the device ran"), "faults": (FAIL, "PROCESSOR")},
    ),
    "a board's clock is off": (
        faults.ClockError(board=1, ppm=100),
        {"faults": (FAIL, r"SYNC \(board 1\): a board has lost the common clock")},
    ),
    "the sync line is cut": (faults.LostSync(), {"faults": (FAIL, r"SYNC \(all boards\)")}),
    "the sync line is cut at a board": (faults.LostSync(board=2), {"faults": (FAIL, r"SYNC \(board 2\)")}),
    "a board is warm": (faults.HotBoard(board=2, celsius=82), {"temperature": (WARN, "82 °C at most on board 2")}),
    "a board is too hot": (
        faults.HotBoard(board=3, celsius=90),
        {"temperature": (FAIL, "90 °C at most on board 3"), "faults": (FAIL, r"TEMPERATURE \(board 3\)")},
    ),
    "a supply is too low": (faults.WrongSupply(millivolts=9000, board=4), {"faults": (FAIL, r"SUPPLY \(board 4\)")}),
    "a processor is slow": (
        faults.SlowProcessor(processor=6, slowness=30),
        {
            "self-test": (FAIL, "from board 3 processor 0"),
            "chain": (WARN, "board 3 processor 0: 2 missed commits"),
            "faults": (WARN, r"OVERRUN \(board 3 processor 0\)"),
        },
    ),
    "every block arrives damaged": (
        faults.FlippedUsbBit(endpoint=1, byte=100, times=1000),
        {"open": (FAIL, "did not receive a block")},
    ),
    "records arrive damaged": (
        faults.FlippedUsbBit(endpoint=129, byte=5, times=1000),
        {"open": (FAIL, "breaks the protocol")},
    ),
    "the bus sleeps": (faults.BusSuspended(), {"access": (FAIL, "it does not answer")}),
    "nothing arrives": (faults.SilentHost(), {"access": (FAIL, "it does not answer")}),
    "the cable is out": (faults.Unplugged(), {"device": (FAIL, "nothing is plugged in")}),
    "there is no power": (faults.PowerCut(), {"device": (FAIL, "nothing is plugged in")}),
}


@pytest.mark.parametrize(("fault", "expected"), SEEN.values(), ids=SEEN)
def test_a_fault_is_found(fault: InjectedFault, expected: dict[str, tuple[CheckVerdict, str]]) -> None:
    with Emulator(serial="ILL") as emulator:
        emulator.inject(fault)
        if emulator.powered:
            emulator.run(1000)
        findings = found_by(emulator.url)
        assert not emulator.powered or is_off(emulator)
    assert bad(findings) == {name: verdict for name, (verdict, _) in expected.items()}
    for name, (_, seen) in expected.items():
        assert re.search(seen, findings[name].seen), findings[name]
    assert [finding for finding in findings.values() if finding.verdict in (WARN, FAIL) and not finding.advice] == []


@pytest.mark.parametrize(("when", "verdict"), [("before", OK), ("meanwhile", WARN)])
def test_only_what_is_damaged_now_speaks_against_the_cable(
    emulator: Emulator, monkeypatch: pytest.MonkeyPatch, when: str, verdict: CheckVerdict
) -> None:
    """Counters last since power-up, and another program may have left them so."""
    genuine = device_checks.QUIET_CHECKS["blocks"]

    def damaging(device: Device) -> Any:
        emulator.inject(faults.FlippedUsbBit(endpoint=1, byte=100))
        return genuine(device)

    if when == "before":
        emulator.inject(faults.FlippedUsbBit(endpoint=1, byte=100))
    else:
        monkeypatch.setitem(device_checks.QUIET_CHECKS, "blocks", damaging)
    finding = found_by(emulator.url)["blocks"]
    assert finding.verdict is verdict
    assert ("1 refused" in finding.seen) == (when == "before")
    assert ("another cable" in finding.advice) == (when == "meanwhile")


@pytest.mark.parametrize(
    ("fault", "missing"),
    [
        (
            faults.DeadProcessor(processor=5),
            "5 of 10 processors answer; missing: board 2 processor 1, board 3, board 4",
        ),
        (faults.DeadBoard(board=0), "0 of 10 processors answer; missing: all boards"),
    ],
)
def test_after_a_start_a_dead_processor_is_named(emulator: Emulator, fault: InjectedFault, missing: str) -> None:
    emulator.inject(fault)
    emulator.restart()
    emulator.run_until_started()
    findings = found_by(emulator.url)
    assert (findings["chain"].verdict, findings["chain"].seen) == (FAIL, missing)
    assert findings["self-test"].verdict is SKIPPED
    assert "silenced by PROCESSOR" in findings["self-test"].seen


def patched(monkeypatch: pytest.MonkeyPatch, record: type, **values: Any) -> None:
    """Let a device say something else of itself."""
    genuine = record.encode  # type: ignore[attr-defined]  # each has it
    monkeypatch.setattr(record, "encode", lambda self: genuine(dataclasses.replace(self, **values)))


def test_firmware_that_could_not_be_loaded_is_found(emulator: Emulator, monkeypatch: pytest.MonkeyPatch) -> None:
    patched(monkeypatch, Status, faults=Fault.FLASH)
    findings = found_by(emulator.url)
    assert bad(findings) == {"firmware": WARN, "faults": WARN}
    assert findings["firmware"].seen == "0.1.0 from the bank FACTORY; a newer one could not be loaded"
    assert "phasewire flash" in findings["firmware"].advice


def test_without_a_common_version_the_older_side_is_named(emulator: Emulator, monkeypatch: pytest.MonkeyPatch) -> None:
    patched(monkeypatch, Info, oldest_version=2, newest_version=3)
    findings = found_by(emulator.url)
    assert bad(findings) == {"open": FAIL}
    assert "versions 2 to 3" in findings["open"].seen
    assert "phasewire, which is the older" in findings["open"].seen
    assert findings["protocol"].verdict is SKIPPED


def test_processors_with_different_firmware_are_found(emulator: Emulator, monkeypatch: pytest.MonkeyPatch) -> None:
    genuine = Device.processors

    def mixed(self: Device) -> list[ProcessorReport]:
        reports = genuine(self)
        reports[7] = dataclasses.replace(reports[7], firmware=(0, 0, 9))
        return reports

    monkeypatch.setattr(Device, "processors", mixed)
    findings = found_by(emulator.url)
    assert bad(findings) == {"chain": FAIL}
    assert findings["chain"].seen == "not all run 0.1.0: board 3 processor 1"


def test_an_invalid_wiring_table_is_found(emulator: Emulator, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("phasewire.emulator.control.requests.encode_wiring", lambda wiring: bytes(640), raising=True)
    findings = found_by(emulator.url)
    assert findings["wiring"].verdict is FAIL
    assert "exactly once" in findings["wiring"].seen


@pytest.mark.parametrize(("ppm", "verdict"), [(50, OK), (500, WARN), (-500, WARN), (20_000, FAIL)])
def test_a_clock_that_is_off_is_found(
    emulator: Emulator, monkeypatch: pytest.MonkeyPatch, ppm: float, verdict: CheckVerdict
) -> None:
    genuine = ClockReading.encode

    def off(self: ClockReading) -> bytes:
        return genuine(dataclasses.replace(self, now=round(self.now * (1 + ppm * 1e-6))))

    monkeypatch.setattr(ClockReading, "encode", off)
    finding = found_by(emulator.url)["clock"]
    assert finding.verdict is verdict
    assert float(finding.seen.split()[0]) == pytest.approx(ppm, abs=150)


def test_a_device_that_is_held_up_once_has_no_oscillator_that_is_off(
    emulator: Emulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A busy computer answers for an emulated device with times that it had 20 ms ago."""
    genuine, readings = ClockReading.encode, itertools.count()
    held_up = range(device_checks.CLOCK_READINGS, 2 * device_checks.CLOCK_READINGS)

    def late(self: ClockReading) -> bytes:
        return genuine(dataclasses.replace(self, now=self.now - (40_000 if next(readings) in held_up else 0)))

    monkeypatch.setattr(ClockReading, "encode", late)
    assert found_by(emulator.url)["clock"].verdict is OK
    assert next(readings) > held_up.stop


@pytest.mark.slow
def test_an_oscillator_is_not_blamed_for_time_that_is_computed() -> None:
    """At the pace fast a device's time passes only during requests."""
    with Served(pty=True, pace=Pace.FAST) as served:
        findings = found_by(f"serial://{served.where}?baud=3000000")
    assert (findings["clock"].verdict, findings["clock"].advice) == (SKIPPED, "")
    assert "emulated device at the pace fast" in findings["clock"].seen
    assert not [verdict for verdict in bad(findings).values() if verdict is FAIL]


def test_a_computer_that_is_held_up_is_not_the_device(emulator: Emulator, monkeypatch: pytest.MonkeyPatch) -> None:
    """A program that is silent for longer than the watchdog's time finds its outputs off."""
    read_back, show = Device.read_back, Device.show
    monkeypatch.setattr(Device, "show", after_seconds(3.0, show))
    findings = found_by(emulator.url)
    for name in ("self-test", "blocks"):
        assert (findings[name].verdict, findings[name].advice) == (WARN, device_checks.HELD_UP)
    monkeypatch.setattr(Device, "show", after_seconds(0.3, show))
    monkeypatch.setattr(Device, "read_back", after_seconds(0.3, read_back))
    assert bad(found_by(emulator.url)) == {}
    assert emulator.running.status().watchdog_ms == 100


def after_seconds(seconds: float, method: Callable[..., Any]) -> Callable[..., Any]:
    def late(self: Device, *arguments: Any) -> Any:
        self.time.sleep(seconds)
        return method(self, *arguments)

    return late


def test_a_sync_line_without_pulses_is_found(emulator: Emulator, monkeypatch: pytest.MonkeyPatch) -> None:
    patched(monkeypatch, ClockReading, sync_pulses=7)
    finding = found_by(emulator.url)["clock"]
    assert finding.verdict is FAIL
    assert "no pulses on the sync line" in finding.seen


def test_a_device_that_cannot_be_read_back_is_tried_all_the_same(
    emulator: Emulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    patched(monkeypatch, Info, features=Feature(63) & ~Feature.READ_BACK)
    findings = found_by(emulator.url)
    assert bad(findings) == {}
    assert findings["self-test"].seen.endswith("cannot be read back")


def test_processors_that_differ_in_the_period_are_found(emulator: Emulator, monkeypatch: pytest.MonkeyPatch) -> None:
    """REQ-007."""
    patched(monkeypatch, ReadBack, since_period=2**64 - 1)
    findings = found_by(emulator.url)
    assert bad(findings) == {"self-test": FAIL}
    assert findings["self-test"].seen == "the processors did not begin a pattern together"


def test_pulses_that_come_back_wrong_are_found(emulator: Emulator, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(device_checks, "_plays_alone", lambda device, transducer: transducer not in (17, 230))
    findings = found_by(emulator.url, play=True)
    assert findings["transducers"].seen == "2 did not play their pulse: 17, 230"
    assert findings["transducers"].verdict is FAIL


def test_a_device_that_goes_away_ends_the_examination(emulator: Emulator, monkeypatch: pytest.MonkeyPatch) -> None:
    def unplugging(device: Device) -> Any:
        emulator.usb.unplug()
        return genuine(device)

    genuine = device_checks.QUIET_CHECKS["wiring"]
    monkeypatch.setitem(device_checks.QUIET_CHECKS, "wiring", unplugging)
    findings = found_by(emulator.url)
    assert bad(findings) == {"wiring": FAIL}
    after = CHECKS[CHECKS.index("wiring") + 1 :]
    assert {(findings[name].verdict, findings[name].seen) for name in after} == {(SKIPPED, "the device is gone")}


@pytest.mark.parametrize("error", [KeyboardInterrupt, DeviceLostError])
def test_however_it_ends_the_outputs_are_off(
    emulator: Emulator, monkeypatch: pytest.MonkeyPatch, error: type[BaseException]
) -> None:
    monkeypatch.setattr(Device, "read_back", raising(error("in the middle of a pattern")))
    if error is KeyboardInterrupt:
        with pytest.raises(KeyboardInterrupt):
            found_by(emulator.url)
    else:
        found_by(emulator.url)
    assert is_off(emulator)


@pytest.mark.parametrize("door", ["usb", "serial"])
@pytest.mark.parametrize("error", [None, DeviceTimeoutError, KeyboardInterrupt])
def test_settings_are_as_they_were_found_however_it_ends(
    emulator: Emulator, monkeypatch: pytest.MonkeyPatch, error: type[BaseException] | None, door: str
) -> None:
    """A slow line needs a longer watchdog time as soon as it is opened."""
    monkeypatch.setattr(device_checks, "range", lambda channels: [7], raising=False)
    with open_device(emulator.url) as device:
        device.set_watchdog(0.05)
        device.set_drive_limit(10)
    if error is not None:
        monkeypatch.setattr(device_checks, "_silence", raising(error("no answer")))
    with pytest.raises(KeyboardInterrupt) if error is KeyboardInterrupt else nullcontext():
        findings = found_by(f"{emulator.url}?door={door}", play=True)
        assert findings["settings"].seen.startswith("watchdog 50 ms, drive limit 10 transducers")
        assert findings["transducers"].verdict is (OK if error is None else FAIL)
        assert ("switch it off and on" in findings["transducers"].advice) == (error is not None)
    status = emulator.running.status()
    assert (status.watchdog_ms, status.drive_limit) == (50, 10)
    assert is_off(emulator)


# The way to it


def test_without_permission_it_says_how_to_get_it(emulator: Emulator, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setattr(EmulatorBackend, "ctrl_transfer", raising(usb.core.USBError("denied", None, errno.EACCES)))
    findings = found_by(emulator.url)
    assert bad(findings) == {"access": FAIL}
    assert findings["access"].seen == "permission denied"
    assert "phasewire doctor --udev-rule | sudo tee /etc/udev/rules.d/60-phasewire.rules" in findings["access"].advice
    assert (findings["open"].verdict, findings["open"].seen) == (SKIPPED, "see access")


def test_a_device_that_is_open_elsewhere_is_found(emulator: Emulator) -> None:
    from phasewire import open_device

    with open_device(emulator.url):
        findings = found_by(emulator.url)
    assert bad(findings) == {"open": FAIL}
    assert "another program is using the device" in findings["open"].seen


@pytest.mark.parametrize(
    ("held", "verdict", "seen"),
    [
        ({0}, FAIL, "holds interface 0"),
        ({1, 2}, OK, "serial driver has the console"),
        (set(), OK, "interface 0 is free"),
        (NotImplementedError(), SKIPPED, "does not tell"),
        (usb.core.USBError("no"), SKIPPED, "cannot be asked: no"),
    ],
)
def test_drivers_of_the_system(
    emulator: Emulator,
    monkeypatch: pytest.MonkeyPatch,
    held: set[int] | Exception,
    verdict: CheckVerdict,
    seen: str,
) -> None:
    def active(self: EmulatorBackend, handle: object, interface: int) -> bool:
        if isinstance(held, Exception):
            raise held
        return interface in held

    monkeypatch.setattr(EmulatorBackend, "is_kernel_driver_active", active)
    finding = found_by(emulator.url)["driver"]
    assert finding.verdict is verdict
    assert seen in finding.seen


def test_a_serial_port_without_permission_has_a_group(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the message says that the doctor knows more, he does."""
    error = PermissionError(errno.EACCES, "Permission denied")
    monkeypatch.setattr("serial.Serial.open", raising(error))
    finding = found_by("serial:///dev/ttyS0")["open"]
    assert finding.verdict is FAIL
    assert "lack permission" in finding.seen
    assert "doctor" not in finding.seen
    assert "usermod -aG dialout" in finding.advice


def test_full_speed_is_found() -> None:
    """USB-010: 2 375 blocks a second."""
    with Emulator(serial="SLOW", speed=FULL_SPEED) as emulator:
        findings = found_by(emulator.url)
    assert bad(findings) == {"cable": WARN}
    assert findings["cable"].seen.endswith("at most 2375 blocks a second")


@pytest.mark.parametrize(
    ("problem", "verdict", "seen"), [(None, OK, "/dev/ttyACM7"), ("permission denied", WARN, "permission denied")]
)
def test_the_console_s_port_is_named(
    emulator: Emulator, monkeypatch: pytest.MonkeyPatch, problem: str | None, verdict: CheckVerdict, seen: str
) -> None:
    port = Found("serial:///dev/ttyACM7", "array", emulator.serial, "run time", "", "/dev/ttyACM7", problem)
    monkeypatch.setattr("phasewire.host.finding.computer_checks.search", lambda schemes=None: Search([port], {}))
    finding = found_by(emulator.url)["console"]
    assert finding.verdict is verdict
    assert seen in finding.seen


@pytest.mark.parametrize(
    ("url", "remedy"),
    [
        ("emulator:NO-SUCH", "plug it in, with power; emulator: always works"),
        ("nonsense:", "plug it in, with power; emulator: always works"),
        ("usb:no-such-serial", "plug it in, with power; emulator: always works"),
        ("COM3", "for this serial port write serial:COM3"),
    ],
)
def test_without_a_device_the_computer_is_examined(url: str, remedy: str) -> None:
    findings = found_by(url)
    assert (findings["device"].verdict, findings["device"].advice) == (FAIL, remedy)
    after = CHECKS[CHECKS.index("device") + 1 :]
    assert {findings[name].verdict for name in after} == {SKIPPED}
    assert findings["python"].verdict is OK


# The computer


def computer(root: Path, *, system: str = "linux", superuser: bool = False, groups: tuple[str, ...] = ()) -> Computer:
    return Computer(system, root, superuser, frozenset(groups))


def installed(root: Path, text: str | None = None, folder: str = "etc/udev/rules.d") -> Path:
    path = root / folder / "60-phasewire.rules"
    path.parent.mkdir(parents=True)
    path.write_text(udev_rule() if text is None else text, encoding="utf-8")
    return root


def test_the_udev_rule_is_looked_for(tmp_path: Path) -> None:
    check = COMPUTER_CHECKS["udev rule"]
    assert check(computer(tmp_path, system="darwin")).verdict is SKIPPED
    assert check(computer(tmp_path)).verdict is WARN
    assert "phasewire doctor --udev-rule | sudo tee" in check(computer(tmp_path)).advice
    assert check(computer(tmp_path, superuser=True)).verdict is OK
    assert "need the group plugdev" in check(computer(installed(tmp_path / "a"))).seen
    assert check(computer(installed(tmp_path / "b"), groups=("plugdev",))).seen.endswith("gives access")
    assert check(computer(installed(tmp_path / "c", folder="usr/lib/udev/rules.d"))).verdict is OK
    assert check(computer(installed(tmp_path / "d", "an older one"))).verdict is WARN


def test_missing_libusb_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("libusb_package.get_libusb1_backend", lambda: None)
    findings = found_by("usb:")
    assert (findings["libusb"].verdict, findings["usb bus"].verdict) == (FAIL, SKIPPED)
    assert "pip install --force-reinstall libusb-package" in findings["libusb"].advice
    assert findings["transports"].verdict is WARN
    assert findings["device"].verdict is FAIL


@pytest.mark.parametrize(("emulators", "verdict"), [(0, WARN), (1, OK)])
def test_a_computer_without_any_usb_bus_is_a_container(
    monkeypatch: pytest.MonkeyPatch, emulators: int, verdict: CheckVerdict
) -> None:
    bus = EmulatorBackend([Emulator() for _ in range(emulators)])
    monkeypatch.setattr("phasewire.host.finding.computer_checks.open_backend", lambda url: bus)
    assert COMPUTER_CHECKS["usb bus"](Computer.this()).verdict is verdict


# The udev rule and the guide


def test_the_guide_tells_of_every_check() -> None:
    told = re.findall(r"^\| `([\w -]+)` \|", GUIDE.read_text(encoding="utf-8"), re.MULTILINE)
    assert tuple(told) == (*CHECKS, *(fault.name for fault in Fault))
    assert set(BUS_CHECKS) < set(told)
