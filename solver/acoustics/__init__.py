"""The air, transducers, arrays and the pressure that they make at a point, with its tables for the kernels."""
