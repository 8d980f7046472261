"""Thrift's compact protocol, as far as a header's numbers and what stands between them.

Source: Apache Thrift, doc/specs/thrift-compact-protocol.md.
"""

from __future__ import annotations

import mmap
from collections.abc import Iterator

from daq.errors import LogError

_STOP, _TRUE, _FALSE, _BYTE, _I16, _I32, _I64, _DOUBLE, _BINARY = range(9)
_LIST, _STRUCT = 9, 12
_INTEGERS = (_I16, _I32, _I64)
_MOST_BITS = 70
_DEEPEST = 64


class Compact:
    """Reads one struct at byte `at` of a file; afterwards `at` is behind it. Raises LogError, IndexError."""

    def __init__(self, data: mmap.mmap, at: int) -> None:
        self._data, self.at = data, at

    def integers(self, depth: int = 0) -> dict[int, int]:
        """The struct's integers by number of the field; all else is passed over."""
        found: dict[int, int] = {}
        for number, kind in self._fields():
            if kind in _INTEGERS:
                found[number] = _signed(self._varint())
            else:
                self._pass(kind, depth)
        return found

    def structs(self, *path: int) -> Iterator[dict[int, int]]:
        """Integers of every struct at the end of a path of fields, of which some may be lists."""
        if not path:
            yield self.integers()
            return
        for number, kind in self._fields():
            if number != path[0] or kind not in (_LIST, _STRUCT):
                self._pass(kind, 0)
                continue
            count, kind = self._items() if kind == _LIST else (1, kind)
            for _ in range(count):
                if kind != _STRUCT:
                    raise LogError("a header lists what are no structs")
                yield from self.structs(*path[1:])

    def _fields(self) -> Iterator[tuple[int, int]]:
        """Number and kind of each; who gets one reads or passes over what it holds."""
        number = 0
        while (head := self._byte()) & 15 != _STOP:
            number = number + (head >> 4) if head >> 4 else _signed(self._varint())
            if head & 15 not in (_TRUE, _FALSE):  # whose value is their kind
                yield number, head & 15

    def _items(self) -> tuple[int, int]:
        head = self._byte()
        return (self._varint() if head >> 4 == 15 else head >> 4), head & 15

    def _pass(self, kind: int, depth: int) -> None:
        if depth > _DEEPEST:
            raise LogError("a header is nested without end")
        if kind in (_TRUE, _FALSE, _BYTE):
            self.at += 1
        elif kind in _INTEGERS:
            self._varint()
        elif kind == _DOUBLE:
            self.at += 8
        elif kind == _BINARY:
            length = self._varint()
            self.at += length
        elif kind == _LIST:
            count, kind = self._items()
            for _ in range(count):
                self._pass(kind, depth + 1)
        elif kind == _STRUCT:
            self.integers(depth + 1)
        else:
            raise LogError(f"a header holds what none does (kind {kind})")
        if self.at > len(self._data):  # a list may claim more than any file has
            raise LogError("a header is cut short")

    def _byte(self) -> int:
        self.at += 1
        return self._data[self.at - 1]

    def _varint(self) -> int:
        value = shift = 0
        while (byte := self._byte()) & 128:
            value |= (byte & 127) << shift
            shift += 7
            if shift > _MOST_BITS:
                raise LogError("a header holds a number without end")
        return value | byte << shift


def _signed(value: int) -> int:
    return value >> 1 ^ -(value & 1)
