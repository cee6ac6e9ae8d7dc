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
from functools import cache
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
    r"ControlPoints\.placed|ControlPoints\.trusted|Device|Device\.keep_playing|Drawn\.placed|EmittedWaves|Emulator|EndToEnd\.field|"
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


@cache
def _calls() -> dict[str, Call]:
    """Of each public callable with numbers: a call, and arguments that it takes."""
    grid, air = pw.TransducerArray.grid(4, 4), pw.Medium()
    drive, two = np.exp(1j * np.arange(16)), np.array([[0.0, 0.0, 0.1], [0.01, 0.0, 0.1]])
    high, eye, ones, waves = (0.0, 0.0, 0.15), np.eye(3), np.ones(16), np.tile(drive, (200, 1)).astype(np.complex64)
    frames, patch, ring = np.zeros((2, 320), np.uint8), feel.SkinPatch(width=0.01, length=0.01), pw.Circle()
    plane = pw.Grid.along("xy", high, 0.02, 0.005)
    felt = feel.felt_map(np.zeros((40, 36)), patch, 4000.0)
    hand, cube, walk = pw.Hand.flat(), pw.Mesh.cube(), pw.Outline.of(ring)
    cycle, sine = pw.Cycle(waves[:2], 2), pw.Modulation.sine(drive)
    sound = feel.Audible(np.zeros((1, 800)), np.zeros((1, 800)), 40e3)
    loud = feel.exposure_at(grid, waves[:4])
    pulses, quads = pw.Pulses.silent(320), protocol.PulseFrames(frames, frames)
    steady = {"array": grid, "drive": drive}
    capture = _emulated().capture()
    playback = hil.Playback(capture)
    calls: dict[str, Call] = {
        each.__name__: _with_defaults(each)
        for each in (
            *(pw.Asterisk, pw.Circle, pw.Concentric, pw.Polygon, pw.Rings, pw.Sphere, pw.Star, pw.Polyline, pw.Medium),
            *(pw.Toucher, pw.Transducer, solver.Completion, solver.Oil, solver.Options, solver.Rates, solver.Resonator),
            *(feel.Skin, feel.SkinPatch),
        )
    }
    solids = (
        pw.Mesh.cone,
        pw.Mesh.cube,
        pw.Mesh.sphere,
        pw.Mesh.pyramid,
        pw.Mesh.horizontal_prism,
        pw.Mesh.vertical_prism,
    )
    calls |= {f"Mesh.{make.__name__}": _with_defaults(make) for make in solids}
    skin = feel.Skin()
    of_frequency = (skin.modulus, skin.shear_speed, skin.surface_speed, skin.surface_wavenumber)
    calls |= {f"Skin.{find.__name__}": (find, {"frequency": [100.0]}) for find in of_frequency}
    calls |= {
        "Movable.moved": (ring.moved, {"offset": (0.0, 0.0, 0.01)}),
        "Movable.rotated": (ring.rotated, {"degrees": 10.0, "axis": (0.0, 0.0, 1.0)}),
        "Scalable.scaled": (ring.scaled, {"factor": 0.5}),
        "Drawn.sample": (ring.sample, {"spacing": 0.01}),
        "Calibration": (pw.Calibration, {"gain": ones, "phase_deg": 0 * ones, "polarity": ones, "dead": 0 * ones}),
        "Calibration.apply": (pw.Calibration.perfect(16).apply, {"drives": drive, "first": 0}),
        "Calibration.perfect": (pw.Calibration.perfect, {"n": 4}),
        "Capture.bits": (capture.bits, {"start": 0, "stop": 50}),
        "Capture.channels": (capture.channels, {"start": 0, "stop": 50}),
        "Capture.drive": (capture.drive, {"period": 1}),
        "Capture.drives": (capture.drives, {"first": 0, "last": 2}),
        "ControlPoints": (pw.ControlPoints, {"positions": two, "amplitudes": [1.0, 0.5]}),
        "ControlPoints.sample": (pw.ControlPoints(two).sample, {"spacing": 0.01}),
        "Cycle": (pw.Cycle, {"drives": waves[:2], "hold": 2, "envelope": 0.0, "carrier": 40e3}),
        "Cycle.expanded": (cycle.expanded, {"periods": 8}),
        "Device.end_modulation": (_on_a_device("end_modulation"), {"period": 0}),
        "Device.identify": (_on_a_device("identify"), {"board": 0}),
        "Device.modulate": (_on_a_device("modulate"), {"samples": b"12", "hold": 1, "period": 0}),
        "Device.play": (_on_a_device("play"), {"steps": [(0, 1)], "repeats": 0, "unattended": False, "period": 0}),
        "Device.set_drive_limit": (_on_a_device("set_drive_limit"), {"transducers": 9}),
        "Device.set_watchdog": (_on_a_device("set_watchdog"), {"seconds": 1.0}),
        "Device.show": (_on_a_device("show"), {"frame": pulses, "period": 0}),
        "Device.silence": (_on_a_device("silence"), {"period": 0}),
        "Device.store": (_on_a_device("store"), {"slot": 1, "frame": pulses}),
        "Device.stream": (
            _on_a_device("stream"),
            {"source": [pulses], "rate": 100.0, "look_ahead": 0.01, "reconnect": False},
        ),
        "Emulator.run": (lambda periods: _emulated().run(periods), {"periods": 1}),
        "Emulator.run_until": (lambda period: _emulated().run_until(period), {"period": 5}),
        "Grid": (pw.Grid, {"centre": high, "axes": eye[:2], "counts": (3, 3), "step": 0.01}),
        "Grid.along": (pw.Grid.along, {"letters": "xy", "centre": high, "extent": 0.02, "step": 0.005}),
        "Grid.spanning": (pw.Grid.spanning, {"centre": high, "axes": eye[:2], "extents": [0.02, 0.02], "step": 0.005}),
        "Grid.horizontal": (pw.Grid.horizontal, {"height": 0.1, "extent": 0.02, "step": 0.005}),
        "Grid.coordinates": (plane.coordinates, {"axis": 1}),
        "Grid.offsets": (plane.offsets, {"axis": 1}),
        "Hand": (pw.Hand, {"landmarks": hand.landmarks, "widths": hand.widths}),
        "Hand.repaired": (pw.Hand.repaired, {"landmarks": hand.landmarks, "widths": hand.widths}),
        "Hand.flat": _with_defaults(pw.Hand.flat),
        "Hand.moved": (hand.moved, {"offset": (0.0, 0.0, 0.01)}),
        "Hand.rotated": (hand.rotated, {"degrees": 10.0, "axis": (0.0, 0.0, 1.0)}),
        "Mesh": (pw.Mesh, {"solid": cube.solid, "rotation": eye, "offset": (0.0, 0.0, 0.1)}),
        "Mesh.of": (pw.Mesh.of, {"vertices": cube.vertices, "faces": cube.faces}),
        "Mesh.moved": (cube.moved, {"offset": (0.0, 0.0, 0.01)}),
        "Mesh.rotated": (cube.rotated, {"degrees": 10.0, "axis": (0.0, 0.0, 1.0)}),
        "Mesh.repaired": (cube.repaired, {"may_be_open": False}),
        "Mesh.scaled": (cube.scaled, {"factor": 0.5}),
        "Modulation": (
            pw.Modulation,
            {"drives": [drive], "weights": [[1.0], [0.0]], "frequency": 200.0, "carrier": 4e4},
        ),
        "Modulation.on_off": (pw.Modulation.on_off, {"drive": drive, "frequency": 200.0, "carrier": 4e4}),
        "Modulation.sampled": (
            pw.Modulation.sampled,
            {"drive": drive, "envelope": [1.0, 0.5], "frequency": 200.0, "carrier": 4e4},
        ),
        "Modulation.sine": (
            pw.Modulation.sine,
            {"drive": drive, "frequency": 200.0, "depth": 1.0, "samples": 50, "carrier": 4e4},
        ),
        "Modulation.two_sided": (
            pw.Modulation.two_sided,
            {"first": drive, "second": drive, "frequency": 200.0, "carrier": 4e4},
        ),
        "Outline.of": (pw.Outline.of, {"what": two}),
        "Outline.round_trip": (walk.round_trip, {"speed": 7.0, "pause": 0.0, "back": True}),
        "Outline.walk": (walk.walk, {"count": 8, "speed": 7.0, "pause": 0.0, "back": True}),
        "PlaneField": (pw.PlaneField, {"grid": plane, "pressure": np.zeros(plane.shape, complex), "medium": air}),
        "VolumeField": (
            pw.VolumeField,
            {"grid": pw.Grid(high, eye, (3, 3, 3), 0.01), "pressure": np.zeros((3, 3, 3), complex), "medium": air},
        ),
        "PlanePropagator": (pw.PlanePropagator, {"array": grid, "height": 0.1, "extent": 0.03, "per_pitch": 2}),
        "PlanePropagator.__call__": (pw.PlanePropagator(grid, 0.1, 0.03, 2), {"drive": drive}),
        "Pose": (pw.Pose, {"rotation": eye, "translation": np.zeros(3), "scale": 1.0}),
        "Pose.estimate": (pw.Pose.estimate, {"seen": hand.landmarks, "true": hand.landmarks}),
        "PulseFrames.pulses": (quads.pulses, {"number": 1}),
        "Pulses": (pw.Pulses, {"phase": [0, 2], "width": [2, 4]}),
        "Pulses.from_drive": (pw.Pulses.from_drive, {"drive": drive}),
        "Pulses.modulated": (pulses.modulated, {"sample": 5}),
        "Pulses.silent": (pw.Pulses.silent, {"n": 4}),
        "Renderer": (pw.Renderer, {"array": grid, "most_frames": 16}),
        "Renderer.render": (pw.Renderer(grid, "am").render, {"what": two}),
        "render": (pw.render, {"array": grid, "what": two, "way": "am"}),
        "Solver.follow": (pw.Solver(grid).follow, {"positions": [two], "amplitudes": [1.0, 1.0], "ids": [0, 1]}),
        "Solver.solve": (lambda **all: pw.Solver(grid).solve(**all), {"points": two, "ids": [0, 1]}),
        "TransducerArray": (
            pw.TransducerArray,
            {"positions": two, "normals": eye[[2, 2]], "response": [1, 1], "limits": [1, 1]},
        ),
        "TransducerArray.calibrated": (grid.calibrated, {"response": ones, "limits": ones}),
        "TransducerArray.grid": (pw.TransducerArray.grid, {"columns": 4, "rows": 4, "pitch": 0.01}),
        "TransducerArray.placed": (grid.placed, {"rotation": eye, "translation": high}),
        "TwoSidedSolver": (pw.TwoSidedSolver, {"array": grid, "frequency": 200.0}),
        "TwoSidedSolver.solve": (lambda **all: pw.TwoSidedSolver(grid).solve(**all), {"points": two, "ids": [0, 1]}),
        "View.update": (lambda drive, points: (_drives(drive, 16), _points(points)), {"drive": drive, "points": two}),
        "Wiring": (pw.Wiring, {"channels": np.arange(320)}),
        "Wiring.pin": (pw.Wiring.strips().pin, {"transducer": 3}),
        "Pin.of": (protocol.Pin.of, {"channel": 3}),
        "focus_report": (pw.focus_report, {**steady, "points": two, "grid": plane}),
        "intensity": (pw.intensity, {"pressure": [1.0]}),
        "pressure": (pw.pressure, {**steady, "at": two}),
        "radiation_pressure": (pw.radiation_pressure, {"pressure": [1.0], "reflection": 2.0}),
        "read_volume_mesh": (
            pw.read_volume_mesh,
            {"path": Path("none.npy"), "level": 1.0, "spacing": 0.001, "step": 1},
        ),
        "relative_level": (pw.relative_level, {"pressure": [1.0], "reference": 1.0}),
        "sample_cut": (pw.sample_cut, {**steady, "grid": plane}),
        "sample_plane": (pw.sample_plane, {**steady, "height": 0.1, "extent": 0.02, "step": 0.005}),
        "sample_volume": (pw.sample_volume, {**steady, "grid": pw.Grid(high, eye, (3, 3, 3), 0.01)}),
        "sine": (pw.sine, {"frequency": 200.0, "depth": 1.0, "phase": 0.0, "force": False}),
        "read_envelope": (host.read_envelope, {"path": Path("none.wav"), "force": False}),
        "solve": (pw.solve, {"array": grid, "points": two}),
        "solve_frames": (pw.solve_frames, {"array": grid, "frames": [two], "workers": 1}),
        "sound_pressure_level": (pw.sound_pressure_level, {"pressure": [1.0]}),
        "Toucher.touch": (pw.Toucher().touch, {"hands": hand, "objects": cube, "time": 0.0}),
        "touch": (pw.touch, {"hands": hand, "objects": cube, "spacing": 0.015, "corners": True, "most_points": 8}),
        "two_sided": (pw.two_sided, {"array": grid, "points": two, "frequency": 200.0}),
        "Aperture": (solver.Aperture, {"image": np.ones((3, 3)), "pixel": 1e-3}),
        "Aperture.disc": (solver.Aperture.disc, {"radius": 4e-3, "pixel": 1e-3}),
        "Aperture.from_image": (solver.Aperture.from_image, {"path": Path("none.npy"), "width": 0.01}),
        "Oil.surface": (solver.Oil().surface, {"push": np.ones((3, 3)), "step": 0.01}),
        "Quieting": (solver.Quieting, {"transducers": 4, "rule": solver.Rates()}),
        "Quieting.follow": (lambda **all: solver.Quieting(16, solver.Rates()).follow(**all), {"wanted": waves[:4]}),
        "ResidualTable.of": (solver.ResidualTable.of, {"transducer": pw.Transducer(model="rayleigh"), "nearest": 0.05}),
        "Resonator.enveloped": (solver.Resonator().enveloped, {"carrier": 4e4, "step": 1e-6}),
        "Resonator.response": (solver.Resonator().response, {"frequency": 4e4}),
        "Resonator.sampled": (solver.Resonator().sampled, {"step": 1e-6}),
        "intensity_component": (
            solver.intensity_component,
            {"array": grid, "modulation": sine, "at": two, "harmonic": 1},
        ),
        "residual": (solver.residual, {"transducer": pw.Transducer(), "sine": [0.1], "distance": [0.2]}),
        "slice_field": (solver.slice_field, {"aperture": solver.Aperture.disc(4e-3, 4e-3), "z": 0.05, "extent": 0.02}),
        "split": (solver.split, {"points": pw.ControlPoints(two), "ids": [0, 1]}),
        "transfer_matrix": (solver.transfer_matrix, {"array": grid, "at": two}),
        "AmplitudeModulation": (protocol.AmplitudeModulation, {"first": 0, "count": 4, "hold": 1, "period": 0}),
        "Entries": (protocol.Entries, {"entries": (protocol.Entry(0, 1),), "first": 0}),
        "Output": (protocol.Output, {"action": protocol.Action.SILENCE, "period": 0}),
        "PlaySequence": (
            protocol.PlaySequence,
            {"first": 0, "count": 1, "period": 0, "repeats": 0, "unattended": False},
        ),
        "Samples": (protocol.Samples, {"samples": b"12", "first": 0}),
        "Slot": (protocol.Slot, {"number": 1, "pulses": pulses}),
        "Update": (protocol.Update, {"pulses": pulses, "period": 0}),
        "pack_updates": (
            protocol.pack_updates,
            {"phase": frames, "width": frames, "sequence": 1, "period": 0, "restart": False, "out": None},
        ),
        "quantise": (protocol.quantise, {"drives": drive[None], "first": 0}),
        "unpack_updates": (protocol.unpack_updates, {"blocks": np.zeros((1, 512), np.uint8)}),
        "Audible.strongest": (sound.strongest, {"place": 0, "count": 3}),
        "Exposure.gain": (loud.gain, {"limit_db": 100.0}),
        "FeltMap.intensity_over_time": (felt.intensity_over_time, {"window": 0.005}),
        "Skin.response": (feel.Skin().response, {"wavenumber": [10.0], "frequency": [100.0]}),
        "Unfolded.of": (feel.Unfolded.of, {"hand": hand, "spacing": 0.01}),
        "a_weighting": (feel.a_weighting, {"frequency": [100.0]}),
        "audible": (feel.audible, {"array": grid, "waves": waves, "pulses": waves * 0, "at": two, "reach": 0.2}),
        "exposure_at": (feel.exposure_at, {"array": grid, "waves": waves[:4], "at": two}),
        "exposure_limit": (feel.exposure_limit, {"array": grid, "at": two, "limit_db": 100.0}),
        "feel": (feel.feel, {"array": grid, "waves": waves, "places": patch, "every": 10}),
        "felt_map": (feel.felt_map, {"pressures": np.zeros((40, 36)), "places": patch, "rate": 4000.0}),
        "radiated_power": (feel.radiated_power, {"array": grid, "waves": waves[:4], "supply_v": 15.0}),
        "radiation_pressures": (
            feel.radiation_pressures,
            {"array": grid, "waves": waves, "places": patch, "every": 10},
        ),
        "warming": (feel.warming, {"peak": 10.0, "seconds": 1.0}),
        "Playback.intensity_component": (
            playback.intensity_component,
            {"at": two, "frequency": 40_000.0, "first": 0, "last": 2},
        ),
        "Playback.phasors": (playback.phasors, {"at": two, "first": 0, "last": 2}),
        "Playback.signal": (playback.signal, {"at": two, "start": 0, "stop": 50}),
        "Playback.voltages": (playback.voltages, {"start": 0, "stop": 50}),
        "emitted_waves": (
            hil.emitted_waves,
            {"capture": capture, "array": pw.TransducerArray.grid(), "first": 0, "last": 2},
        ),
    }
    return calls


def _numbers(kind: Any) -> dict[str, str]:
    """The annotations of those parameters that are numbers."""
    try:
        known = inspect.signature(kind).parameters.values()
    except (TypeError, ValueError):
        return {}
    return {
        each.name: str(each.annotation)
        for each in known
        if NUMBER.search(str(each.annotation)) and not re.search("Callable|str . int", str(each.annotation))
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
CASES = [(name, parameter) for name in PUBLIC for parameter in PUBLIC[name]]


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
    assert name in _calls(), f"{name} has numbers, but no arguments in the table"
    call, values = _calls()[name]
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
