"""Batches of updates and fields on a GPU: pure functions of JAX on plain arrays, and which device runs them."""
