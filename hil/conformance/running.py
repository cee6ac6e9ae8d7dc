"""Run the suite: open a bench, let pytest run the cases, and make a `Run` of the results."""

from __future__ import annotations

import hashlib
import os
import signal
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import version
from itertools import count
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

import pytest

from ...base.errors import DeviceNotFoundError
from ...base.plugins import entries
from ...base.signals import SIGNALLED
from ...emulator import Emulator
from ...emulator.doors.address import EmulatorUrl
from ...emulator.firmware.flash import Flash
from ...emulator.firmware.loader import DeviceIdentity, make_flash
from ...emulator.machine import FirmwareChoice, open_emulator
from ...host.transports.opening import SCHEMES, load_by_scheme
from ...host.transports.serial_line import PORTS
from ...host.transports.usb_find import BACKENDS
from ...protocol.codes import PROTOCOL_REVISION, PROTOCOL_VERSION, Target
from ...protocol.firmware import Image, Segment, sign
from ...protocol.versions import Version
from ...protocol.wiring import Wiring
from .bench import Bench
from .cases import Risk
from .levers import open_levers
from .options import RunOptions
from .plugin import PREFIX, Catalogue, CatalogueCase, Judge, Watcher
from .sight.opening import capture_of
from .tools.clocks import load_average
from .transports.line import RawLine
from .transports.serial import CdcWire, PortWire, RawSerialLine
from .transports.usb import RawUsbLine
from .verdicts import Provenance, Run, signal_name

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

__all__ = ["RunOptions", "catalogue", "open_bench", "run_conformance"]

GROUPS = Path(__file__).with_name("groups")
EMULATOR, NONE = "emulator", "none"
SPARES = "phasewire.spares"
"""Entry points by the scheme of a device's URL: functions that take the key which a device is to trust, or None, and
return the rest of the URL of a fresh one, for what breaks a device for good. Capture and levers have the same rest."""
_serials = count(1)


def catalogue() -> list[CatalogueCase]:
    """All cases, in their order; raises `RuntimeError` if one cannot be collected."""
    found = Catalogue()
    _pytest(found, "--collect-only")
    if found.trouble:
        raise RuntimeError("; ".join(found.trouble))
    return found.entries


def run_conformance(
    options: RunOptions, watcher: Watcher | None = None, judged: Callable[[], object] = lambda: None
) -> Run:
    """Run the suite against a device.

    Parameters
    ----------
    options : RunOptions
    watcher : Watcher, optional
        Receives the progress.
    judged : callable, optional
        Called when all is judged, or a signal has ended that: the rest is short.

    Returns
    -------
    Run
        Also if Ctrl-C or another signal ended it, once the device was found: with the results up to then.

    Raises
    ------
    DeviceError
        If the device cannot be opened or does not say what it is.
    """
    began, started, load = datetime.now(UTC), perf_counter(), load_average()
    with open_bench(options) as bench:
        judge = Judge(bench, options, watcher or Watcher())
        try:
            _pytest(judge, groups=options.groups)
            if judge.interruption is None and judge.awaits_recording and bench.observer is not None:
                bench.observer.finish(judge.watcher.waits)
                judge.look()
        except (KeyboardInterrupt, SystemExit) as error:
            judge.interruption = error
        judged()
        number = 0 if judge.interruption is None else _signal(judge.interruption)
        judge.finish(signal_name(number) if number else "")
        provenance = Provenance(
            version("phasewire"),
            f"version {PROTOCOL_VERSION}, revision {PROTOCOL_REVISION}, SPEC.md {_specification_digest()}",
            _about(options.url, bench),
            began.isoformat(timespec="seconds"),
            perf_counter() - started,
            options.profile.name,
            bench.observer.name if bench.observer else "none",
            options.levers or ((EMULATOR,) if bench.levers.can else ()),
            tuple(sorted(bench.allowed)),
            options.seed,
            os.cpu_count() or 1,
            None if load is None else (round(load, 2), round(load_average() or 0.0, 2)),
        )
    return Run(provenance, tuple(judge.results), tuple(judge.trouble), judge.claims, number)


def _signal(interruption: BaseException) -> int:
    """The number of the signal that an exception stands for; any other exception is raised again."""
    match interruption:
        case KeyboardInterrupt():
            return signal.SIGINT
        case SystemExit(code=int(code)) if code > SIGNALLED:
            return code - SIGNALLED
    raise interruption


def _pytest(plugin: Catalogue, *arguments: str, groups: Iterable[str] = ()) -> None:
    """Let pytest run the cases with one plugin, and without any configuration of the surroundings."""
    files = [GROUPS / f"{PREFIX}{group.replace('-', '_')}.py" for group in groups] or [GROUPS]
    plain = ["--assert=plain"]  # cases describe errors in words
    quiet = ["-p", "no:terminal", "-p", "no:cacheprovider", "-p", "no:faulthandler", "-p", "no:logging", "--capture=no"]
    alone = ["--import-mode=importlib", f"--rootdir={GROUPS}", f"--confcutdir={GROUPS}", "-c", os.devnull]
    with _environment(PYTEST_DISABLE_PLUGIN_AUTOLOAD="1", PYTEST_ADDOPTS=""):
        code = pytest.main([*quiet, *plain, *alone, *arguments, *map(str, files)], plugins=[plugin])
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
def open_bench(options: RunOptions, key: Ed25519PrivateKey | None = None) -> Iterator[Bench]:
    """The bench for a URL: a device with what is plugged in, which is all for one that is emulated in this process.

    Parameters
    ----------
    options : RunOptions
    key : Ed25519PrivateKey, optional
        The key that a fresh emulated device trusts and that signed its firmware; without it the device has no keys.

    Raises
    ------
    DeviceError
        If the device cannot be opened.
    ValueError
        If the levers or the capture are unknown, or are the emulator's and the device is not emulated here.
    """
    with ExitStack() as stack:
        emulator, url = _emulated(options.url, key, stack)
        own = None if emulator is None else f"{EMULATOR}:{emulator.serial}"
        (capture,) = _named((options.capture or (EMULATOR if own else NONE),), own, options)
        see = None if capture == NONE else capture_of(capture)
        levers = open_levers(_named(options.levers or ((EMULATOR,) if own else ()), own, options), stack)
        line = _line(url)
        stack.callback(line.close)
        allowed = options.allowed
        if allowed is None:
            allowed = frozenset() if emulator is None else frozenset(Risk)
        spare = _plugged_spare(options) if emulator is None else partial(open_bench, _for_a_spare(options))
        free_time = emulator is None or not emulator.executes
        other = () if own is None else (f"{own}?door=serial" if line.kind == "usb" else own,)
        bench = Bench(
            line,
            levers,
            None,
            allowed,
            options.seed,
            profile=options.profile,
            spare=spare,
            free_time=free_time,
            doors=_doors(options.doors or other, line),
        )
        if options.doors:
            bench.check_doors()
        if see is not None:
            probes = options.profile.channels(bench.wiring) if options.profile.probes else {}
            bench.observer = see(probes, bench.marks)
            stack.callback(bench.observer.close)
        stack.callback(bench.leave_off)
        yield bench


def _named(texts: Iterable[str], own: str | None, options: RunOptions) -> list[str]:
    """Texts of what is plugged in; the emulator's is that of the device itself."""
    texts = [text.removesuffix(":") if text == f"{EMULATOR}:" else text for text in texts]
    if own is None and EMULATOR in texts:
        raise ValueError(f"emulator: {options.url!r} is not emulated in this process, so that it has none of this")
    return [own if own and text == EMULATOR else text for text in texts]


def _plugged_spare(
    options: RunOptions,
) -> Callable[[Ed25519PrivateKey | None], AbstractContextManager[Bench]] | None:
    """The function that opens a fresh device, by the scheme's entry point in `SPARES`; None without one."""
    scheme = options.url.partition(":")[0]
    entry = entries(SPARES).get(scheme)
    if entry is None:
        return None
    make = entry.load()

    def spare(key: Ed25519PrivateKey | None) -> AbstractContextManager[Bench]:
        rest = make(key)
        url, levers, doors = (
            tuple(f"{text.partition(':')[0]}:{rest}" for text in texts)
            for texts in ((options.url,), options.levers, options.doors)
        )
        capture = NONE if options.capture in (None, NONE) else f"{options.capture.partition(':')[0]}:{rest}"
        return open_bench(replace(options, url=url[0], capture=capture, levers=levers, doors=doors))

    return spare


def _for_a_spare(options: RunOptions) -> RunOptions:
    """For a fresh emulated device beside the device: it has its own levers and what sees its outputs, or nothing."""
    capture = NONE if options.capture not in (None, EMULATOR) else options.capture
    return replace(options, url=_fresh(options.url), levers=(), capture=capture, doors=())


def _fresh(url: str) -> str:
    """The URL of a fresh emulated device that is reached in the same way."""
    scheme, _, rest = url.partition(":")
    return f"{scheme}:?{rest.partition('?')[2]}".removesuffix("?")


def _emulated(url: str, key: Ed25519PrivateKey | None, stack: ExitStack) -> tuple[Emulator | None, str]:
    """The emulated device that a URL means, plugged in, and the URL by which the host finds it."""
    scheme, _, rest = url.partition(":")
    if scheme != EMULATOR:
        return None, url
    address = EmulatorUrl.parse(url)
    if address.serial:
        named = open_emulator(address.serial)
        if named is None:
            raise DeviceNotFoundError(f"no device at {url!r}: nothing of this serial number is plugged in")
        return named, url
    emulator = stack.enter_context(address.make(_flash(key, address.image())))
    options = [option for option in rest.removeprefix("?").split("&") if option.startswith(("door=", "baud="))]
    return emulator, emulator.url + ("?" + "&".join(options) if options else "")


def _flash(key: Ed25519PrivateKey | None, firmware: Image | FirmwareChoice) -> Flash:
    """Parameters of a device with its firmware, or with as many blocks and sectors of firmware as a real one."""
    if firmware == "model":
        segments = (Segment(Target.ALL_PROCESSORS, bytes(range(1, 256)) * 21), Segment(Target.CONTROLLER, bytes(6000)))
        image = Image(Version(1, 0, 0), segments)
    elif firmware == "xs1":
        from ...firmware.xmos.images import device_image

        image = device_image()
    else:
        image = firmware
    keys = () if key is None else (key.public_key(),)
    identity = DeviceIdentity(f"CONFORMANCE-{next(_serials)}", Wiring.strips(), keys)
    return make_flash(identity, image if key is None else sign(image, key))


def _doors(urls: Iterable[str], own: RawLine) -> dict[str, Callable[[], AbstractContextManager[RawLine]]]:
    """Further lines by the names that they have at a bench whose own line is another."""
    doors: dict[str, Callable[[], AbstractContextManager[RawLine]]] = {}
    for url in urls:
        if _is_usb(url):
            found = {"usb": partial(_opened, url), "cdc": partial(_opened, url, console=True)}
        else:
            found = {"uart" if own.kind == "usb" else "cdc": partial(_opened, url)}
        if found.keys() & doors.keys() or (own.kind == "usb" and _is_usb(url)):
            raise ValueError(f"--door {url}: this run has a line of that kind already")
        doors |= found
    return doors


@contextmanager
def _opened(url: str, *, console: bool = False) -> Iterator[RawLine]:
    """A line while the context lasts: that of a URL, or the console of that on USB."""
    with ExitStack() as stack:
        line = _line(url)
        stack.callback(line.close)
        if console:
            assert isinstance(line, RawUsbLine)
            line = RawSerialLine(CdcWire(line))
            stack.callback(line.close)
        yield line


def _is_usb(url: str) -> bool:
    """Whether a URL leads to a bus, not to a port."""
    scheme = url.partition(":")[0]
    return scheme in entries(BACKENDS) and not (scheme == EMULATOR and "door=serial" in url)


def _line(url: str) -> RawLine:
    scheme = url.partition(":")[0]
    buses, ports = entries(BACKENDS), entries(PORTS)
    if _is_usb(url):
        return RawUsbLine(url)
    if scheme not in ports:
        load_by_scheme(SCHEMES, url)  # which says what to write, unless a transport has this scheme
        known = ", ".join(sorted(f"{name}:" for name in {*ports, *buses}))
        raise DeviceNotFoundError(
            f"no raw line at {url!r}: the suite must also send what is wrong, which a transport cannot, so it needs "
            f"a bus of the group {BACKENDS} or a port of the group {PORTS}; there are {known}"
        )
    line = RawSerialLine(PortWire(url))
    line.enter_frames()
    return line
