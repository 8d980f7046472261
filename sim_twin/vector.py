"""Eight numbers at a time: what kernels over lanes are written in.

A `Vector` exists only inside compiled kernels and stays in one register (or two where registers are shorter).
An operation is one instruction for all lanes, so that a lane's bits do not depend on its neighbours. In
`strict` kernels each is one IEEE operation, in the order written; `fused` rounds once.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any, TypeAlias, cast

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba.core import cgutils, types
from numba.core.typeconv.castgraph import Conversion
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, lower_cast, models, register_model
from numpy.typing import NDArray

LANES = 8
_BYTES = 64
_FORM = ir.VectorType(ir.DoubleType(), LANES)


class VectorType(types.Type):
    """numba's type of eight float64; where one is wanted, a number stands for eight of itself."""

    def __init__(self) -> None:
        super().__init__(name="vector")

    def can_convert_from(self, typingctx: Any, other: Any) -> Any:
        return Conversion.safe if isinstance(other, types.Number) else None

    def unify(self, typingctx: Any, other: Any) -> Any:
        return self if isinstance(other, types.Number) else None


VECTOR = VectorType()
Vector: TypeAlias = Any
"""A vector in the annotations of kernels; their compiler infers types by itself."""


@register_model(VectorType)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, of: Any) -> None:
        super().__init__(manager, of, _FORM)  # type: ignore[no-untyped-call]


def _add_operator(
    operation: Callable[..., Any], arity: int, instruction: Callable[..., Any], also: Any = None
) -> None:
    """Give what is written in kernels a meaning for vectors, and for vectors with numbers."""
    taken = [VECTOR] * arity

    class Typing(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            known = all(one == VECTOR or isinstance(one, types.Number) for one in args)
            return signature(VECTOR, *taken) if VECTOR in args and known and len(args) == arity else None

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return instruction(builder, *args)

    for each in (operation,) if also is None else (operation, also):
        infer_global(each)(Typing)
        lower_builtin(each, *taken)(lower)


def _called(name: str) -> Callable[..., Any]:
    """An elementwise function of LLVM."""

    def call(builder: Any, *args: Any) -> Any:
        kind = ir.FunctionType(_FORM, [_FORM] * len(args))
        function = cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{LANES}f64")
        return builder.call(function, args)

    return call


def _greater(builder: Any, a: Any, b: Any) -> Any:
    return builder.select(builder.fcmp_ordered(">", a, b), a, b)


def _less(builder: Any, a: Any, b: Any) -> Any:
    return builder.select(builder.fcmp_ordered("<", a, b), a, b)


_add_operator(operator.add, 2, lambda builder, a, b: builder.fadd(a, b), operator.iadd)
_add_operator(operator.sub, 2, lambda builder, a, b: builder.fsub(a, b), operator.isub)
_add_operator(operator.mul, 2, lambda builder, a, b: builder.fmul(a, b), operator.imul)
_add_operator(operator.truediv, 2, lambda builder, a, b: builder.fdiv(a, b), operator.itruediv)
_add_operator(operator.neg, 1, lambda builder, a: builder.fneg(a))
_add_operator(float, 1, lambda builder, a: a)
_add_operator(abs, 1, _called("fabs"))
_add_operator(math.sqrt, 1, _called("sqrt"))
_add_operator(math.floor, 1, _called("floor"))
_add_operator(max, 2, _greater)
_add_operator(min, 2, _less)


def aligned(shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Zeros that begin at a cache line, so that no vector of them lies across two."""
    size = int(np.prod(shape))
    room = np.zeros(size + LANES)
    begin = (-room.ctypes.data % _BYTES) // room.itemsize
    return room[begin : begin + size].reshape(shape)


def emitted(define: Callable[..., Any]) -> Callable[..., Any]:
    """What kernels call, by the instructions that it stands for."""
    return cast(Callable[..., Any], intrinsic(define))


def _address(context: Any, builder: Any, array_type: Any, array: Any, index: Any) -> Any:
    data = context.make_array(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), _FORM.as_pointer())


@emitted
def load(typing: Any, array: Any, index: Any) -> Any:
    """Elements index ... index + 7 of a contiguous float64 array, counted through all its axes."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.load(_address(context, builder, sig.args[0], *args), align=8)

    return VECTOR(array, types.intp), generate


@emitted
def repeated(typing: Any, array: Any, index: Any) -> Any:
    """Element `index` in every lane."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        data = context.make_array(sig.args[0])(context, builder, args[0]).data
        return _in_all_lanes(builder, builder.load(builder.gep(data, [args[1]])))

    return VECTOR(array, types.intp), generate


@emitted
def store(typing: Any, array: Any, index: Any, value: Any) -> Any:
    """Put `value` at elements index ... index + 7."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        builder.store(args[2], _address(context, builder, sig.args[0], *args[:2]), align=8)
        return context.get_dummy_value()

    return types.void(array, types.intp, VECTOR), generate


@emitted
def spread(typing: Any, number: Any) -> Any:
    """The same number in every lane."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return _in_all_lanes(builder, args[0])

    return VECTOR(types.float64), generate


def _in_all_lanes(builder: Any, number: Any) -> Any:
    one = builder.insert_element(ir.Constant(_FORM, ir.Undefined), number, ir.IntType(32)(0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    return builder.shuffle_vector(one, ir.Constant(_FORM, ir.Undefined), zeros)


def _number_as_vector(context: Any, builder: Any, given: Any, wanted: Any, number: Any) -> Any:
    return _in_all_lanes(builder, context.cast(builder, number, given, types.float64))


for _given in (types.Float, types.Integer):
    lower_cast(_given, VectorType)(_number_as_vector)


def _function(name: str, arguments: int) -> Any:
    """An elementwise function of LLVM."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return _called(name)(builder, *args)

    return VECTOR(*[VECTOR] * arguments), generate


@emitted
def fused(typing: Any, a: Any, b: Any, c: Any) -> Any:
    """a b + c, rounded once."""
    return _function("fma", 3)


@emitted
def root(typing: Any, a: Any) -> Any:
    """Square root."""
    return _function("sqrt", 1)


@emitted
def power(typing: Any, a: Any, b: Any) -> Any:
    """a to the power b, one lane after the other."""
    return _function("pow", 2)


@emitted
def magnitude(typing: Any, a: Any) -> Any:
    """Absolute value."""
    return _function("fabs", 1)


def _kind(*given: Any) -> Any:
    """What comes of numbers and vectors: a vector where there is one."""
    return VECTOR if VECTOR in given else types.float64


def _of_kind(kind: Any, name: str, context: Any, builder: Any, args: Any) -> Any:
    """An elementwise function of LLVM, of vectors or of numbers."""
    form, of = context.get_value_type(kind), f"v{LANES}f64" if kind == VECTOR else "f64"
    wanted = ir.FunctionType(form, [form] * len(args))
    return builder.call(cgutils.get_or_insert_function(builder.module, wanted, f"llvm.{name}.{of}"), args)


@emitted
def signed(typing: Any, a: Any, b: Any) -> Any:
    """The magnitude of a with the sign of b; of numbers too."""
    kind = _kind(a, b)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return _of_kind(kind, "copysign", context, builder, args)

    return kind(kind, kind), generate


@emitted
def where_positive(typing: Any, test: Any, a: Any, b: Any) -> Any:
    """Lanes of a where `test` > 0, else of b; of numbers too."""
    kind = _kind(test, a, b)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        zero = context.get_constant_null(types.float64) if kind != VECTOR else ir.Constant(_FORM, None)
        return builder.select(builder.fcmp_ordered(">", args[0], zero), args[1], args[2])

    return kind(kind, kind, kind), generate


@emitted
def touches(typing: Any, a: Any) -> Any:
    """Whether a is positive, in any lane."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        if a != VECTOR:
            return builder.fcmp_ordered(">", args[0], ir.Constant(args[0].type, 0.0))
        mask = builder.fcmp_ordered(">", args[0], ir.Constant(_FORM, None))
        return builder.icmp_unsigned("!=", builder.bitcast(mask, ir.IntType(LANES)), ir.IntType(LANES)(0))

    return types.boolean(a), generate


@emitted
def fused_less(typing: Any, a: Any, b: Any, c: Any) -> Any:
    """c - a b, rounded once; of numbers too."""
    kind = _kind(a, b, c)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        negative = builder.fneg(args[0])
        return _of_kind(kind, "fma", context, builder, [negative, *args[1:]])

    return kind(kind, kind, kind), generate


@emitted
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


@emitted
def pick(typing: Any, a: Any, lane: Any) -> Any:
    """The number in lane `lane`."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.extract_element(*args)

    return types.float64(VECTOR, types.intp), generate


@emitted
def first_positive(typing: Any, a: Any) -> Any:
    """The first lane with a positive number; 8 where there is none."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        mask = builder.fcmp_ordered(">", args[0], ir.Constant(_FORM, [0.0] * LANES))
        bits = builder.zext(builder.bitcast(mask, ir.IntType(LANES)), ir.IntType(64))
        return builder.cttz(builder.or_(bits, ir.IntType(64)(1 << LANES)), ir.IntType(1)(1))

    return types.int64(VECTOR), generate
