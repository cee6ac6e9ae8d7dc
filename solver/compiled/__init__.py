"""Compiled kernels on plain arrays: one update, pressure, the time domain, and the vector instructions for them."""
