"""Eight numbers side by side, with the same bits on every processor.

A sum over modes runs in eight lanes, which are added at the end in a fixed order, and every fused
multiply-add is written. So no compiler chooses an order or a rounding, and the sum is as fast as
the vector instructions of the processor allow. Lanes go where a sum has a step of eight; an array
that is read in lanes has a multiple of eight numbers.
"""

import operator
from typing import Any

import numpy as np
from llvmlite import ir
from numba import config, types
from numba.core import cgutils
from numba.extending import intrinsic, models, register_model

LANES = 8
_VECTOR = ir.VectorType(ir.DoubleType(), LANES)


def aligned(values: np.ndarray) -> np.ndarray:
    """A copy of an array of floats, C-contiguous, at the start of a line of the processor's cache:
    elsewhere every vector of eight would be read from two lines."""
    room = np.empty(values.size + LANES)
    first = -(room.__array_interface__["data"][0] // room.itemsize) % LANES
    placed = room[first : first + values.size].reshape(values.shape)
    placed[...] = values
    return placed


class Lanes(types.Type):
    """The compiled type of eight numbers."""

    def __init__(self) -> None:
        super().__init__("lanes")


_lanes = Lanes()


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _VECTOR)


def _place(context: Any, builder: Any, kind: Any, values: Any) -> Any:
    """Where eight numbers of an array begin."""
    array, first = values
    begin = context.make_array(kind)(context, builder, array).data
    place = builder.gep(begin, [first])
    return builder.bitcast(place, _VECTOR.as_pointer())


@intrinsic
def _load(typingctx, array, first):
    def codegen(context, builder, signature, values):
        return builder.load(_place(context, builder, signature.args[0], values), align=8)

    return _lanes(array, types.int64), codegen


@intrinsic
def _store(typingctx, array, first, value):
    def codegen(context, builder, signature, values):
        place = _place(context, builder, signature.args[0], values[:2])
        builder.store(values[2], place, align=8)
        return context.get_dummy_value()

    return types.void(array, types.int64, _lanes), codegen


@intrinsic
def _splat(typingctx, number):
    def codegen(context, builder, signature, values):
        none = ir.Constant(_VECTOR, ir.Undefined)
        one = builder.insert_element(none, values[0], ir.Constant(ir.IntType(32), 0))
        all_first = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
        return builder.shuffle_vector(one, none, all_first)

    return _lanes(types.float64), codegen


@intrinsic
def _fma(typingctx, a, b, c):
    def codegen(context, builder, signature, values):
        kind = ir.FunctionType(_VECTOR, [_VECTOR] * 3)
        function = cgutils.get_or_insert_function(builder.module, kind, f"llvm.fma.v{LANES}f64")
        return builder.call(function, values)

    return _lanes(_lanes, _lanes, _lanes), codegen


@intrinsic
def _mul(typingctx, a, b):
    def codegen(context, builder, signature, values):
        return builder.fmul(*values)

    return _lanes(_lanes, _lanes), codegen


@intrinsic
def _add(typingctx, a, b):
    def codegen(context, builder, signature, values):
        return builder.fadd(*values)

    return _lanes(_lanes, _lanes), codegen


@intrinsic
def _neg(typingctx, a):
    def codegen(context, builder, signature, values):
        return builder.fneg(values[0])

    return _lanes(_lanes), codegen


@intrinsic
def _total(typingctx, a):
    def codegen(context, builder, signature, values):
        parts = [
            builder.extract_element(values[0], ir.Constant(ir.IntType(32), lane))
            for lane in range(LANES)
        ]
        while len(parts) > 1:
            half = len(parts) // 2
            parts = [builder.fadd(parts[i], parts[i + half]) for i in range(half)]
        return parts[0]

    return types.float64(_lanes), codegen


def _load_plain(array: np.ndarray, first: int) -> np.ndarray:
    return array[first : first + LANES].copy()


def _store_plain(array: np.ndarray, first: int, value: np.ndarray) -> None:
    array[first : first + LANES] = value


def _splat_plain(number: float) -> np.ndarray:
    return np.full(LANES, number)


def _fma_plain(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    return a * b + c


def _total_plain(a: np.ndarray) -> float:
    while len(a) > 1:
        a = a[: len(a) // 2] + a[len(a) // 2 :]
    return float(a[0])


# load(array, first): numbers `first` to `first` + 7 of a contiguous array; store(array, first, a);
# splat(x): one number in all lanes; fma(a, b, c): a b + c, rounded once; mul(a, b): a b;
# add(a, b): a + b; neg(a): -a; total(a): the sum.
# Where all runs as Python a product and a sum are rounded twice.
if config.DISABLE_JIT:
    load, store, total, splat = _load_plain, _store_plain, _total_plain, _splat_plain
    fma, mul, add, neg = _fma_plain, operator.mul, operator.add, operator.neg
else:
    load, store, total, splat = _load, _store, _total, _splat
    fma, mul, add, neg = _fma, _mul, _add, _neg
