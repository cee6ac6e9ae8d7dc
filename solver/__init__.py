"""What the array should emit so that a shape can be felt.

This room knows the air, transducers and their field, control points, shapes and the solvers that turn points into
complex drives. It knows nothing of ticks, packets or devices.
"""

from __future__ import annotations

from .acoustics.aperture import Aperture
from .acoustics.array import TransducerArray
from .acoustics.array_files import read_transducers
from .acoustics.diffraction import KERNELS
from .acoustics.medium import Medium
from .acoustics.models import residual
from .acoustics.propagation import pressure, transfer_matrix
from .acoustics.residual_table import ResidualTable
from .acoustics.resonator import Resonator
from .acoustics.slices import slice_field
from .acoustics.transducer import MODELS, TRANSDUCERS, Transducer
from .contact.hand import Hand
from .contact.mesh import Mesh
from .contact.touch import Touch, Toucher, touch
from .fields.convolution import PlanePropagator
from .fields.field import Field, PlaneField, VolumeField, sample_cut, sample_plane, sample_volume
from .fields.files import load_field, load_solution, save_field, save_solution
from .fields.focus import Focus, FocusReport, Lobe, Null, focus_report
from .fields.grid import Grid
from .fields.oil import Oil, oil_surface
from .fields.quantities import (
    QUANTITIES,
    air_density,
    intensity,
    radiation_pressure,
    relative_level,
    sound_pressure_level,
)
from .methods.methods import METHODS, Method, Problem
from .methods.modulation import Modulation, intensity_component
from .methods.options import Options
from .methods.solve import Solution, Solver, solve, solve_frames
from .methods.split import Split, split
from .methods.two_sided import Gain, TwoSided, TwoSidedSolver, two_sided
from .objects.mesh_files import read_mesh
from .objects.volumes import read_volume_mesh
from .pictures.picture import compare_fields, save_field_picture
from .pictures.vti import save_vti
from .rendering.cycle import Cycle
from .rendering.outline import Outline
from .rendering.quiet import Completion, Quieting, Rates, quieted
from .rendering.renderer import Renderer, render
from .rendering.ways import WAYS, parse_way
from .shapes.point_files import read_points
from .shapes.points import ControlPoints
from .shapes.shapes import Asterisk, Circle, Concentric, Polygon, Polyline, Rings, Shape, Sphere, Star, parse_shape

__all__ = [
    "KERNELS",
    "METHODS",
    "MODELS",
    "QUANTITIES",
    "TRANSDUCERS",
    "WAYS",
    "Aperture",
    "Asterisk",
    "Circle",
    "Completion",
    "Concentric",
    "ControlPoints",
    "Cycle",
    "Field",
    "Focus",
    "FocusReport",
    "Gain",
    "Grid",
    "Hand",
    "Lobe",
    "Medium",
    "Mesh",
    "Method",
    "Modulation",
    "Null",
    "Oil",
    "Options",
    "Outline",
    "PlaneField",
    "PlanePropagator",
    "Polygon",
    "Polyline",
    "Problem",
    "Quieting",
    "Rates",
    "Renderer",
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
    "compare_fields",
    "focus_report",
    "intensity",
    "intensity_component",
    "load_field",
    "load_solution",
    "oil_surface",
    "parse_shape",
    "parse_way",
    "pressure",
    "quieted",
    "radiation_pressure",
    "read_mesh",
    "read_points",
    "read_transducers",
    "read_volume_mesh",
    "relative_level",
    "render",
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


def __dir__() -> list[str]:
    return __all__
