"""What the array should emit so that a shape can be felt.

This room knows the air, transducers and their field, control points, shapes and the solvers that turn points into
complex drives. It knows nothing of ticks, packets or devices.
"""

from __future__ import annotations

from .aperture import Aperture
from .array import TransducerArray
from .contact.hand import Hand
from .contact.mesh import Mesh
from .contact.touch import Touch, Toucher, touch
from .convolution import PlanePropagator
from .diffraction import KERNELS
from .field import Field, PlaneField, VolumeField, sample_cut, sample_plane, sample_volume
from .files import load_field, load_solution, read_points, save_field, save_solution
from .focus import Focus, FocusReport, Lobe, Null, focus_report
from .grid import Grid
from .medium import Medium
from .models import residual
from .modulation import Modulation, intensity_component
from .oil import Oil, oil_surface
from .options import METHODS, Options
from .picture import save_field_picture
from .points import ControlPoints
from .propagation import pressure, transfer_matrix
from .quantities import QUANTITIES, air_density, intensity, radiation_pressure, relative_level, sound_pressure_level
from .resonator import Resonator
from .shapes import Asterisk, Circle, Concentric, Polygon, Polyline, Rings, Shape, Sphere, Star, parse_shape
from .slices import slice_field
from .solve import Solution, Solver, solve, solve_frames
from .split import Split, split
from .table import ResidualTable
from .transducer import MODELS, TRANSDUCERS, Transducer
from .two_sided import Gain, TwoSided, TwoSidedSolver, two_sided
from .vti import save_vti

__all__ = [
    "KERNELS",
    "METHODS",
    "MODELS",
    "QUANTITIES",
    "TRANSDUCERS",
    "Aperture",
    "Asterisk",
    "Circle",
    "Concentric",
    "ControlPoints",
    "Field",
    "Focus",
    "FocusReport",
    "Gain",
    "Grid",
    "Hand",
    "Lobe",
    "Medium",
    "Mesh",
    "Modulation",
    "Null",
    "Oil",
    "Options",
    "PlaneField",
    "PlanePropagator",
    "Polygon",
    "Polyline",
    "ResidualTable",
    "Resonator",
    "Rings",
    "Shape",
    "Solution",
    "Solver",
    "Sphere",
    "Split",
    "Star",
    "Touch",
    "Toucher",
    "Transducer",
    "TransducerArray",
    "TwoSided",
    "TwoSidedSolver",
    "VolumeField",
    "air_density",
    "focus_report",
    "intensity",
    "intensity_component",
    "load_field",
    "load_solution",
    "oil_surface",
    "parse_shape",
    "pressure",
    "radiation_pressure",
    "read_points",
    "relative_level",
    "residual",
    "sample_cut",
    "sample_plane",
    "sample_volume",
    "save_field",
    "save_field_picture",
    "save_solution",
    "save_vti",
    "slice_field",
    "solve",
    "solve_frames",
    "sound_pressure_level",
    "split",
    "touch",
    "transfer_matrix",
    "two_sided",
]
