"""What the array should emit so that a shape can be felt.

This room knows the air, transducers and their field, control points, shapes and the solvers that turn points into
complex drives. It knows nothing of ticks, packets or devices.
"""

from __future__ import annotations

from .aperture import Aperture
from .array import TransducerArray
from .convolution import PlanePropagator
from .field import PlaneField, VolumeField, sample_cut, sample_plane, sample_volume
from .focus import FocusReport, focus_report
from .grid import Grid
from .medium import Medium
from .models import residual
from .modulation import Modulation, intensity_component
from .options import METHODS, Options
from .points import ControlPoints
from .propagation import pressure, transfer_matrix
from .shapes import Asterisk, Circle, Concentric, Polygon, Polyline, Rings, Shape, Sphere, Star, parse_shape
from .slices import slice_field
from .solve import Solution, Solver, solve, solve_frames
from .split import Split, split
from .table import ResidualTable
from .transducer import MODELS, TRANSDUCERS, Transducer
from .two_sided import Gain, TwoSided, TwoSidedSolver, two_sided

__all__ = [
    "METHODS",
    "MODELS",
    "TRANSDUCERS",
    "Aperture",
    "Asterisk",
    "Circle",
    "Concentric",
    "ControlPoints",
    "FocusReport",
    "Gain",
    "Grid",
    "Medium",
    "Modulation",
    "Options",
    "PlaneField",
    "PlanePropagator",
    "Polygon",
    "Polyline",
    "ResidualTable",
    "Rings",
    "Shape",
    "Solution",
    "Solver",
    "Sphere",
    "Split",
    "Star",
    "Transducer",
    "TransducerArray",
    "TwoSided",
    "TwoSidedSolver",
    "VolumeField",
    "focus_report",
    "intensity_component",
    "parse_shape",
    "pressure",
    "residual",
    "sample_cut",
    "sample_plane",
    "sample_volume",
    "slice_field",
    "solve",
    "solve_frames",
    "split",
    "transfer_matrix",
    "two_sided",
]
