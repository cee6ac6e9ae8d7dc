"""A view of an array: the page that shows it, for a program, a notebook, or a command."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from threading import Event, Lock, Thread
from types import TracebackType
from typing import Any, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.arguments import FARTHEST, array_of, as_drives
from ..base.errors import PhasewireError
from ..base.pictures import BLUE, CYCLIC, GREEN, LIGHT, ORANGE, RED, SEQUENTIAL
from ..protocol.board import BOARDS, CARRIER_HZ, CHANNELS_PER_PROCESSOR, HALF_TICKS_PER_PERIOD, PROCESSORS_PER_BOARD
from ..protocol.pulses import Pulses
from ..protocol.wiring import Pin
from ..solver import METHODS, Solution, TransducerArray, TwoSided
from ..solver.contact.hand import LANDMARKS, QUADS, Hand
from ..solver.contact.mesh import Mesh
from .comparing import Comparison
from .messages import PageCommand, encode, read_command
from .painting import IMAGE_QUANTITIES, Painter
from .past import Past
from .server import LOOPBACK, PageServer
from .settings import FOLLOWED, GROUPS, RANGES, Choices, Settings
from .snapshot import Emitter, Snapshot, rows_of

__all__ = ["Director", "Tape", "View"]

_log = logging.getLogger(__name__)

Item = TypeVar("Item", Hand, Mesh)

MOST_RATE = 60.0
"""Frames per second that are painted."""
IDLE_SECONDS = 0.25
WAIT_SECONDS = 0.1
COLOURS = {"hand": ORANGE, "point": RED, "probe": GREEN}
ARCS = {"dark": LIGHT, "light": BLUE}
"""In either theme of the page; objects have the colour of its text, as they have the colour of ink elsewhere."""
FOLLOWING_STEP = 2e-3
"""Metres by which a plane that follows a hand moves: it takes milliseconds to prepare one at a new height."""
FULL, LEVELS = 255, 256
NOTEBOOK_PIXELS = 640


class Tape(Protocol):
    """Snapshots of a time that is over."""

    @property
    def span(self) -> tuple[int, int] | None:
        """The oldest and the newest period; None if there is none."""

    def at(self, period: int) -> Snapshot | None:
        """The snapshot of a period, or of the last one before it; None if there is none."""


class Director:
    """Carries out what pages ask for; this one does nothing.

    Its methods are called in the server's thread, and return at once.

    Attributes
    ----------
    controls : tuple of str
        What a page offers beside the view: some of ``stop``, ``play``, ``hand``, ``objects``, ``faults``, ``waves``.
    object_kinds : tuple of str
        Kinds of objects.
    faults : tuple of dict
        Faults for the page: the name of each, and its fields with their ranges.
    """

    controls: tuple[str, ...] = ()
    object_kinds: tuple[str, ...] = ()
    faults: tuple[dict[str, Any], ...] = ()

    def stop(self) -> None:
        """Turn the outputs off."""

    def go(self) -> None:
        """Play again."""

    def fault(self, fault: dict[str, Any]) -> None:
        """Inject a fault; raise `ValueError` if it is not valid."""

    def clear_faults(self) -> None:
        """Clear the faults whose cause is gone."""

    def apply(self, settings: Settings) -> None:
        """Play by these settings."""

    def gone(self) -> None:
        """The last page has gone."""


class View:
    """A page in a browser that shows an array, its field, and what is around it.

    Parameters
    ----------
    array : TransducerArray or Emitter, optional
        What is shown; the default grid by default.
    settings : Settings, optional
        The first ones.
    director : Director, optional
        Carries out what a page asks for; without one a page only looks.
    tape : Tape, optional
        What is shown instead of what comes by `update` and `show`.
    listen, port : str, int
        The address to listen at; only this computer can reach the default, at any free port.
    embedded : bool
        Whether the page may be shown inside another one of this computer, such as a notebook.
    saving : bool
        Whether a page may send a picture (`browser.saved_from`).

    Raises
    ------
    OSError
        If the address cannot be used.

    Notes
    -----
    Use it in a ``with`` statement, or call `close`. In a notebook the last expression ``view`` of a cell shows it, and
    `update` in later cells changes it.
    """

    def __init__(
        self,
        array: TransducerArray | Emitter | None = None,
        *,
        settings: Settings | None = None,
        director: Director | None = None,
        tape: Tape | None = None,
        listen: str = LOOPBACK,
        port: int = 0,
        embedded: bool = True,
        saving: bool = False,
    ) -> None:
        if not isinstance(array, Emitter | TransducerArray | None):
            raise ValueError(f"{str(array)[:40]!r} must be a TransducerArray, or an Emitter")
        self.emitter = array if isinstance(array, Emitter) else Emitter(array or TransducerArray.grid())
        self._director = director or Director()
        self.settings = settings or Settings()
        groups = frozenset(("view", *self._director.controls)) & set(GROUPS)
        self._choices = Choices(
            groups, len(self.emitter.array), tuple(METHODS), tuple(IMAGE_QUANTITIES), tuple(self._director.object_kinds)
        )
        self._painter = Painter(self.emitter)
        self._comparison = Comparison(self.emitter, self._painter)
        self._past, self._tape = Past(), tape
        self._lock = Lock()
        """Of the snapshots and the settings, which several threads use."""
        self._told: str | None = None
        """The last error of painting, which is told once."""
        self._newest = Snapshot(np.zeros((1, len(self.emitter.array)), np.complex64), state="waiting")
        self._exact: Snapshot | None = None
        self._height: float | None = None
        """Where the plane that follows a hand was last."""
        self._changed, self._closing = Event(), Event()
        self._meshes: tuple[Mesh, ...] = ()
        self._began = time.monotonic()
        self.server = PageServer(
            listen=listen,
            port=port,
            on_message=self._hear,
            on_page=self._changed.set,
            on_gone=self._director.gone,
            embedded=embedded,
            saving=saving,
        )
        self.server.start()
        self._thread = Thread(target=self._paint, name="phasewire view", daemon=True)
        self.server.keep("setup", self._setup())
        self.settle(lambda settings: settings)
        self._thread.start()

    def __repr__(self) -> str:
        return f"View({self.emitter.name}, {self.url})"

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the page; a page that is open says so."""
        self._closing.set()
        self._changed.set()
        self.server.wanted.set()
        self._thread.join()
        self.server.close()

    def wait_until_left(self) -> None:
        """Wait until a page has come, and all have gone."""
        while not self.server.seen.wait(WAIT_SECONDS) or self.server.pages:
            time.sleep(WAIT_SECONDS)

    @property
    def url(self) -> str:
        """What a browser opens. Whoever has it can do what the page can: it contains a token."""
        return self.server.url

    def _repr_html_(self) -> str:
        return f'<iframe src="{self.url}" width="100%" height="{NOTEBOOK_PIXELS}" title="phasewire view"></iframe>'

    def warm_up(self) -> None:
        """Paint a frame once, so that the first one of a page does not wait for what is loaded by it."""
        self._frame()

    # What is shown

    def update(
        self,
        drive: Solution | TwoSided | Pulses | ArrayLike | None = None,
        *,
        points: ArrayLike | None = None,
        hands: Hand | Sequence[Hand] | None = None,
        objects: Mesh | Sequence[Mesh] | None = None,
    ) -> None:
        """Show something else; what is not given stays.

        Parameters
        ----------
        drive : Solution, TwoSided, Pulses, or (n,) or (k, n) complex, optional
            What the transducers emit; a solution brings its control points.
        points : (m, 3) or (m, 4) float, optional
            Control points in metres; the fourth number is their strength, 0 to 1.
        hands : Hand or sequence of Hand, optional
        objects : Mesh or sequence of Mesh, optional

        Raises
        ------
        ValueError
            If drives do not fit the array or are more than two, something is of another type, or the view is closed.
        """
        if self._closing.is_set():
            raise ValueError("this view is closed; make a new one")
        with self._lock:
            now = self._newest
        given: dict[str, Any] = {}
        if drive is not None:
            given["drives"], found = _drives(drive, len(self.emitter.array))
            points = found if points is None and found is not None else points
        if points is not None:
            given["points"] = _points(points)
        if hands is not None:
            given["hands"] = _all_of(Hand, hands)
        if objects is not None:
            given["objects"] = _all_of(Mesh, objects)
        period = round((time.monotonic() - self._began) * CARRIER_HZ)
        self.show(replace(now, state="playing", period=period, **given))

    def show(self, snapshot: Snapshot) -> None:
        """Show a snapshot, now, and keep it for those who go back."""
        with self._lock:
            self._newest = snapshot
            self._past.add(snapshot)
        self._changed.set()

    def show_past(self, snapshot: Snapshot) -> None:
        """Show exactly what was at the period that the page has gone back to."""
        with self._lock:
            self._exact = snapshot
        self._changed.set()

    def was(self, period: int) -> Snapshot | None:
        """The snapshot of a period of the last seconds, or of the last one before it."""
        with self._lock:
            return self._past.at(period)

    def say(self, text: str, *, error: bool = False) -> None:
        """Tell those who look something."""
        self.server.tell(encode("notice", {"text": text, "error": error}))

    def settle(self, change: Callable[[Settings], Settings]) -> None:
        """Change the settings, and tell all pages; an error of the change leaves them as they are."""
        with self._lock:
            before, self.settings = self.settings, change(self.settings)
            if self.settings.at != before.at:
                self._exact = None
            self.server.keep("settings", encode("settings", {"values": asdict(self.settings)}))
        self._changed.set()

    # From pages, in the server's thread

    def _hear(self, text: str) -> None:
        """Carry out what a page asks for; an error is told to it, and does not end its connection."""
        try:
            self._carry_out(read_command(text))
        except Exception as error:
            if not isinstance(error, ValueError | PhasewireError):
                _log.exception("a request of a page failed")
            self.say(str(error), error=True)

    def _carry_out(self, command: PageCommand) -> None:
        match command.do:
            case "stop":
                self._director.stop()
            case "go":
                self._director.go()
            case "fault":
                self._director.fault(dict(command.fault or {}))
            case "clear-faults":
                self._director.clear_faults()
            case _:
                self.settle(lambda settings: settings.changed(command.settings, self._choices))
                self._director.apply(self.settings)

    # To pages, in the view's own thread

    def _paint(self) -> None:
        """Paint what is new whenever a page can take it."""
        while not self._closing.is_set():
            if not (self.server.wanted.wait(IDLE_SECONDS) and self._changed.wait(IDLE_SECONDS)):
                continue
            self._changed.clear()
            began = time.monotonic()
            try:
                self.server.publish(self._frame())
            except Exception as error:
                _log.exception("a frame could not be painted")
                if self._told != (said := f"a frame could not be painted: {error}"):
                    self._told = said
                    self.say(said, error=True)
            time.sleep(max(0.0, 1 / MOST_RATE - (time.monotonic() - began)))

    def _shown(self) -> tuple[Snapshot, bool, Settings, tuple[int, int] | tuple[None, None]]:
        """The snapshot to paint, whether it is of now, the settings, and the periods that can be gone back to."""
        with self._lock:
            settings, tape = self.settings, self._tape or self._past
            span = tape.span or (None, None)
            if settings.at is None and self._tape is None:
                return self._newest, True, settings, span
            if self._exact is not None and self._exact.period == settings.at:
                return self._exact, False, settings, span
            return tape.at(settings.at or 0) or self._newest, False, settings, span

    def _frame(self) -> bytes:
        """The next frame for the page."""
        snapshot, live, settings, (oldest, newest) = self._shown()
        settings = self._following(snapshot, settings)
        self._keep_objects(snapshot.objects)
        arrays = self._arrays(snapshot)
        fields = {
            "seconds": snapshot.period / CARRIER_HZ,
            "period": snapshot.period,
            "state": snapshot.state,
            "source": snapshot.source,
            "live": live,
            "oldest": oldest,
            "newest": newest,
            "sides": [hand.side for hand in snapshot.hands],
            "pick": None if settings.pick is None else self._picked(settings.pick, snapshot, settings),
            "boards": snapshot.boards or ("",) * BOARDS,
            "figures": snapshot.figures,
            "waves": self._waves(snapshot, arrays),
        }
        try:
            fields |= self._fields(snapshot, settings, arrays)
        except ValueError as error:  # a plane that is too close to a transducer
            self.settle(lambda now: replace(now, xy=False, xz=False, yz=False, compare=None))
            self.say(f"planes are off: {error}", error=True)
            fields |= self._fields(snapshot, self.settings, arrays)
        fields["probe"] = self._probed(snapshot, settings)
        return encode("frame", fields, arrays)

    def _following(self, snapshot: Snapshot, settings: Settings) -> Settings:
        """Settings with the horizontal plane at the height of what it follows, or where that was last."""
        if settings.follow is None:
            self._height = None
            return settings
        palms = [hand.centre[2] for hand in snapshot.hands]
        heights = palms[:1] if settings.follow == "palm" else snapshot.points[:, 2]
        if len(heights):
            least, most = RANGES["xy_at"]
            self._height = float(np.clip(round(np.mean(heights) / FOLLOWING_STEP) * FOLLOWING_STEP, least, most))
        return settings if self._height is None else replace(settings, xy_at=self._height)

    def _probed(self, snapshot: Snapshot, settings: Settings) -> dict[str, Any] | None:
        """The pressure at the probe, if there is one."""
        if settings.probe is None:
            return None
        try:
            return self._painter.probe(snapshot, settings.probe)._asdict()
        except ValueError as error:  # it is too close to a transducer
            self.settle(lambda now: replace(now, probe=None))
            self.say(f"the probe is off: {error}", error=True)
            return None

    def _fields(self, snapshot: Snapshot, settings: Settings, arrays: dict[str, NDArray[Any]]) -> dict[str, Any]:
        """What a frame has of the fields; images are added to the arrays."""
        contest = self._comparison.hold(snapshot, settings)
        side: dict[str, Any] | None = None
        if isinstance(contest, str):
            images, scale = self._painter.paint(snapshot, settings)
            side = {"incomplete": contest}
        elif contest is None:
            images, scale = self._painter.paint(snapshot, settings)
        else:
            (*images, this, that), scale = self._painter.paint(snapshot, settings, (contest.this, contest.other))
            arrays |= {"this": this.levels, "other": that.levels}
            side = {"method": contest.method, "other": settings.compare, "numbers": contest.numbers, "incomplete": ""}
        arrays |= {image.name: image.levels for image in images}
        planes = [
            {"name": image.name, "corner": image.corner.tolist(), "u": image.u.tolist(), "v": image.v.tolist()}
            for image in images
        ]
        return {"planes": planes, "scale": scale, "side": side}

    def _waves(self, snapshot: Snapshot, arrays: dict[str, NDArray[Any]]) -> dict[str, Any] | None:
        """What a frame has of the square waves; their bits are added to the arrays."""
        if (waves := snapshot.waves) is None:
            return None
        arrays["waves"] = waves.bits
        names = [f"{each}: {Pin.of(int(self.emitter.channels[each])).name}" for each in waves.transducers]
        return {"names": names, "first": waves.first_tick}

    def _arrays(self, snapshot: Snapshot) -> dict[str, NDArray[Any]]:
        magnitudes = np.abs(snapshot.drives)
        strongest = magnitudes.argmax(axis=0) if len(magnitudes) <= 2 else magnitudes.sum(axis=1).argmax()
        stronger = strongest, np.arange(snapshot.drives.shape[1])
        arcs = [np.stack([arc[:-1], arc[1:]], axis=1) for arc in snapshot.arcs if len(arc) > 1]
        arrays: dict[str, NDArray[Any]] = {
            "phase": (np.angle(snapshot.drives[stronger]) % (2 * np.pi) * (LEVELS / (2 * np.pi)))
            .astype(np.int64)
            .astype(np.uint8),
            "amplitude": np.minimum(magnitudes[stronger] * FULL + 0.5, FULL).astype(np.uint8),
            "landmarks": np.array([hand.landmarks for hand in snapshot.hands]).reshape(-1, LANDMARKS, 3),
            "quads": np.array([hand.quads for hand in snapshot.hands]).reshape(-1, QUADS, 4, 3),
            "points": snapshot.points,
            "arcs": np.concatenate(arcs) if arcs else np.empty((0, 2, 3)),
        }
        for number, (mesh, first) in enumerate(zip(snapshot.objects, self._meshes, strict=True)):
            if mesh is not first:
                arrays[f"mesh{number}"] = mesh.vertices
        return arrays

    def _keep_objects(self, objects: Sequence[Mesh]) -> None:
        """Send the objects' triangles, if they are others than before; those that only move send their vertices."""
        if [mesh.solid for mesh in objects] == [mesh.solid for mesh in self._meshes]:
            return
        self._meshes = tuple(objects)
        arrays: dict[str, NDArray[Any]] = {}
        for number, mesh in enumerate(objects):
            arrays |= {f"vertices{number}": mesh.vertices, f"faces{number}": mesh.faces.astype(np.uint32)}
        self.server.keep("objects", encode("objects", {"count": len(objects)}, arrays))

    def _picked(self, number: int, snapshot: Snapshot, settings: Settings) -> dict[str, Any]:
        """What there is to say about a transducer."""
        pin = Pin.of(int(self.emitter.channels[number]))
        x, y, z = self.emitter.array.positions[number] * 1e3
        lines = [("Place", f"{x:.1f}, {y:.1f}, {z:.1f} mm")]
        if self.emitter.wiring is not None:
            lines += [("Board", str(pin.board)), ("Processor", str(pin.processor)), ("Bit", str(pin.bit))]
        for of, drive in _of_each(snapshot.drives[:, number]):
            pulse = Pulses.from_drive(np.array([drive]))
            said = f"{pulse.width[0]} ticks wide, centred at {pulse.phase[0]} of {HALF_TICKS_PER_PERIOD} half ticks"
            emitted = f"{abs(drive):.3f} of full drive, {np.rad2deg(np.angle(drive)) % 360:.1f}°"
            lines += [(f"Pulse{of}", said), (f"Emits{of}", emitted)]
        if (calibration := self.emitter.calibration) is not None:
            dead = ", dead" if calibration.dead[number] else ""
            polarity = "reversed" if calibration.polarity[number] < 0 else "normal"
            lines.append(
                (
                    "Calibration",
                    f"gain {calibration.gain[number]:.3f}, {calibration.phase_deg[number]:+.1f}°, {polarity}{dead}",
                )
            )
        return {"transducer": number, "lines": lines, "silenced": number in settings.silenced}

    def _setup(self) -> bytes:
        from matplotlib import colormaps

        processors, bits = np.divmod(self.emitter.channels, CHANNELS_PER_PROCESSOR)
        boards, processors = np.divmod(processors, PROCESSORS_PER_BOARD)
        fields = {
            "device": self.emitter.name,
            "controls": ["past", *(["recording"] if self._tape else []), *self._director.controls],
            "methods": list(METHODS),
            "followed": list(FOLLOWED),
            "colours": {theme: COLOURS | {"arc": arc} for theme, arc in ARCS.items()},
            "quantities": [
                {"name": name, "label": each.label, "unit": each.unit, "cyclic": each.cyclic}
                for name, each in IMAGE_QUANTITIES.items()
            ],
            "object_kinds": list(self._director.object_kinds),
            "faults": list(self._director.faults),
            "limits": {name: list(limits) for name, limits in RANGES.items()},
        }
        arrays: dict[str, NDArray[Any]] = {
            "positions": self.emitter.array.positions,
            "normals": self.emitter.array.normals,
            "board": boards.astype(np.uint8),
            "processor": processors.astype(np.uint8),
            "bit": bits.astype(np.uint8),
            "cyclic": np.roll(_colours(colormaps[CYCLIC]), LEVELS // 2, axis=0),  # phase 0 is in the middle of the map
            "sequential": _colours(colormaps[SEQUENTIAL]),
        }
        return encode("setup", fields, arrays)


def _colours(table: Any) -> NDArray[np.uint8]:
    """256 colours of a map, (256, 3), evenly from its beginning to before its end."""
    colours: NDArray[np.uint8] = np.asarray(table(np.arange(LEVELS) / LEVELS, bytes=True), np.uint8)
    return colours[:, :3]


def _of_each(drives: NDArray[Any]) -> list[tuple[str, complex]]:
    """A transducer's drives in the fields that alternate, with the name of each; of many the strongest."""
    if len(drives) > 2:
        return [(f", strongest of {len(drives)} fields", drives[np.abs(drives).argmax()])]
    return [(f" of half {half}" if len(drives) > 1 else "", drive) for half, drive in enumerate(drives)]


def _drives(given: Any, transducers: int) -> tuple[NDArray[np.complexfloating], NDArray[np.float64] | None]:
    """Drives (k, n), and the control points of a solution, (m, 4)."""
    points = None
    if isinstance(given, Solution | TwoSided):
        points = rows_of(given.points)
        given = given.drive if isinstance(given, Solution) else given.drives
    elif isinstance(given, Pulses):
        given = given.to_drive()
    drives = np.atleast_2d(as_drives(given))
    if drives.shape[1:] != (transducers,) or not 1 <= len(drives) <= 2:
        raise ValueError(
            f"drives have the shape {drives.shape}, but the array has {transducers} transducers; one or two fields"
        )
    return drives, points


def _all_of(kind: type[Item], given: Item | Sequence[Item]) -> tuple[Item, ...]:
    """One or more of a kind; `ValueError` if one is another thing."""
    items = (given,) if isinstance(given, kind) else tuple(given) if isinstance(given, Sequence) else None
    if items is None or not all(isinstance(each, kind) for each in items):
        raise ValueError(f"{str(given)[:40]!r} must be a {kind.__name__}, or a sequence of them")
    return items


def _points(given: ArrayLike) -> NDArray[np.float64]:
    points = np.atleast_2d(array_of("points", given, np.float64))
    if points.ndim != 2 or points.shape[1] not in (3, 4) or not np.abs(points).max(initial=0) <= FARTHEST:
        raise ValueError(
            f"points have the shape {points.shape}; they must be (m, 3) in metres, at most {FARTHEST:g}, or (m, 4) "
            "with strengths"
        )
    return points if points.shape[1] == 4 else np.column_stack([points, np.ones(len(points))])
