"""Numbers at the public border: every parameter that is a number, of all public callables, against bad values.

A call either raises an error that names the parameter, or returns what it returns for the plain Python number. It is
never silent with NaN, and never takes memory without bound.
"""

from __future__ import annotations

import inspect
import re
import resource
import warnings
from collections.abc import Callable, Iterator
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
import phasewire as pw
import pytest
from phasewire import emulator, feel, hil, host, protocol, solver, view
from phasewire.view.view import _drives, _points

ROOMS = (pw, solver, protocol, feel, host, emulator, hil, view)
NUMBER = re.compile(r"\b(int|float|bool|ArrayLike|PointsLike|Wanted)\b|NDArray\[np")
ARRAY = re.compile(r"ArrayLike|NDArray|PointsLike|Wanted|Sequence\[|tuple\[|bytes")
MEMORY = 3_000_000_000  # bytes that a call may map beyond those that the process has
BAD = [float("nan"), float("inf"), float("-inf"), None, "3", 10**400, 1e39]
ODD = [np.uint8(3), np.int8(1), np.float32(0.25), -1, 2**31, True]
BAD_ARRAYS = [None, "3", [10**400], [[float("nan")] * 3], ["3"]]

MADE = re.compile(
    r"(Ack|Audible|Block|Capture|Check|Cluster|Cluster\.run|Cluster\.run_until|ControlPoints\.part|"
    r"ControlPoints\.placed|ControlPoints\.trusted|Device|Drawn\.placed|EmittedWaves|Emulator|EndToEnd\.field|"
    r"EndToEnd\.pressures|Entry|Envelope|Event|Exposure|FeltMap|Field|Focus|FocusReport|Gain|HandFrame|Info|Info\.speaks|Lobe|"
    r"Method|Null|Outline|Pin|PlacedHands\.next_frame|PulseFrames|PulseFrames\.joined|Pulses\.trusted|"
    r"RadiatedPower|Recording\.read|ResidualTable|ResidualTable\.__call__|Resonator\.responses|RigDevice|RigRun|"
    r"Sensation|Snapshot|Solution|Split|Split\.sides|Status|StreamReport|Touch|TouchRun\.felt|TouchRun\.pressures|"
    r"TrackedHand|TwoSided|Unfolded|View|View\.say|View\.was|compare_fields|open_device|open_device_async|"
    r"open_devices|read_mesh|record|save_field_picture|sense)$"
)
"""What phasewire makes itself, whose numbers were checked where they came in; and what is tested with its device."""
GROUPED = re.compile(r"^(AsyncDevice|DeviceGroup)\.|\.plot(_spectrum)?$")
"""The other faces of a `Device`, which pass their arguments on, and pictures."""
NAMED = {"degrees": "angle", "factor": "scale", "points": "point", "what": "point", "at": "point", "axes": "axis"}
NAMED |= {"positions": "point", "seen": "point", "true": "point", "limit_db": "limit", "frames": "point"}
NAMED |= {"start": "ticks", "stop": "ticks", "first": "periods", "last": "periods", "hold": "holds", "count": "number"}
NAMED |= {"transducers": "drive limit", "phase": "phases"}
"""How errors call a parameter, if not by its name, or an item of it by the beginning of its name."""

GRID, AIR = pw.TransducerArray.grid(4, 4), pw.Medium()
DRIVE, TWO = np.exp(1j * np.arange(16)), np.array([[0.0, 0.0, 0.1], [0.01, 0.0, 0.1]])
HIGH, EYE, ONES, WAVES = (0.0, 0.0, 0.15), np.eye(3), np.ones(16), np.tile(DRIVE, (200, 1)).astype(np.complex64)
FRAMES, PATCH, RING = np.zeros((2, 320), np.uint8), feel.SkinPatch(width=0.01, length=0.01), pw.Circle()
PLANE = pw.Grid.along("xy", HIGH, 0.02, 0.005)
FELT = feel.felt_map(np.zeros((40, 36)), PATCH, 4000.0)
HAND, CUBE, WALK = pw.Hand.flat(), pw.Mesh.cube(), pw.Outline.of(RING)
CYCLE, SINE = pw.Cycle(WAVES[:2], 2), pw.Modulation.sine(DRIVE)
SOUND = feel.Audible(np.zeros((1, 800)), np.zeros((1, 800)), 40e3)
LOUD = feel.exposure_at(GRID, WAVES[:4])
PULSES, QUADS = pw.Pulses.silent(320), protocol.PulseFrames(FRAMES, FRAMES)
STEADY = {"array": GRID, "drive": DRIVE}

Call = tuple[Callable[..., Any], dict[str, Any]]


def _emulated() -> Any:
    machine = pw.Emulator()
    machine.run(3)
    return machine


def _on_a_device(method: str, first: str = "status") -> Callable[..., Any]:
    """A method of a device that is plugged in for one call; only what it does not return is compared."""

    def call(**values: Any) -> None:
        with pw.open_device("emulator:") as device:
            getattr(device, first)()
            getattr(device, method)(**values)

    return call


def _with_defaults(kind: Any, **values: Any) -> Call:
    known = inspect.signature(kind).parameters.values()
    return kind, {each.name: each.default for each in known if each.default is not each.empty} | values


CAPTURE = _emulated().capture()
PLAYBACK = hil.Playback(CAPTURE)
CALLS: dict[str, Call] = {
    each.__name__: _with_defaults(each)
    for each in (
        *(pw.Asterisk, pw.Circle, pw.Concentric, pw.Polygon, pw.Rings, pw.Sphere, pw.Star, pw.Polyline, pw.Medium),
        *(pw.Toucher, pw.Transducer, solver.Completion, solver.Oil, solver.Options, solver.Rates, solver.Resonator),
        *(feel.Skin, feel.SkinPatch),
    )
}
CALLS |= {
    name: _with_defaults(getattr(pw.Mesh, name.split(".")[1]))
    for name in (
        "Mesh.cone",
        "Mesh.cube",
        "Mesh.sphere",
        "Mesh.pyramid",
        "Mesh.horizontal_prism",
        "Mesh.vertical_prism",
    )
}
CALLS |= {
    "Movable.moved": (RING.moved, {"offset": (0.0, 0.0, 0.01)}),
    "Movable.rotated": (RING.rotated, {"degrees": 10.0, "axis": (0.0, 0.0, 1.0)}),
    "Scalable.scaled": (RING.scaled, {"factor": 0.5}),
    "Drawn.sample": (RING.sample, {"spacing": 0.01}),
    "Calibration": (pw.Calibration, {"gain": ONES, "phase_deg": 0 * ONES, "polarity": ONES, "dead": 0 * ONES}),
    "Calibration.apply": (pw.Calibration.perfect(16).apply, {"drives": DRIVE, "first": 0}),
    "Calibration.perfect": (pw.Calibration.perfect, {"n": 4}),
    "Capture.bits": (CAPTURE.bits, {"start": 0, "stop": 50}),
    "Capture.channels": (CAPTURE.channels, {"start": 0, "stop": 50}),
    "Capture.drive": (CAPTURE.drive, {"period": 1}),
    "Capture.drives": (CAPTURE.drives, {"first": 0, "last": 2}),
    "ControlPoints": (pw.ControlPoints, {"positions": TWO, "amplitudes": [1.0, 0.5]}),
    "ControlPoints.sample": (pw.ControlPoints(TWO).sample, {"spacing": 0.01}),
    "Cycle": (pw.Cycle, {"drives": WAVES[:2], "hold": 2, "envelope": 0.0, "carrier": 40e3}),
    "Cycle.expanded": (CYCLE.expanded, {"periods": 8}),
    "Device.end_modulation": (_on_a_device("end_modulation"), {"period": 0}),
    "Device.identify": (_on_a_device("identify"), {"board": 0}),
    "Device.keep_playing": (_on_a_device("keep_playing", "enable"), {"seconds": 0.01}),
    "Device.modulate": (_on_a_device("modulate"), {"samples": b"12", "hold": 1, "period": 0}),
    "Device.play": (_on_a_device("play"), {"steps": [(0, 1)], "repeats": 0, "unattended": False, "period": 0}),
    "Device.set_drive_limit": (_on_a_device("set_drive_limit"), {"transducers": 9}),
    "Device.set_watchdog": (_on_a_device("set_watchdog"), {"seconds": 1.0}),
    "Device.show": (_on_a_device("show"), {"frame": PULSES, "period": 0}),
    "Device.silence": (_on_a_device("silence"), {"period": 0}),
    "Device.store": (_on_a_device("store"), {"slot": 1, "frame": PULSES}),
    "Device.stream": (
        _on_a_device("stream"),
        {"source": [PULSES], "rate": 100.0, "look_ahead": 0.01, "reconnect": False},
    ),
    "Emulator.run": (lambda periods: _emulated().run(periods), {"periods": 1}),
    "Emulator.run_until": (lambda period: _emulated().run_until(period), {"period": 5}),
    "Grid": (pw.Grid, {"centre": HIGH, "axes": EYE[:2], "counts": (3, 3), "step": 0.01}),
    "Grid.along": (pw.Grid.along, {"letters": "xy", "centre": HIGH, "extent": 0.02, "step": 0.005}),
    "Grid.spanning": (pw.Grid.spanning, {"centre": HIGH, "axes": EYE[:2], "extents": [0.02, 0.02], "step": 0.005}),
    "Grid.horizontal": (pw.Grid.horizontal, {"height": 0.1, "extent": 0.02, "step": 0.005}),
    "Grid.coordinates": (PLANE.coordinates, {"axis": 1}),
    "Grid.offsets": (PLANE.offsets, {"axis": 1}),
    "Hand": (pw.Hand, {"landmarks": HAND.landmarks, "widths": HAND.widths}),
    "Hand.repaired": (pw.Hand.repaired, {"landmarks": HAND.landmarks, "widths": HAND.widths}),
    "Hand.flat": _with_defaults(pw.Hand.flat),
    "Hand.moved": (HAND.moved, {"offset": (0.0, 0.0, 0.01)}),
    "Hand.rotated": (HAND.rotated, {"degrees": 10.0, "axis": (0.0, 0.0, 1.0)}),
    "Mesh": (pw.Mesh, {"solid": CUBE.solid, "rotation": EYE, "offset": (0.0, 0.0, 0.1)}),
    "Mesh.of": (pw.Mesh.of, {"vertices": CUBE.vertices, "faces": CUBE.faces}),
    "Mesh.moved": (CUBE.moved, {"offset": (0.0, 0.0, 0.01)}),
    "Mesh.rotated": (CUBE.rotated, {"degrees": 10.0, "axis": (0.0, 0.0, 1.0)}),
    "Mesh.scaled": (CUBE.scaled, {"factor": 0.5}),
    "Modulation": (pw.Modulation, {"drives": [DRIVE], "weights": [[1.0], [0.0]], "frequency": 200.0, "carrier": 4e4}),
    "Modulation.on_off": (pw.Modulation.on_off, {"drive": DRIVE, "frequency": 200.0, "carrier": 4e4}),
    "Modulation.sampled": (
        pw.Modulation.sampled,
        {"drive": DRIVE, "envelope": [1.0, 0.5], "frequency": 200.0, "carrier": 4e4},
    ),
    "Modulation.sine": (
        pw.Modulation.sine,
        {"drive": DRIVE, "frequency": 200.0, "depth": 1.0, "samples": 50, "carrier": 4e4},
    ),
    "Modulation.two_sided": (
        pw.Modulation.two_sided,
        {"first": DRIVE, "second": DRIVE, "frequency": 200.0, "carrier": 4e4},
    ),
    "Outline.of": (pw.Outline.of, {"what": TWO}),
    "Outline.round_trip": (WALK.round_trip, {"speed": 7.0, "pause": 0.0, "back": True}),
    "Outline.walk": (WALK.walk, {"count": 8, "speed": 7.0, "pause": 0.0, "back": True}),
    "PlaneField": (pw.PlaneField, {"grid": PLANE, "pressure": np.zeros(PLANE.shape, complex), "medium": AIR}),
    "VolumeField": (
        pw.VolumeField,
        {"grid": pw.Grid(HIGH, EYE, (3, 3, 3), 0.01), "pressure": np.zeros((3, 3, 3), complex), "medium": AIR},
    ),
    "PlanePropagator": (pw.PlanePropagator, {"array": GRID, "height": 0.1, "extent": 0.03, "per_pitch": 2}),
    "PlanePropagator.__call__": (pw.PlanePropagator(GRID, 0.1, 0.03, 2), {"drive": DRIVE}),
    "Pose": (pw.Pose, {"rotation": EYE, "translation": np.zeros(3), "scale": 1.0}),
    "Pose.estimate": (pw.Pose.estimate, {"seen": HAND.landmarks, "true": HAND.landmarks}),
    "PulseFrames.pulses": (QUADS.pulses, {"number": 1}),
    "Pulses": (pw.Pulses, {"phase": [0, 2], "width": [2, 4]}),
    "Pulses.from_drive": (pw.Pulses.from_drive, {"drive": DRIVE}),
    "Pulses.modulated": (PULSES.modulated, {"sample": 5}),
    "Pulses.silent": (pw.Pulses.silent, {"n": 4}),
    "Renderer": (pw.Renderer, {"array": GRID, "most_frames": 16}),
    "Renderer.render": (pw.Renderer(GRID, "am").render, {"what": TWO}),
    "render": (pw.render, {"array": GRID, "what": TWO, "way": "am"}),
    "Solver.follow": (pw.Solver(GRID).follow, {"positions": [TWO], "amplitudes": [1.0, 1.0], "ids": [0, 1]}),
    "Solver.solve": (lambda **all: pw.Solver(GRID).solve(**all), {"points": TWO, "ids": [0, 1]}),
    "TransducerArray": (
        pw.TransducerArray,
        {"positions": TWO, "normals": EYE[[2, 2]], "response": [1, 1], "limits": [1, 1]},
    ),
    "TransducerArray.calibrated": (GRID.calibrated, {"response": ONES, "limits": ONES}),
    "TransducerArray.grid": (pw.TransducerArray.grid, {"columns": 4, "rows": 4, "pitch": 0.01}),
    "TransducerArray.placed": (GRID.placed, {"rotation": EYE, "translation": HIGH}),
    "TwoSidedSolver": (pw.TwoSidedSolver, {"array": GRID, "frequency": 200.0}),
    "TwoSidedSolver.solve": (lambda **all: pw.TwoSidedSolver(GRID).solve(**all), {"points": TWO, "ids": [0, 1]}),
    "View.update": (lambda drive, points: (_drives(drive, 16), _points(points)), {"drive": DRIVE, "points": TWO}),
    "Wiring": (pw.Wiring, {"channels": np.arange(320)}),
    "Wiring.pin": (pw.Wiring.strips().pin, {"transducer": 3}),
    "Pin.of": (protocol.Pin.of, {"channel": 3}),
    "focus_report": (pw.focus_report, {**STEADY, "points": TWO, "grid": PLANE}),
    "intensity": (pw.intensity, {"pressure": [1.0]}),
    "pressure": (pw.pressure, {**STEADY, "at": TWO}),
    "radiation_pressure": (pw.radiation_pressure, {"pressure": [1.0], "reflection": 2.0}),
    "read_volume_mesh": (pw.read_volume_mesh, {"path": Path("none.npy"), "level": 1.0, "spacing": 0.001, "step": 1}),
    "relative_level": (pw.relative_level, {"pressure": [1.0], "reference": 1.0}),
    "sample_cut": (pw.sample_cut, {**STEADY, "grid": PLANE}),
    "sample_plane": (pw.sample_plane, {**STEADY, "height": 0.1, "extent": 0.02, "step": 0.005}),
    "sample_volume": (pw.sample_volume, {**STEADY, "grid": pw.Grid(HIGH, EYE, (3, 3, 3), 0.01)}),
    "sine": (pw.sine, {"frequency": 200.0, "depth": 1.0, "phase": 0.0, "force": False}),
    "read_envelope": (host.read_envelope, {"path": Path("none.wav"), "force": False}),
    "solve": (pw.solve, {"array": GRID, "points": TWO}),
    "solve_frames": (pw.solve_frames, {"array": GRID, "frames": [TWO], "workers": 1}),
    "sound_pressure_level": (pw.sound_pressure_level, {"pressure": [1.0]}),
    "touch": (pw.touch, {"hands": HAND, "objects": CUBE, "spacing": 0.015, "corners": True, "most_points": 8}),
    "two_sided": (pw.two_sided, {"array": GRID, "points": TWO, "frequency": 200.0}),
    "Aperture": (solver.Aperture, {"image": np.ones((3, 3)), "pixel": 1e-3}),
    "Aperture.disc": (solver.Aperture.disc, {"radius": 4e-3, "pixel": 1e-3}),
    "Aperture.from_image": (solver.Aperture.from_image, {"path": Path("none.npy"), "width": 0.01}),
    "Oil.surface": (solver.Oil().surface, {"push": np.ones((3, 3)), "step": 0.01}),
    "Quieting": (solver.Quieting, {"transducers": 4, "rule": solver.Rates()}),
    "Quieting.follow": (lambda **all: solver.Quieting(16, solver.Rates()).follow(**all), {"wanted": WAVES[:4]}),
    "ResidualTable.of": (solver.ResidualTable.of, {"transducer": pw.Transducer(model="rayleigh"), "nearest": 0.05}),
    "Resonator.enveloped": (solver.Resonator().enveloped, {"carrier": 4e4, "step": 1e-6}),
    "Resonator.response": (solver.Resonator().response, {"frequency": 4e4}),
    "Resonator.sampled": (solver.Resonator().sampled, {"step": 1e-6}),
    "intensity_component": (solver.intensity_component, {"array": GRID, "modulation": SINE, "at": TWO, "harmonic": 1}),
    "residual": (solver.residual, {"transducer": pw.Transducer(), "sine": [0.1], "distance": [0.2]}),
    "slice_field": (solver.slice_field, {"aperture": solver.Aperture.disc(4e-3, 4e-3), "z": 0.05, "extent": 0.02}),
    "split": (solver.split, {"points": pw.ControlPoints(TWO), "ids": [0, 1]}),
    "transfer_matrix": (solver.transfer_matrix, {"array": GRID, "at": TWO}),
    "AmplitudeModulation": (protocol.AmplitudeModulation, {"first": 0, "count": 4, "hold": 1, "period": 0}),
    "Entries": (protocol.Entries, {"entries": (protocol.Entry(0, 1),), "first": 0}),
    "Output": (protocol.Output, {"action": protocol.Action.SILENCE, "period": 0}),
    "PlaySequence": (protocol.PlaySequence, {"first": 0, "count": 1, "period": 0, "repeats": 0, "unattended": False}),
    "Samples": (protocol.Samples, {"samples": b"12", "first": 0}),
    "Slot": (protocol.Slot, {"number": 1, "pulses": PULSES}),
    "Update": (protocol.Update, {"pulses": PULSES, "period": 0}),
    "pack_updates": (
        protocol.pack_updates,
        {"phase": FRAMES, "width": FRAMES, "sequence": 1, "period": 0, "restart": False},
    ),
    "quantise": (protocol.quantise, {"drives": DRIVE[None], "first": 0}),
    "unpack_updates": (protocol.unpack_updates, {"blocks": np.zeros((1, 512), np.uint8)}),
    "Audible.strongest": (SOUND.strongest, {"place": 0, "count": 3}),
    "Exposure.gain": (LOUD.gain, {"limit_db": 100.0}),
    "FeltMap.intensity_over_time": (FELT.intensity_over_time, {"window": 0.005}),
    "Skin.modulus": (feel.Skin().modulus, {"frequency": [100.0]}),
    "Skin.response": (feel.Skin().response, {"wavenumber": [10.0], "frequency": [100.0]}),
    "Skin.shear_speed": (feel.Skin().shear_speed, {"frequency": [100.0]}),
    "Skin.surface_speed": (feel.Skin().surface_speed, {"frequency": [100.0]}),
    "Skin.surface_wavenumber": (feel.Skin().surface_wavenumber, {"frequency": [100.0]}),
    "Unfolded.of": (feel.Unfolded.of, {"hand": HAND, "spacing": 0.01}),
    "a_weighting": (feel.a_weighting, {"frequency": [100.0]}),
    "audible": (feel.audible, {"array": GRID, "waves": WAVES, "pulses": WAVES * 0, "at": TWO, "reach": 0.2}),
    "exposure_at": (feel.exposure_at, {"array": GRID, "waves": WAVES[:4], "at": TWO}),
    "exposure_limit": (feel.exposure_limit, {"array": GRID, "at": TWO, "limit_db": 100.0}),
    "feel": (feel.feel, {"array": GRID, "waves": WAVES, "places": PATCH, "every": 10}),
    "felt_map": (feel.felt_map, {"pressures": np.zeros((40, 36)), "places": PATCH, "rate": 4000.0}),
    "radiated_power": (feel.radiated_power, {"array": GRID, "waves": WAVES[:4], "supply_v": 15.0}),
    "radiation_pressures": (feel.radiation_pressures, {"array": GRID, "waves": WAVES, "places": PATCH, "every": 10}),
    "warming": (feel.warming, {"peak": 10.0, "seconds": 1.0}),
    "Playback.intensity_component": (
        PLAYBACK.intensity_component,
        {"at": TWO, "frequency": 40_000.0, "first": 0, "last": 2},
    ),
    "Playback.phasors": (PLAYBACK.phasors, {"at": TWO, "first": 0, "last": 2}),
    "Playback.signal": (PLAYBACK.signal, {"at": TWO, "start": 0, "stop": 50}),
    "Playback.voltages": (PLAYBACK.voltages, {"start": 0, "stop": 50}),
    "emitted_waves": (
        hil.emitted_waves,
        {"capture": CAPTURE, "array": pw.TransducerArray.grid(), "first": 0, "last": 2},
    ),
}
"""Of each public callable with numbers: a call, and arguments that it takes."""


def _numbers(kind: Any) -> dict[str, str]:
    """The annotations of those parameters that are numbers."""
    try:
        known = inspect.signature(kind).parameters.values()
    except (TypeError, ValueError):
        return {}
    return {
        each.name: str(each.annotation)
        for each in known
        if NUMBER.search(str(each.annotation)) and "Callable" not in str(each.annotation)
    }


def _public() -> Iterator[tuple[str, dict[str, str]]]:
    seen = set[str]()
    for room in ROOMS:
        for name in room.__all__:
            kind = getattr(room, name)
            if not callable(kind) or not kind.__module__.startswith("phasewire"):
                continue
            if inspect.isclass(kind) and (issubclass(kind, Enum | Exception) or getattr(kind, "_is_protocol", False)):
                continue
            parts = [kind]
            if inspect.isclass(kind):
                parts += [f for n, f in inspect.getmembers(kind, inspect.isroutine) if n[0] != "_" or n == "__call__"]
            for part in parts:
                called = getattr(part, "__qualname__", name)
                if (
                    called in seen
                    or not str(getattr(part, "__module__", "")).startswith("phasewire")
                    or not (found := _numbers(part))
                ):
                    continue
                seen.add(called)
                if not MADE.match(called) and not GROUPED.search(called):
                    yield called, found


PUBLIC = dict(_public())
CASES = [
    (name, parameter) for name in PUBLIC for parameter in PUBLIC[name] if parameter in CALLS.get(name, ("", {}))[1]
]


def test_every_public_callable_with_numbers_is_in_the_table() -> None:
    assert sorted(set(PUBLIC) - set(CALLS)) == []


@pytest.fixture
def _little_memory() -> Iterator[None]:
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_AS, before)


@pytest.mark.usefixtures("_little_memory")
@pytest.mark.parametrize(("name", "parameter"), CASES, ids=str)
def test_a_number_is_refused_by_name_or_means_what_it_says(name: str, parameter: str) -> None:
    call, values = CALLS[name]
    kind, good = PUBLIC[name][parameter], values[parameter]
    several = not np.isscalar(good) and good is not None and ARRAY.search(kind) is not None
    wanted = [parameter, parameter[:4] if several else parameter, NAMED.get(parameter, parameter)]
    trouble = []
    for bad in _bad_arrays(good) if several else [*BAD, *ODD]:
        may_be = "None" in kind or good is None if bad is None else several or any(bad is each for each in ODD)
        plain = bad.item() if isinstance(bad, np.generic) else bad
        try:
            with warnings.catch_warnings(), np.errstate(all="ignore"):
                warnings.simplefilter("ignore")
                result = call(**values | {parameter: bad})
                same = several or _content(result) == _content(call(**values | {parameter: plain}))
        except pw.DeviceError:  # refused by the device: it came through
            assert may_be
        except (ValueError, TypeError, pw.PhasewireError) as error:
            said = f"{type(error).__name__}: {error}"
            named = any(word.replace("_", " ") in said.replace("_", " ") for word in wanted)
            if not named and not (may_be and said == _said(call, values | {parameter: plain})):
                trouble.append(f"{bad!r:.40} → {said:.150}")
        except FileNotFoundError:
            if not may_be:
                trouble.append(f"{bad!r:.40} passes")
        except Exception as error:  # what must not happen
            trouble.append(f"{bad!r:.40} → {error!r:.150}")
        else:
            if not may_be or not same or _has_nan(result):
                trouble.append(f"{bad!r:.40} → {result!r:.100}, {'as' if same else 'not as'} the plain number")
    assert not trouble, "\n".join(trouble)


def _said(call: Callable[..., Any], values: dict[str, Any]) -> str:
    """The error for a plain number that does not fit its fellows."""
    try:
        call(**values)
    except (ValueError, TypeError, pw.PhasewireError) as error:
        return f"{type(error).__name__}: {error}"
    return ""


def _bad_arrays(good: Any) -> Iterator[Any]:
    """What is no array of such numbers, and arrays with one number that is none."""
    yield from BAD_ARRAYS
    if np.asarray(good).dtype.kind in "fc":
        for bad in (np.nan, np.inf, 1e39):
            values = np.array(good, np.complex128 if np.iscomplexobj(good) else np.float64)
            values.flat[-1] = bad
            yield values


def _content(value: Any) -> Any:
    """A value in depth, to be compared."""
    if isinstance(value, np.ndarray):
        return value.shape, value.tobytes()
    if isinstance(value, (tuple, list)):
        return [_content(each) for each in value]
    if hasattr(value, "__dataclass_fields__"):
        return [_content(getattr(value, name)) for name in value.__dataclass_fields__]
    return value if isinstance(value, (int, float, complex, str, bytes)) else type(value)


def _has_nan(value: Any) -> bool:
    if isinstance(value, np.ndarray):
        return value.dtype.kind in "fc" and bool(np.isnan(value).any())
    if isinstance(value, (tuple, list)):
        return any(map(_has_nan, value))
    return isinstance(value, float) and np.isnan(value)
