"""Running the suite: a bench is opened, pytest runs the cases, and what came of them becomes a `Run`."""

from __future__ import annotations

import hashlib
import os
import signal
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import version
from itertools import count
from pathlib import Path
from time import monotonic, perf_counter, sleep
from typing import TYPE_CHECKING

import pytest

from ...emulator import Emulator
from ...emulator.doors.address import Address
from ...emulator.firmware.flash import Flash
from ...emulator.firmware.loader import Identity, make_flash
from ...emulator.machine import plugged
from ...errors import DeviceNotFoundError, InputFileError
from ...protocol.codes import PROTOCOL_VERSION, Target
from ...protocol.firmware import Image, Segment, sign
from ...protocol.versions import Version
from ...protocol.wiring import Wiring
from ...signals import SIGNALLED
from .bench import Bench
from .cases import Risk
from .levers import EmulatorLevers, Levers, NoLevers
from .lines.line import RawLine
from .lines.serial import PortWire, SerialLine
from .lines.usb import UsbLine
from .plugin import Catalogue, Entry, Judge, Watcher
from .profile import Profile
from .sight.capture import EmulatorSight, Sight
from .sight.sigrok import SessionFile, SigrokSight
from .tools.clocks import load_average
from .verdicts import Provenance, Run, signal_name

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

__all__ = ["Options", "catalogue", "open_bench", "run_conformance"]

GROUPS = Path(__file__).with_name("groups")
EMULATOR, SIGROK = "emulator", "sigrok:"
RECORDING_SECONDS = 600.0
LOOK_SECONDS = 0.5
SEED = 1
_serials = count(1)


@dataclass(frozen=True)
class Options:
    """What is asked of a run.

    Parameters
    ----------
    url : str
        Of the device, as the host finds it.
    capture : str or None
        ``emulator``, ``sigrok:FILE`` or ``none``; None for the best that there is without a file.
    allowed : frozenset of Risk or None
        What may be risked; None for nothing, but for everything where the device is emulated in this process.
    profile : Profile
    known : mapping of str to str
        Cases that are known to fail, and why.
    only : tuple of str
        Groups, cases, clauses or chapters, or how they begin; all where it is empty.
    seed : int
        Of everything random.
    enough : int or None
        The run ends after so many cases that break it; None for all of it.
    again : bool
        Whether a case that failed is run once more, which tells a device that fails now and then from one that always
        does; it breaks the run either way.
    """

    url: str
    capture: str | None = None
    allowed: frozenset[Risk] | None = None
    profile: Profile = field(default_factory=Profile)
    known: Mapping[str, str] = field(default_factory=dict)
    only: tuple[str, ...] = ()
    seed: int = SEED
    enough: int | None = None
    again: bool = True


def catalogue() -> list[Entry]:
    """All cases, in their order.

    Raises
    ------
    RuntimeError
        Where one cannot be collected.
    """
    found = Catalogue()
    _pytest(found, "--collect-only")
    if found.trouble:
        raise RuntimeError("; ".join(found.trouble))
    return found.entries


def run_conformance(
    options: Options, watcher: Watcher | None = None, judged: Callable[[], object] = lambda: None
) -> Run:
    """Run the suite against a device.

    Parameters
    ----------
    options : Options
    watcher : Watcher, optional
        Is told how it goes on.
    judged : callable, optional
        Is called when all is judged, or a signal has ended that: what is left to do is short.

    Returns
    -------
    Run
        Also if Ctrl-C or another signal ended it, once the device was found: with what had been judged by then.

    Raises
    ------
    DeviceError
        Where the device cannot be opened or does not say what it is.
    """
    began, started, load = datetime.now(UTC), perf_counter(), load_average()
    with open_bench(options) as bench:
        judge = Judge(
            bench, options.profile, options.known, options.only, options.enough, watcher or Watcher(), options.again
        )
        try:
            _pytest(judge)
            if judge.interruption is None and judge.awaits_recording and isinstance(bench.sight, SigrokSight):
                _await_recording(bench.sight.path, began.timestamp(), judge.watcher)
                judge.look()
        except (KeyboardInterrupt, SystemExit) as error:
            judge.interruption = error
        judged()
        number = 0 if judge.interruption is None else _signal(judge.interruption)
        judge.finish(signal_name(number) if number else "")
        provenance = Provenance(
            version("phasewire"),
            f"version {PROTOCOL_VERSION}, SPEC.md {_specification_digest()}",
            _about(options.url, bench),
            began.isoformat(timespec="seconds"),
            perf_counter() - started,
            options.profile.name,
            bench.sight.name if bench.sight else "none",
            tuple(sorted(bench.allowed)),
            options.seed,
            os.cpu_count() or 1,
            None if load is None else (round(load, 2), round(load_average() or 0.0, 2)),
        )
    return Run(provenance, tuple(judge.results), tuple(judge.trouble), judge.claims, number)


def _signal(interruption: BaseException) -> int:
    """The number of the signal that an exception stands for; any other exception is raised."""
    match interruption:
        case KeyboardInterrupt():
            return signal.SIGINT
        case SystemExit(code=int(code)) if code > SIGNALLED:
            return code - SIGNALLED
    raise interruption


def _pytest(plugin: Catalogue | Judge, *arguments: str) -> None:
    """Let pytest run the cases with one plugin and nothing from the surroundings."""
    plain = ["--assert=plain"]  # cases say in words what is wrong
    quiet = ["-p", "no:terminal", "-p", "no:cacheprovider", "-p", "no:faulthandler", "-p", "no:logging", "--capture=no"]
    alone = ["--import-mode=importlib", f"--rootdir={GROUPS}", f"--confcutdir={GROUPS}", "-c", os.devnull]
    with _environment(PYTEST_DISABLE_PLUGIN_AUTOLOAD="1", PYTEST_ADDOPTS=""):
        code = pytest.main([*quiet, *plain, *alone, *arguments, str(GROUPS)], plugins=[plugin])
    if code == pytest.ExitCode.USAGE_ERROR:
        plugin.trouble.append(f"pytest {pytest.__version__} could not begin; standard error says why")


@contextmanager
def _environment(**variables: str) -> Iterator[None]:
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _specification_digest() -> str:
    text = Path(__file__).parents[2] / "protocol" / "SPEC.md"
    return hashlib.sha256(text.read_bytes()).hexdigest()[:16]


def _about(url: str, bench: Bench) -> dict[str, str]:
    info = bench.info
    return {
        "url": url,
        "name": bench.line.name,
        "unique id": info.unique_id.hex(),
        "firmware": ".".join(map(str, info.firmware)),
        "protocol": f"{info.oldest_version} to {info.newest_version}",
        "hardware": str(int(info.hardware)),
        "features": info.features.name or "none",
        "links": f"{info.link_wires} wires, {info.cycles_per_symbol} cycles a symbol",
    }


@contextmanager
def open_bench(options: Options, key: Ed25519PrivateKey | None = None) -> Iterator[Bench]:
    """The bench for a URL: a device emulated in this process with all its levers and outputs, or any other as it is.

    Parameters
    ----------
    options : Options
    key : Ed25519PrivateKey, optional
        Which a fresh emulated device trusts, and which has signed its firmware; without it the device has no keys.

    Raises
    ------
    DeviceError
        Where the device cannot be opened.
    InputFileError
        Where a recording cannot be used.
    ValueError
        Where the outputs of a device that is not emulated here are to be seen by the emulator.
    """
    with ExitStack() as stack:
        path = _recording(options.capture)
        emulator, url = _emulated(options.url, key, stack)
        levers: Levers = NoLevers() if emulator is None else EmulatorLevers(emulator)
        sight = _sight(options, emulator)
        line = _line(url)
        stack.callback(line.close)
        allowed = options.allowed
        if allowed is None:
            allowed = frozenset() if emulator is None else frozenset(Risk)
        spare = None if emulator is None else partial(open_bench, replace(options, url=_fresh(options.url)))
        bench = Bench(line, levers, sight, allowed, options.seed, profile=options.profile, spare=spare)
        if path is not None:
            bench.sight = SigrokSight(path, options.profile.channels(bench.wiring), bench.marks)
        stack.callback(bench.leave_off)
        yield bench


def _fresh(url: str) -> str:
    """The URL of a fresh emulated device that is reached in the same way."""
    scheme, _, rest = url.partition(":")
    return f"{scheme}:?{rest.partition('?')[2]}".removesuffix("?")


def _emulated(url: str, key: Ed25519PrivateKey | None, stack: ExitStack) -> tuple[Emulator | None, str]:
    """The emulated device that a URL means, plugged in, and the URL by which the host finds it."""
    scheme, _, rest = url.partition(":")
    if scheme != EMULATOR:
        return None, url
    address = Address.parse(url)
    if address.serial:
        there = {emulator.serial: emulator for emulator in plugged()}
        if address.serial not in there:
            raise DeviceNotFoundError(f"no device at {url!r}: nothing of this serial number is plugged in")
        return there[address.serial], url
    emulator = stack.enter_context(address.make(_flash(key)))
    options = [option for option in rest.removeprefix("?").split("&") if option.startswith(("door=", "baud="))]
    return emulator, emulator.url + ("?" + "&".join(options) if options else "")


def _flash(key: Ed25519PrivateKey | None) -> Flash:
    """Of a device whose firmware is as large as real firmware is in blocks and sectors, though nothing executes it."""
    segments = (Segment(Target.ALL_PROCESSORS, bytes(range(1, 256)) * 21), Segment(Target.CONTROLLER, bytes(6000)))
    image = Image(Version(1, 0, 0), segments)
    keys = () if key is None else (key.public_key(),)
    identity = Identity(f"CONFORMANCE-{next(_serials)}", Wiring.strips(), keys)
    return make_flash(identity, image if key is None else sign(image, key))


def _line(url: str) -> RawLine:
    scheme = url.partition(":")[0]
    if scheme == "usb" or (scheme == EMULATOR and "door=serial" not in url):
        return UsbLine(url)
    line = SerialLine(PortWire(url))
    line.enter_frames()
    return line


def _sight(options: Options, emulator: Emulator | None) -> Sight | None:
    """What sees the outputs, but for a recording, for which the device's wiring must be known first."""
    choice = options.capture if options.capture is not None else ("none" if emulator is None else EMULATOR)
    if choice != EMULATOR:
        return None
    if emulator is None:
        raise ValueError(
            f"--capture emulator: {options.url!r} is not emulated in this process; sigrok:FILE or none would do"
        )
    return EmulatorSight(emulator)


def _recording(capture: str | None) -> Path | None:
    """The recording by which the outputs are to be seen, if it is one."""
    if capture is None or not capture.startswith(SIGROK):
        return None
    path = Path(capture.removeprefix(SIGROK))
    if path.is_dir():
        raise ValueError(f"--capture {capture}: {path} is a folder; the file where the recording will be would do")
    return path


def _await_recording(path: Path, since: float, watcher: Watcher) -> None:
    """Wait until a recording of this run is there; Ctrl-C and ten minutes end that.

    Parameters
    ----------
    path : path
        Where it will be saved.
    since : float
        When the run began, in seconds since the epoch: what is older is no recording of it.
    watcher : Watcher
        Is told what to do.
    """
    end = monotonic() + RECORDING_SECONDS
    with suppress(KeyboardInterrupt):
        if not _is_saved(path, since):
            watcher.waits(f"end the recording and save it as {path}; Ctrl-C goes on without it")
        while not _is_saved(path, since) and monotonic() < end:
            sleep(LOOK_SECONDS)


def _is_saved(path: Path, since: float) -> bool:
    try:
        if path.stat().st_mtime < since:
            return False
        SessionFile.open(path)
    except (OSError, InputFileError):
        return False
    return True
