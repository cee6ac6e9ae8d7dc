"""A design: an array, how it is solved for, and the errors between what is solved for and what is built."""

from __future__ import annotations

import dataclasses
import math
import reprlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from numbers import Integral, Real
from typing import Any, Self, get_args

from ...base.arguments import spelt
from ...protocol.board import COLUMNS, PITCH_M, ROWS
from ...solver import TransducerArray
from ...solver.acoustics.transducer import MODELS, TRANSDUCERS
from ...solver.methods.methods import options_of
from ...solver.methods.options import Options, Output, Phases

__all__ = ["FIELDS", "OPTIONS", "UNITS", "Design"]

EXACT, PULSES = "none", "pulses"
LEAST_LEVELS, MOST_LEVELS = 2, 4096
OPTIONS = tuple(field.name for field in dataclasses.fields(Options) if field.name != "phase_seconds")
"""Options of methods that a design may set: all but a time limit, with which results would depend on the machine."""
UNITS = {
    "pitch_mm": "mm",
    "tolerance_mm": "mm",
    "temperature_c": "°C",
    "assumed_c": "°C",
    "gain_error_db": "dB",
    "phase_error_deg": "degrees",
    "modulation_hz": "Hz",
}
"""Units of fields; the others have none."""
RANGES: dict[str, tuple[float, float]] = {
    "columns": (1, 100),
    "rows": (1, 100),
    "pitch_mm": (1, 100),
    "tolerance_mm": (0, 5),
    "temperature_c": (-20, 60),
    "assumed_c": (-20, 60),
    "gain_error_db": (0, 6),
    "phase_error_deg": (0, 360),
    "modulation_hz": (50, 800),
    "seed": (0, 2**32 - 1),
}
CHOICES: dict[str, tuple[str, ...]] = {
    "transducer": tuple(TRANSDUCERS),
    "model": MODELS,
    "phases": get_args(Phases),
    "output": get_args(Output),
}


@dataclass(frozen=True, kw_only=True)
class Design:
    """One row of a sweep. Fields are also the keys of a sweep's file, and the columns of its results.

    Parameters
    ----------
    source : str
        What the field is for: a shape in its notation, or the name of a file of points.
    columns, rows : int
        Transducers along x and along y, 1 to 100 each.
    pitch_mm : float
        Distance between neighbours, 1 to 100 mm.
    transducer, model : str
        Keys of `TRANSDUCERS` and `MODELS`.
    method : str
        A key of `METHODS`.
    gamma, mu, phases, phase_steps, steps, sweeps, levels, output : optional
        Options of the method, see `Options`.
    quantisation : str
        What the drives are rounded to: ``none``, ``pulses`` as the boards have them, or a number of phases in a turn
        with magnitudes as they are, ``2`` to ``4096``.
    tolerance_mm : float
        Standard deviation of each coordinate of a transducer's place, 0 to 5 mm. The solver does not know it.
    temperature_c, assumed_c : float
        The temperature of the air, and what the solver takes it for, −20 to 60 °C.
    gain_error_db, phase_error_deg : float
        Standard deviation of each transducer's gain and phase after calibration, up to 6 dB and 360 degrees. The solver
        does not know it.
    modulation_hz : float
        Frequency of the modulation that is heard, 50 to 800 Hz.
    seed : int
        The seed of the errors. Designs with the same seed and number of transducers have the same errors, each times
        its standard deviation: so designs differ by what was designed, not by chance. Several seeds show the chance.

    Raises
    ------
    ValueError
        If values are out of range; it names all of them.
    """

    source: str
    columns: int = COLUMNS
    rows: int = ROWS
    pitch_mm: float = PITCH_M * 1e3
    transducer: str = "MA40S4S"
    model: str = "piston"
    method: str = "wgs"
    gamma: float | None = None
    mu: float | None = None
    phases: str | None = None
    phase_steps: int | None = None
    steps: int | None = None
    sweeps: int | None = None
    levels: int | None = None
    output: str | None = None
    quantisation: str = EXACT
    tolerance_mm: float = 0.0
    temperature_c: float = 20.0
    assumed_c: float = 20.0
    gain_error_db: float = 0.0
    phase_error_deg: float = 0.0
    modulation_hz: float = 200.0
    seed: int = 0

    def __post_init__(self) -> None:
        """Read each value as its field's kind, and check the ranges."""
        problems: dict[str, str] = {}
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if value is not None or field.default is not None:
                try:
                    object.__setattr__(self, field.name, _read(field.name, value))
                except ValueError as error:
                    problems[field.name] = str(error)
        problems = dict(self._out_of_range()) | problems
        if "method" not in problems and not problems.keys() & set(OPTIONS):
            try:
                options_of(self.method, self.options)
            except ValueError as error:
                problems["method"] = str(error)
        if problems:
            raise ValueError("; ".join(problems.values()))

    def _out_of_range(self) -> Iterator[tuple[str, str]]:
        """The fields with a value out of range, and what is wrong."""
        for name, (least, most) in RANGES.items():
            value = getattr(self, name)
            if isinstance(value, (int, float)) and not least <= value <= most:
                unit = f" {UNITS[name]}" if name in UNITS else ""
                yield name, f"{name} is {_short(value)}{unit}; it must be from {least} to {most}{unit}"
        for name, known in CHOICES.items():
            if (chosen := getattr(self, name)) is not None and chosen not in known:
                yield name, f"{name} is {_short(chosen)}; it must be one of {', '.join(known)}"
        if self.quantisation not in (EXACT, PULSES) and not LEAST_LEVELS <= (self.phase_levels or 0) <= MOST_LEVELS:
            yield (
                "quantisation",
                f"quantisation is {_short(self.quantisation)}; it must be {EXACT}, {PULSES} or a whole number of "
                f"phases from {LEAST_LEVELS} to {MOST_LEVELS}",
            )

    @classmethod
    def read(cls, values: Mapping[str, object]) -> Self:
        """A design from the values of a file, or from texts.

        Raises `ValueError` if a field is unknown or missing, or a value is of the wrong kind or out of range; it names
        all that are.
        """
        known: dict[str, Any] = {"source": None} | {name: value for name, value in values.items() if name in FIELDS}
        problems = [
            f"there is no field {_short(name)}; the fields are {', '.join(FIELDS)}"
            for name in values
            if name not in FIELDS
        ]
        try:
            design = cls(**known)
        except ValueError as error:
            problems.append(str(error))
        if problems:
            raise ValueError("; ".join(problems))
        return design

    @property
    def options(self) -> dict[str, Any]:
        """The options of the method that are set."""
        return {name: value for name in OPTIONS if (value := getattr(self, name)) is not None}

    @property
    def phase_levels(self) -> int | None:
        """Phases in a turn to which drives are rounded, if they are rounded to phases."""
        text = str(self.quantisation)
        return int(text) if text.isascii() and text.isdigit() else None

    def array(self) -> TransducerArray:
        """The array as the solver takes it, without errors."""
        part = dataclasses.replace(TRANSDUCERS[self.transducer], model=self.model)
        return TransducerArray.grid(self.columns, self.rows, self.pitch_mm * 1e-3, part)


FIELDS: dict[str, str] = {field.name: str(field.type).removesuffix(" | None") for field in dataclasses.fields(Design)}
"""The kind of each field: ``int``, ``float`` or ``str``."""
_WANTED = {"int": "a whole number", "float": "a finite number", "str": "text"}


def _read(name: str, value: Any) -> Any:
    """A value as the kind of its field; a number of a table comes as text."""
    kind = FIELDS[name]
    try:
        match kind, value:
            case _, bool():
                pass
            case "str", str():
                return value
            case "str", Integral() if name == "quantisation":
                return str(value)
            case "int", str() if value.isascii() and "_" not in value:
                return int(value)
            case "int", Integral() | float() if value == (whole := int(value)):
                return whole
            case "float", str() | Real():
                number = spelt(value) if isinstance(value, str) else float(value)
                if math.isfinite(number):
                    return number
    except (ValueError, OverflowError):
        pass
    wanted = "a shape such as circle:radius=0.03, or a file of points" if name == "source" else _WANTED[kind]
    raise ValueError(f"{name} is {_short(value)}; it must be {wanted}")


def _short(value: object) -> str:
    """A value for a message, not too long."""
    return "missing" if value is None else reprlib.repr(value)
