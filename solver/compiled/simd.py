"""A vector of `LANES` float32 for compiled kernels: load, store, arithmetic, sum.

LLVM vectorises long loops by itself, but not the short ones over control points, because it cannot tell that rows of
one matrix do not overlap. Here the kernel names the vector operations itself; LLVM still chooses the machine's
instructions, and a machine with shorter registers takes several.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, models, overload, register_model

__all__ = ["LANES", "load", "nearest", "spread", "store", "total"]

LANES = 16
"""One AVX-512 register of float32."""

LLVM_VECTOR = ir.VectorType(ir.FloatType(), LANES)
FLAGS = ("contract", "nsz", "nnan", "ninf", "reassoc")


class VectorType(types.Type):
    """numba's type of a vector."""

    def __init__(self) -> None:
        super().__init__(name=f"Vector({LANES} × float32)")


VECTOR = VectorType()


@register_model(VectorType)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, LLVM_VECTOR)


def _intrinsic(function: Callable[..., Any]) -> Any:
    """A function of kernels that writes its own instructions. Its first argument is numba's and not the caller's."""
    return intrinsic(function)


def _pointer(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    """Address of element [row, column] of a C-contiguous matrix."""
    kind = signature.args[0]
    if kind.layout != "C" or kind.ndim != 2 or kind.dtype != types.float32:
        raise TypeError(f"vectors are read from C-contiguous float32 matrices, not {kind}")
    array = context.make_array(kind)(context, builder, arguments[0])
    indices = [
        context.cast(builder, value, given, types.intp)
        for value, given in zip(arguments[1:3], signature.args[1:3], strict=True)
    ]
    place = cgutils.get_item_pointer(context, builder, kind, array, indices)
    return builder.bitcast(place, LLVM_VECTOR.as_pointer())


@_intrinsic
def load(typing_context: Any, matrix: Any, row: Any, column: Any) -> Any:
    """``matrix[row, column : column + LANES]``."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.load(_pointer(context, builder, signature, arguments), align=4)

    return VECTOR(matrix, row, column), generate


@_intrinsic
def store(typing_context: Any, matrix: Any, row: Any, column: Any, vector: Any) -> Any:
    """``matrix[row, column : column + LANES] = vector``."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        builder.store(arguments[3], _pointer(context, builder, signature, arguments), align=4)
        return context.get_dummy_value()

    return types.none(matrix, row, column, vector), generate


@_intrinsic
def spread(typing_context: Any, scalar: Any) -> Any:
    """A vector of one float32 in every lane."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        empty = ir.Constant(LLVM_VECTOR, ir.Undefined)
        first = builder.insert_element(empty, arguments[0], ir.Constant(ir.IntType(32), 0))
        mask = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
        return builder.shuffle_vector(first, empty, mask)

    return VECTOR(types.float32), generate


@_intrinsic
def total(typing_context: Any, vector: Any) -> Any:
    """The sum of all lanes."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        vector, width = arguments[0], LANES
        while width > 1:
            width //= 2
            lanes = [
                ir.Constant(ir.VectorType(ir.IntType(32), width), [at + i for i in range(width)]) for at in (0, width)
            ]
            low, high = (builder.shuffle_vector(vector, vector, mask) for mask in lanes)
            vector = builder.fadd(low, high, flags=FLAGS)
        return builder.extract_element(vector, ir.Constant(ir.IntType(32), 0))

    return types.float32(vector), generate


@_intrinsic
def nearest(typing_context: Any, scalar: Any) -> Any:
    """The whole number nearest to a float32, as one; LLVM does it for whole registers at once."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        rint = builder.module.declare_intrinsic("llvm.rint", [ir.FloatType()])
        return builder.call(rint, arguments)

    return types.float32(types.float32), generate


def _arithmetic(name: str) -> Callable[..., Any]:
    @_intrinsic
    def apply(typing_context: Any, left: Any, right: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return getattr(builder, name)(*arguments, flags=FLAGS)

        return VECTOR(left, right), generate

    function: Callable[..., Any] = apply
    return function


def _define(operation: Callable[..., Any], name: str) -> None:
    apply = _arithmetic(name)

    @overload(operation, inline="always")
    def choose(left: Any, right: Any) -> Any:
        if isinstance(left, VectorType) and isinstance(right, VectorType):

            def implementation(left: Any, right: Any) -> Any:
                return apply(left, right)

            return implementation
        return None


for _operation, _name in ((operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul")):
    _define(_operation, _name)
