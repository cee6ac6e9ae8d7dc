from __future__ import annotations

from typing import Any

from phasewire.compiling import kernel


def twice(x: int) -> int:
    return 2 * x


def test_a_compiled_function_does_what_it_did() -> None:
    assert kernel(twice)(21) == twice(21)


def test_without_a_place_for_the_cache_it_is_compiled_all_the_same() -> None:
    """numba refuses to cache what has no file beside which, or in whose name, it could keep the result."""
    there: dict[str, Any] = {}
    exec(compile("def thrice(x):\n    return 3 * x\n", "<nowhere>", "exec"), there)
    assert kernel(there["thrice"])(14) == 42
