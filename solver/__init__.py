"""What the array should emit so that a shape can be felt.

This room knows the air, transducers and their field, control points, shapes and the solvers that turn points into
complex drives. It knows nothing of ticks, packets or devices.
"""

from __future__ import annotations

from .array import Transducer, TransducerArray
from .field import PlaneField, sample_plane
from .medium import Medium
from .modulation import Modulation, intensity_component
from .points import ControlPoints
from .propagation import pressure, transfer_matrix
from .shapes import Asterisk, Circle, Concentric, Polygon, Polyline, Rings, Shape, Sphere, Star, parse_shape
from .solve import METHODS, Solution, solve
from .split import Split, split
from .two_sided import Gain, TwoSided, two_sided

__all__ = [
    "METHODS",
    "Asterisk",
    "Circle",
    "Concentric",
    "ControlPoints",
    "Gain",
    "Medium",
    "Modulation",
    "PlaneField",
    "Polygon",
    "Polyline",
    "Rings",
    "Shape",
    "Solution",
    "Sphere",
    "Split",
    "Star",
    "Transducer",
    "TransducerArray",
    "TwoSided",
    "intensity_component",
    "parse_shape",
    "pressure",
    "sample_plane",
    "solve",
    "split",
    "transfer_matrix",
    "two_sided",
]
