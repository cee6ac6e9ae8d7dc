"""Arguments at the public border: each becomes a plain number or array within its range, or a clear `ValueError`.

Public functions convert what they are given here, once; what they call trusts its numbers. So NumPy's small integers
do not wrap, a numeral in quotes is no number, and NaN, infinity and integers that no float holds go no further. An
error names the argument, its value and what would be right.

This module stands below every other one and may import none of them.
"""

from __future__ import annotations

import math
import operator
import reprlib
from numbers import Complex, Real
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "FARTHEST",
    "HIGHEST",
    "WIDEST",
    "array_of",
    "as_drives",
    "as_frequencies",
    "as_single",
    "celsius",
    "check_drives",
    "flag",
    "instance_of",
    "length",
    "real",
    "shown",
    "spelt",
    "stretch",
    "whole",
]

FARTHEST = 10.0
"""Largest coordinate in metres: an array reaches half a metre, and what is farther was written in millimetres."""
WIDEST = 5.0
"""Largest size in metres of an array, a shape or a plane."""
COLDEST, WARMEST = -50.0, 60.0
"""Of the air, in °C: for what lies beyond, the formulas of the air claim nothing."""
MAGNITUDE_TOLERANCE = 1e-6
"""By how much normalising in single precision may exceed full drive."""

HIGHEST = 1e9
"""Of a frequency, in hertz; air carries no sound of that pitch."""

Kind = TypeVar("Kind")
Scalar = TypeVar("Scalar", bound=np.generic)


def shown(value: object) -> str:
    """A value for an error: its `repr`, cut short."""
    try:
        return reprlib.repr(value.item() if isinstance(value, np.generic) else value)
    except ValueError:  # of an integer with more digits than Python writes
        return "an endless number"


def instance_of(value: object, kind: type[Kind], what: str, hint: str) -> Kind:
    """The value; `ValueError` if it is of another kind. ``hint`` ends the message, as in "such as Circle()"."""
    if not isinstance(value, kind):
        raise ValueError(f"{what} is {shown(value)}; it must be a {kind.__name__}, {hint}")
    return value


def real(
    name: str,
    value: Any,
    least: float = -math.inf,
    most: float = math.inf,
    unit: str = "",
    *,
    above: bool = False,
    hint: str = "",
) -> float:
    """A finite real number in a range, as a float.

    Parameters
    ----------
    name : str
        The argument's name, for the error.
    value : Any
        The value as it was given.
    least, most : float
        The range; both ends belong to it.
    unit : str
        The unit that the error shows.
    above : bool
        Whether ``least`` does not belong to the range.
    hint : str
        Ends the error.

    Raises
    ------
    ValueError
        If it is no real number, not finite, or outside.
    """
    given = value[()] if isinstance(value, np.ndarray) and value.ndim == 0 else value
    if not isinstance(given, Real) or isinstance(given, (bool, np.bool_)):
        raise ValueError(f"{name} {shown(value)} must be a number{f' of {unit}' if unit else ''}{hint}")
    number = _number(given)
    if not (least <= number <= most and math.isfinite(number)) or (above and number == least):
        units = f" {unit}" if unit else ""
        raise ValueError(f"{name} {shown(given)}{units} must be {_range(least, most, above, units)}{hint}")
    return number


def _range(least: float, most: float, above: bool, units: str) -> str:
    low = "positive" if above and least == 0 else f"above {least:g}{units}" if above else f"at least {least:g}{units}"
    if least == -math.inf:
        return "finite" if most == math.inf else f"finite and at most {most:g}{units}"
    if most == math.inf:
        return f"{low} and finite"
    return f"{low} and at most {most:g}{units}" if above else f"from {least:g} to {most:g}{units}"


def whole(name: str, value: Any, least: int, most: int) -> int:
    """A whole number from `least` to `most`, as an int.

    Raises
    ------
    ValueError
        If it is no whole number, or outside.
    """
    number = value if type(value) is int else _index(value)
    if number is None or not least <= number <= most:
        raise ValueError(f"{name} {shown(value)} must be a whole number from {least} to {most}")
    return number


def _index(value: Any) -> int | None:
    try:
        return None if isinstance(value, (bool, np.bool_)) else operator.index(value)
    except TypeError:
        return None


def stretch(unit: str, names: tuple[str, str], start: Any, stop: Any, begin: int, end: int) -> tuple[int, int]:
    """The bounds of a stretch of what was captured from ``begin`` to ``end``, in ticks or periods.

    Raises
    ------
    ValueError
        If a bound is no whole number, or they are in the wrong order or outside.
    """
    start, stop = (whole(name, value, -(2**63), 2**63 - 1) for name, value in zip(names, (start, stop), strict=True))
    if not begin <= start <= stop <= end:
        raise ValueError(f"{unit} {start} to {stop} are not within the captured {begin} to {end}")
    return start, stop


def length(name: str, value: Any, most: float = WIDEST, *, least: float = 0.0, above: bool = True) -> float:
    """A length in metres, by default positive; errors as `real`, with a hint if it looks like millimetres."""
    try:
        return real(name, value, least, most, "m", above=above)
    except ValueError as error:
        number = _number(value)
        looks = (
            f"; lengths are in metres: {number:g} mm is {number / 1000:g}" if most < abs(number) <= 1000 * most else ""
        )
        raise ValueError(f"{error}{looks}") from None


def celsius(name: str, value: Any) -> float:
    """A temperature of air in °C; errors as `real`, with a hint if it looks like another scale."""
    try:
        return real(name, value, COLDEST, WARMEST, "°C")
    except ValueError as error:
        number = _number(value)
        looks = ""
        if COLDEST + 273.15 <= number <= WARMEST + 273.15:
            looks = f"; it looks like kelvin: {number:g} K is {number - 273.15:.4g} °C"
        elif WARMEST < number <= WARMEST * 1.8 + 32:
            looks = f"; it looks like fahrenheit: {number:g} °F is {(number - 32) / 1.8:.4g} °C"
        raise ValueError(f"{error}{looks}") from None


def _number(value: Any) -> float:
    """A value as a float; NaN if it is no number, or an integer that no float holds."""
    try:
        return float(value) if isinstance(value, Real) else math.nan
    except OverflowError:
        return math.nan


def flag(name: str, value: Any) -> bool:
    """True or False, as a bool; `ValueError` if it is anything else."""
    if not isinstance(value, (bool, np.bool_)):
        raise ValueError(f"{name} is {shown(value)}; it must be True or False")
    return bool(value)


def spelt(text: str) -> float:
    """The number that a cell of a text file or an argument of the command line spells; `ValueError` if it spells none.

    Python's ``float`` takes ``0_1`` for 1, and digits of other scripts.
    """
    if "_" in text or not text.isascii():
        raise ValueError(f"{text!r} is no number")
    return float(text)


def array_of(name: str, values: ArrayLike, dtype: type[Scalar]) -> NDArray[Scalar]:
    """Numbers as an array of their own, C-contiguous; that they are finite is not checked.

    Raises
    ------
    ValueError
        If they are no numbers, rows differ in length, or one does not fit the type.
    """
    try:
        given = np.asarray(values)
        if given.dtype == object and not all(isinstance(each, Complex) for each in given.flat):
            bad = next(each for each in given.flat if not isinstance(each, Complex))
            raise ValueError(f"{shown(bad)} is no number")
        allowed = "biufcO" if issubclass(dtype, np.complexfloating) else "biufO"
        if given.dtype.kind not in (allowed if issubclass(dtype, np.inexact) else "iuO"):
            kinds = {"c": "complex", "U": "text", "S": "text", "f": "not whole"}
            raise ValueError(f"they are {kinds.get(given.dtype.kind, given.dtype.name)}")
        with np.errstate(over="ignore"):
            return np.array(given, dtype, order="C")
    except (TypeError, ValueError, OverflowError) as error:
        kind = "whole numbers" if issubclass(dtype, np.integer) else "numbers"
        raise ValueError(f"{name} must be {kind}: {error}") from None


def as_frequencies(frequency: ArrayLike, *, above: bool = False) -> NDArray[np.float64]:
    """Frequencies in hertz, from 0 or above it to `HIGHEST`; `ValueError` if one is outside."""
    read = array_of("frequency", frequency, np.float64)
    if read.size and not (read.min() >= 0 and read.max() <= HIGHEST and (read.min() or not above)):
        inside = (read > 0 if above else read >= 0) & (read <= HIGHEST)
        bad = read.flat[int(np.argmin(inside))]
        raise ValueError(f"frequency {bad} Hz must be {_range(0, HIGHEST, above, ' Hz')}")
    return read


def as_drives(drives: ArrayLike) -> NDArray[np.complex128]:
    """Drives as complex numbers, of magnitude at most 1; errors as `check_drives`, or if they are no numbers."""
    read = array_of("drives", drives, np.complex128)
    check_drives(read)
    return read


def as_single(drives: ArrayLike) -> NDArray[np.complex64]:
    """The same in single precision; drives that have it already are not copied."""
    if isinstance(drives, np.ndarray) and drives.dtype == np.complex64:
        check_drives(drives)
        return drives
    return as_drives(drives).astype(np.complex64)


def check_drives(drives: NDArray[np.complexfloating], first: int = 0) -> None:
    """Raise `ValueError` if a drive is not finite or its magnitude exceeds 1; the transducer is named.

    Parameters
    ----------
    drives : (n,) or (k, n) complex
        One frame, or k of them; then the frame is named too.
    first : int
        Number of the first of these frames.
    """
    if np.abs(drives).max(initial=0) <= 1:  # false if one is not a number
        return
    drives = drives.astype(np.complex128)
    magnitudes = np.abs(drives)
    for wrong, complaint in (
        (~np.isfinite(drives), "is {drive}; it must be finite"),
        (magnitudes > 1 + MAGNITUDE_TOLERANCE, "has magnitude {magnitude:.6g}; at most 1 is possible"),
    ):
        if wrong.any():
            *frame, transducer = at = tuple(np.argwhere(wrong)[0])
            where = f"transducer {transducer}" + (f" of frame {first + frame[0]}" if frame else "")
            raise ValueError(f"drive of {where} " + complaint.format(drive=drives[at], magnitude=magnitudes[at]))
