"""A vector of `LANES` float32 for compiled kernels: load, store, arithmetic, sum.

In arithmetic a single float32 stands for a vector of it in every lane. `nearest`, `magnitude`, `inverse_root` and
`if_positive` take vectors and single float32 alike, so that a formula can be written once for both.

LLVM vectorises long loops by itself, but not the short ones over control points, because it cannot tell that rows of
one matrix do not overlap. Here the kernel names the vector operations itself; LLVM still chooses the machine's
instructions, and a machine with shorter registers takes several.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, lower_builtin, models, register_model, type_callable

__all__ = ["LANES", "if_positive", "inverse_root", "load", "magnitude", "nearest", "spread", "store", "total", "totals"]

LANES = 16
"""One AVX-512 register of float32."""

LLVM_FLOAT, LLVM_INDEX = ir.FloatType(), ir.IntType(32)
LLVM_VECTOR = ir.VectorType(LLVM_FLOAT, LANES)
FLAGS = ("contract", "nsz", "nnan", "ninf", "reassoc")
ESTIMATED = (*FLAGS, "arcp", "afn")


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
        return _spread(builder, arguments[0])

    return VECTOR(types.float32), generate


def _spread(builder: Any, scalar: Any) -> Any:
    empty = ir.Constant(LLVM_VECTOR, ir.Undefined)
    first = builder.insert_element(empty, scalar, LLVM_INDEX(0))
    return builder.shuffle_vector(first, empty, _lanes([0] * LANES))


def _lanes(numbers: Sequence[int]) -> Any:
    """The mask of a shuffle; lanes of the second vector count from that of the first."""
    return ir.Constant(ir.VectorType(LLVM_INDEX, len(numbers)), list(numbers))


@_intrinsic
def total(typing_context: Any, vector: Any) -> Any:
    """The sum of all lanes."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        vector, width = arguments[0], LANES
        while width > 1:
            width //= 2
            low, high = (builder.shuffle_vector(vector, vector, _lanes(range(at, at + width))) for at in (0, width))
            vector = builder.fadd(low, high, flags=FLAGS)
        return builder.extract_element(vector, LLVM_INDEX(0))

    return types.float32(vector), generate


@_intrinsic
def totals(typing_context: Any, vectors: Any) -> Any:
    """The sum of all lanes of each of a tuple of vectors, as many as a power of 2 below `LANES`.

    Two vectors share one at each step, so that this takes less than half of the time of as many calls of `total`.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        left, width = cgutils.unpack_tuple(builder, arguments[0]), LANES
        while width > 1:  # of a vector's lanes each, all within one
            width //= 2
            joined = len(left) > 1
            pairs = zip(left[::2], left[1::2], strict=True) if joined else [(left[0], left[0])]
            starts = range(0, (1 + joined) * LANES if joined else 2 * width * vectors.count, 2 * width)
            low, high = (
                _lanes([at + lane for at in starts for lane in range(part, part + width)]) for part in (0, width)
            )
            left = [
                builder.fadd(builder.shuffle_vector(a, b, low), builder.shuffle_vector(a, b, high), flags=FLAGS)
                for a, b in pairs
            ]
        sums = [builder.extract_element(left[0], LLVM_INDEX(k)) for k in range(vectors.count)]
        return context.make_tuple(builder, signature.return_type, sums)

    return types.UniTuple(types.float32, vectors.count)(vectors), generate


def _call(builder: Any, name: str, *arguments: Any) -> Any:
    """Call a function of LLVM that takes and returns values of one type, single or a vector."""
    kind = arguments[0].type
    suffix = f"v{LANES}f32" if kind == LLVM_VECTOR else "f32"
    function = cgutils.get_or_insert_function(
        builder.module, ir.FunctionType(kind, [kind] * len(arguments)), f"llvm.{name}.{suffix}"
    )
    return builder.call(function, arguments, fastmath=ESTIMATED)


def _number(kind: Any, value: float) -> Any:
    return ir.Constant(kind, [value] * LANES if kind == LLVM_VECTOR else value)


@_intrinsic
def nearest(typing_context: Any, value: Any) -> Any:
    """The whole number nearest to a float32, as one; LLVM does it for whole registers at once."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _call(builder, "rint", *arguments)

    return value(value), generate


@_intrinsic
def magnitude(typing_context: Any, value: Any) -> Any:
    """The value without its sign."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _call(builder, "fabs", *arguments)

    return value(value), generate


@_intrinsic
def inverse_root(typing_context: Any, value: Any) -> Any:
    """1/√value of a positive value, by the machine's estimate and a step of Newton's method if it has one.

    A fence keeps LLVM from turning value·(1/√value) of a vector into a root, which would take longer than the product.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = arguments[0].type
        root = _call(builder, "sqrt", *arguments)
        inverse = builder.fdiv(_number(kind, 1.0), root, flags=ESTIMATED)
        return _call(builder, "arithmetic.fence", inverse) if kind == LLVM_VECTOR else inverse

    return value(value), generate


@_intrinsic
def if_positive(typing_context: Any, condition: Any, value: Any) -> Any:
    """The value, in each lane, if the condition is above 0, or else 0."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        condition, value = arguments
        zero = _number(value.type, 0.0)
        return builder.select(builder.fcmp_ordered(">", condition, zero), value, zero)

    return value(condition, value), generate


def _define(operation: Callable[..., Any], name: str) -> None:
    """Let an operator take vectors. It is lowered at once: an overload would be compiled anew at each use."""

    @type_callable(operation)
    def infer(context: Any) -> Callable[..., Any]:
        def type_of(left: Any, right: Any) -> Any:
            kinds = {left, right}
            return VECTOR if VECTOR in kinds and kinds <= {VECTOR, types.float32} else None

        return type_of

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        vectors = [each if each.type == LLVM_VECTOR else _spread(builder, each) for each in arguments]
        return getattr(builder, name)(*vectors, flags=FLAGS)

    for kinds in ((VECTOR, VECTOR), (VECTOR, types.float32), (types.float32, VECTOR)):
        lower_builtin(operation, *kinds)(generate)


for _operation, _name in ((operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul")):
    _define(_operation, _name)
