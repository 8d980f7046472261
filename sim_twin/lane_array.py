"""Arrays of vectors: what a kernel of numbers works on where it is to run eight lanes at a time.

A kernel is written once, for numbers. Given a `LaneArray` for each array and vectors in its parameters it
computes eight runs side by side: an item is a vector, the lanes being the last axis in memory.
"""

from __future__ import annotations

import operator
from collections.abc import Iterator
from typing import Any, TypeAlias

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba.core import cgutils, types
from numba.core.imputils import lower_getattr
from numba.core.typing.templates import (
    AbstractTemplate,
    AttributeTemplate,
    infer_getattr,
    infer_global,
    signature,
)
from numba.extending import (
    lower_builtin,
    models,
    register_model,
)
from numpy.typing import NDArray

from sim_twin.vector import LANES, VECTOR, aligned, emitted

LaneArray: TypeAlias = Any
"""An array of vectors in the annotations of kernels."""
_WORD = ir.IntType(64)


class LaneArrayType(types.Type):
    """numba's type of an array of vectors with `ndim` axes, the lanes not counted."""

    def __init__(self, ndim: int) -> None:
        self.ndim = ndim
        super().__init__(name=f"lanes({ndim})")


@register_model(LaneArrayType)
class _Model(models.StructModel):
    def __init__(self, manager: Any, of: Any) -> None:
        members = [("data", types.CPointer(types.float64)), ("shape", types.UniTuple(types.intp, of.ndim))]
        super().__init__(manager, of, members)  # type: ignore[no-untyped-call]


def _made(context: Any, builder: Any, kind: LaneArrayType, data: Any, shape: list[Any]) -> Any:
    made = cgutils.create_struct_proxy(kind)(context, builder)
    made.data, made.shape = data, cgutils.pack_array(builder, shape)
    return made._getvalue()


def _types(kind: Any) -> list[Any]:
    """Of a tuple's members; of anything else, its own."""
    return list(kind.types) if isinstance(kind, types.BaseTuple) else [kind]  # type: ignore[attr-defined]


def _part(context: Any, builder: Any, sig: Any, args: Any) -> tuple[Any, list[Any]]:
    """Address of an item, or of a part, and the axes that are left of it."""
    kind, index_type, *_ = sig.args
    array = cgutils.create_struct_proxy(kind)(context, builder, value=args[0])
    shape = cgutils.unpack_tuple(builder, array.shape, kind.ndim)
    given = cgutils.unpack_tuple(builder, args[1]) if isinstance(index_type, types.BaseTuple) else [args[1]]
    index = list(zip(given, _types(index_type), strict=True))
    place: Any = _WORD(0)
    for axis, length in enumerate(shape):
        place = builder.mul(place, length)
        if axis < len(index):
            place = builder.add(place, context.cast(builder, *index[axis], types.intp))
    return builder.gep(array.data, [builder.mul(place, _WORD(LANES))]), shape[len(index) :]


def _vectors(builder: Any, address: Any) -> Any:
    return builder.bitcast(address, ir.VectorType(ir.DoubleType(), LANES).as_pointer())


def _what_is_left(array: Any, index: Any) -> Any:
    """Type of an item, or of a part where there are fewer indices than axes; None where there are more."""
    whole = _types(index)
    if not isinstance(array, LaneArrayType) or not all(isinstance(one, types.Integer) for one in whole):
        return None
    left = array.ndim - len(whole)
    return None if left < 0 else LaneArrayType(left) if left else VECTOR


@infer_global(operator.getitem)
class _GetItem(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        left = _what_is_left(*args)
        return None if left is None else signature(left, *args)


@infer_global(operator.setitem)
class _SetItem(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        array, index, _ = args
        return signature(types.none, array, index, VECTOR) if _what_is_left(array, index) == VECTOR else None


def _get(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    address, left = _part(context, builder, sig, args)
    if left:
        return _made(context, builder, sig.return_type, address, left)
    return builder.load(_vectors(builder, address), align=8)


def _set(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    address, _ = _part(context, builder, sig, args[:2])
    builder.store(args[2], _vectors(builder, address), align=8)
    return context.get_dummy_value()


for _index in (types.Integer, types.BaseTuple):
    lower_builtin(operator.getitem, LaneArrayType, _index)(_get)
    lower_builtin(operator.setitem, LaneArrayType, _index, VECTOR)(_set)


@infer_getattr
class _Attributes(AttributeTemplate):
    key = LaneArrayType

    def resolve_shape(self, array: Any) -> Any:
        return types.UniTuple(types.intp, array.ndim)

    def resolve_size(self, array: Any) -> Any:
        """Of one with one axis."""
        return types.intp if array.ndim == 1 else None


def _shape(context: Any, builder: Any, kind: Any, array: Any) -> Any:
    return cgutils.create_struct_proxy(kind)(context, builder, value=array).shape


def _size(context: Any, builder: Any, kind: Any, array: Any) -> Any:
    return cgutils.unpack_tuple(builder, _shape(context, builder, kind, array))[0]


lower_getattr(LaneArrayType, "shape")(_shape)
lower_getattr(LaneArrayType, "size")(_size)


@emitted
def lanes_of(typing: Any, array: Any) -> Any:
    """A contiguous array of numbers, its last axis being the lanes, as an array of vectors."""
    kind = LaneArrayType(array.ndim - 1)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        given = context.make_array(array)(context, builder, args[0])
        shape = cgutils.unpack_tuple(builder, given.shape, array.ndim)[:-1]
        return _made(context, builder, kind, given.data, shape)

    return kind(array), generate


def _kind_in_lanes(kind: Any) -> Any:
    """Type of parameters in lanes, by their type for one run."""
    if isinstance(kind, types.Float):
        return VECTOR
    if isinstance(kind, types.Array):
        return LaneArrayType(kind.ndim)
    if isinstance(kind, types.BaseTuple):
        members, named = (
            [_kind_in_lanes(each) for each in _types(kind)],
            getattr(kind, "instance_class", None),
        )
        return types.Tuple(members) if named is None else types.NamedTuple(members, named)
    return kind


@emitted
def in_lanes(typing: Any, table: Any, like: Any) -> Any:
    """Parameters in lanes, from the rows (rows, 8) in which `packed` put them; `like` are those of one run.

    Whole numbers and the shapes of arrays are those of `like`.
    """
    kind = _kind_in_lanes(like)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        rows = context.make_array(table)(context, builder, args[0]).data

        def made(of: Any, value: Any, row: Any) -> tuple[Any, Any]:
            address = builder.gep(rows, [builder.mul(row, _WORD(LANES))])
            if isinstance(of, types.Float):
                return builder.load(_vectors(builder, address), align=8), builder.add(row, _WORD(1))
            if isinstance(of, types.Array):
                given = context.make_array(of)(context, builder, value)
                shape = cgutils.unpack_tuple(builder, given.shape, of.ndim)
                array = _made(context, builder, LaneArrayType(of.ndim), address, shape)
                return array, builder.add(row, given.nitems)
            if isinstance(of, types.BaseTuple):
                members = []
                for each, one in zip(_types(of), cgutils.unpack_tuple(builder, value), strict=True):
                    member, row = made(each, one, row)
                    members.append(member)
                return context.make_tuple(builder, _kind_in_lanes(of), members), row
            return value, row

        return made(like, args[1], _WORD(0))[0]

    return kind(table, like), generate


@emitted
def all_in_lanes(typing: Any, arrays: Any) -> Any:
    """A named tuple of arrays, those of float64 with the lanes last as arrays of vectors."""

    def in_work(kind: Any) -> Any:
        of_lanes = isinstance(kind, types.Array) and kind.dtype == types.float64 and kind.ndim > 1
        return LaneArrayType(kind.ndim - 1) if of_lanes else kind

    made = types.NamedTuple([in_work(each) for each in _types(arrays)], arrays.instance_class)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        members = []
        for kind, one in zip(_types(arrays), cgutils.unpack_tuple(builder, args[0]), strict=True):
            if isinstance(in_work(kind), LaneArrayType):
                given = context.make_array(kind)(context, builder, one)
                shape = cgutils.unpack_tuple(builder, given.shape, kind.ndim)[:-1]
                one = _made(context, builder, in_work(kind), given.data, shape)
            members.append(one)
        return context.make_tuple(builder, made, members)

    return made(arrays), generate


def _numbers(parameters: Any) -> Iterator[float]:
    if isinstance(parameters, float):
        yield parameters
    elif isinstance(parameters, np.ndarray):
        yield from parameters.ravel().tolist()
    elif isinstance(parameters, tuple):
        for each in parameters:
            yield from _numbers(each)


def shapes(parameters: Any) -> Iterator[object]:
    """What parameters must have in common to run in lanes: whole numbers and shapes of arrays."""
    if isinstance(parameters, tuple):
        for each in parameters:
            yield from shapes(each)
    elif not isinstance(parameters, float):
        yield parameters.shape if isinstance(parameters, np.ndarray) else parameters


def packed(each: list[Any]) -> NDArray[np.float64]:
    """Parameters of eight runs as the rows that `in_lanes` takes, shape (rows, 8)."""
    columns = [list(_numbers(one)) for one in each]
    made = aligned((len(columns[0]), LANES))
    made[:] = np.transpose(columns)
    return made
