"""Eight numbers at a time: what kernels over lanes are written in.

A `Vector` exists only inside compiled kernels and stays in one register (or two where registers are shorter).
Each operation is one IEEE operation per lane, in the order written, so that a lane's bits do not depend on
its neighbours; `fused` rounds once.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any, TypeAlias, cast

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba.core import cgutils, types
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model
from numpy.typing import NDArray

LANES = 8
_BYTES = 64
_FORM = ir.VectorType(ir.DoubleType(), LANES)


class VectorType(types.Type):
    """numba's type of eight float64."""

    def __init__(self) -> None:
        super().__init__(name="vector")


VECTOR = VectorType()
Vector: TypeAlias = Any
"""A vector in the annotations of kernels; their compiler infers types by itself."""


@register_model(VectorType)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, of: Any) -> None:
        super().__init__(manager, of, _FORM)  # type: ignore[no-untyped-call]


def _add_operator(operation: Callable[[Any, Any], Any], instruction: str) -> None:
    class Typing(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            return signature(VECTOR, *args) if args == (VECTOR, VECTOR) else None

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return getattr(builder, instruction)(*args)

    infer_global(operation)(Typing)
    lower_builtin(operation, VECTOR, VECTOR)(lower)


for _operation, _instruction in (
    (operator.add, "fadd"),
    (operator.sub, "fsub"),
    (operator.mul, "fmul"),
    (operator.truediv, "fdiv"),
):
    _add_operator(_operation, _instruction)


def aligned(shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Zeros that begin at a cache line, so that no vector of them lies across two."""
    size = int(np.prod(shape))
    room = np.zeros(size + LANES)
    begin = (-room.ctypes.data % _BYTES) // room.itemsize
    return room[begin : begin + size].reshape(shape)


def _emitted(define: Callable[..., Any]) -> Callable[..., Any]:
    return cast(Callable[..., Any], intrinsic(define))


def _address(context: Any, builder: Any, array_type: Any, array: Any, index: Any) -> Any:
    data = context.make_array(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), _FORM.as_pointer())


@_emitted
def load(typing: Any, array: Any, index: Any) -> Any:
    """Elements index ... index + 7 of a contiguous float64 array, counted through all its axes."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.load(_address(context, builder, sig.args[0], *args), align=8)

    return VECTOR(array, types.intp), generate


@_emitted
def repeated(typing: Any, array: Any, index: Any) -> Any:
    """Element `index` in every lane."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        data = context.make_array(sig.args[0])(context, builder, args[0]).data
        return _in_all_lanes(builder, builder.load(builder.gep(data, [args[1]])))

    return VECTOR(array, types.intp), generate


@_emitted
def store(typing: Any, array: Any, index: Any, value: Any) -> Any:
    """Put `value` at elements index ... index + 7."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        builder.store(args[2], _address(context, builder, sig.args[0], *args[:2]), align=8)
        return context.get_dummy_value()

    return types.void(array, types.intp, VECTOR), generate


@_emitted
def spread(typing: Any, number: Any) -> Any:
    """The same number in every lane."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return _in_all_lanes(builder, args[0])

    return VECTOR(types.float64), generate


def _in_all_lanes(builder: Any, number: Any) -> Any:
    one = builder.insert_element(ir.Constant(_FORM, ir.Undefined), number, ir.IntType(32)(0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    return builder.shuffle_vector(one, ir.Constant(_FORM, ir.Undefined), zeros)


def _function(name: str, arguments: int) -> Any:
    """An elementwise function of LLVM."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        kind = ir.FunctionType(_FORM, [_FORM] * arguments)
        function = cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{LANES}f64")
        return builder.call(function, args)

    return VECTOR(*[VECTOR] * arguments), generate


@_emitted
def fused(typing: Any, a: Any, b: Any, c: Any) -> Any:
    """a b + c, rounded once."""
    return _function("fma", 3)


@_emitted
def root(typing: Any, a: Any) -> Any:
    """Square root."""
    return _function("sqrt", 1)


@_emitted
def magnitude(typing: Any, a: Any) -> Any:
    """Absolute value."""
    return _function("fabs", 1)


@_emitted
def signed(typing: Any, a: Any, b: Any) -> Any:
    """The magnitude of a with the sign of b."""
    return _function("copysign", 2)


@_emitted
def where_positive(typing: Any, test: Any, a: Any, b: Any) -> Any:
    """Lanes of a where `test` > 0, else of b."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        mask = builder.fcmp_ordered(">", args[0], ir.Constant(_FORM, [0.0] * LANES))
        return builder.select(mask, args[1], args[2])

    return VECTOR(VECTOR, VECTOR, VECTOR), generate


@_emitted
def fused_less(typing: Any, a: Any, b: Any, c: Any) -> Any:
    """c - a b, rounded once."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return _function("fma", 3)[1](context, builder, sig, [builder.fneg(args[0]), *args[1:]])

    return VECTOR(VECTOR, VECTOR, VECTOR), generate


@_emitted
def transpose(typing: Any, array: Any, index: Any) -> Any:
    """Transpose the 8 x 8 elements from `index` on, in place: lanes become rows."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        first = _address(context, builder, sig.args[0], *args)
        places = [builder.gep(first, [ir.IntType(64)(k)]) for k in range(LANES)]
        rows = [builder.load(place, align=8) for place in places]
        for half in (1, 2, 4):
            rows = _exchanged(builder, rows, half)
        for place, row in zip(places, rows, strict=True):
            builder.store(row, place, align=8)
        return context.get_dummy_value()

    return types.void(array, types.intp), generate


def _exchanged(builder: Any, rows: list[Any], half: int) -> list[Any]:
    """Exchange the two blocks off the diagonal in every square of 2 `half` rows and lanes."""
    made = list(rows)
    for k in (k for k in range(LANES) if not k & half):
        for upper, to in ((0, k), (half, k + half)):
            lanes = [
                lane + upper if not lane & half else lane - half + upper + LANES for lane in range(LANES)
            ]
            mask = ir.Constant(ir.VectorType(ir.IntType(32), LANES), lanes)
            made[to] = builder.shuffle_vector(rows[k], rows[k + half], mask)
    return made


@_emitted
def pick(typing: Any, a: Any, lane: Any) -> Any:
    """The number in lane `lane`."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.extract_element(*args)

    return types.float64(VECTOR, types.intp), generate


@_emitted
def first_positive(typing: Any, a: Any) -> Any:
    """The first lane with a positive number; 8 where there is none."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        mask = builder.fcmp_ordered(">", args[0], ir.Constant(_FORM, [0.0] * LANES))
        bits = builder.zext(builder.bitcast(mask, ir.IntType(LANES)), ir.IntType(64))
        return builder.cttz(builder.or_(bits, ir.IntType(64)(1 << LANES)), ir.IntType(1)(1))

    return types.int64(VECTOR), generate
