"""What the array should emit so that a shape can be felt.

This room knows the air, transducers and their field, control points, shapes and the solvers that turn points into
complex drives. It knows nothing of ticks, packets or devices.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
