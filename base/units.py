"""Units in SI, so that ``80 * mm`` is a length in metres and ``40 * kHz`` a frequency in hertz.

There is none of angles: phasewire's rotations are in degrees.
"""

__all__ = ["Hz", "cm", "kHz", "mm", "ms", "um", "us"]

um, mm, cm = 1e-6, 1e-3, 1e-2
us, ms = 1e-6, 1e-3
Hz, kHz = 1.0, 1e3
