"""The air, transducers, arrays, the pressure that they make at a point, and tables of it for the kernels."""
