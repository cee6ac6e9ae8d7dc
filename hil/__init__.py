"""How to prove that it works: checks that stand outside both ends and compare them.

This room may import every other one. It holds the conformance suite (`conformance`), which judges any device; the
end-to-end check, which compares the intended drive with the square waves that a device plays and with their pressure;
the reconstruction of sound from captured bits; and what skin and ears get of it.
"""

from lazy_loader import attach_stub

# Lazy: a run of the suite loads neither the solver nor the models of skin.
__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
