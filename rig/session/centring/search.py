"""The search for the middle between two stops: which side is touched, from where on.

A small sine shakes the tip by less than the clearance. With the offset in the middle it touches nothing;
from some offset on it touches the upper stop, from another on the lower one. Whatever the sine's size, the
beam's stiffness or the clearance are, the middle between these two offsets holds the tip in the middle.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal

from daq.errors import RattleError

Touched = Literal["nothing", "upper", "lower", "both"]
_MOST_PROBES: Final = 60
FARTHEST: Final = 10.0
"""Reaches: how far from where it began the search goes."""


class NoCentre(RattleError, RuntimeError):
    """The beam did not answer as one that rests between two stops does; says what to look at."""


@dataclass(frozen=True, slots=True)
class Sine:
    """Amplitude of the sine and the least that it can be, in N."""

    amplitude: float
    least: float


@dataclass(frozen=True, slots=True)
class Middle:
    """The `offset` in N that centres, off by at most `uncertainty`.

    `apart` is the way from one touch to the other, `amplitude` that of the sine in the end, `probes` how many
    offsets were tried.
    """

    offset: float
    uncertainty: float
    apart: float
    amplitude: float
    probes: int


def find_middle(
    touched: Callable[[float, float], Touched],
    sine: Sine,
    reach: float,
    precision: float,
    farthest: float,
    start: float = 0.0,
) -> Middle:
    """Find the offset in the middle between the two stops by bracketing each touch to `precision` N.

    `touched(offset, amplitude)` says what is touched there. `reach` in N moves the tip by about a clearance;
    no offset beyond +-`farthest` is tried. Raises NoCentre.
    """
    search = _Search(touched, sine, reach, precision, farthest, start)
    return search.middle()


class _Search:
    def __init__(
        self,
        touched: Callable[[float, float], Touched],
        sine: Sine,
        reach: float,
        precision: float,
        farthest: float,
        start: float,
    ) -> None:
        self._touched, self._precision, self._start = touched, precision, start
        self._reach, self._sine = reach, sine
        self._low = max(start - FARTHEST * reach, -farthest)
        self._high = min(start + FARTHEST * reach, farthest)
        self._amplitude, self._probes = sine.amplitude, 0
        self._forget()

    def _forget(self) -> None:
        self._clear: list[float] = []
        self._upper: list[float] = []
        self._lower: list[float] = []

    def middle(self) -> Middle:
        """The answer, as soon as both touches are known well enough."""
        while (offset := self._next()) is not None:
            self._probe(offset)
        above, below = min(self._upper), max(self._lower)
        clear = self._clear or [(above + below) / 2]
        top, bottom = (max(clear) + above) / 2, (below + min(clear)) / 2
        widths = (above - max(clear)) + (min(clear) - below)
        return Middle((top + bottom) / 2, widths / 4, top - bottom, self._amplitude, self._probes)

    def _probe(self, offset: float) -> None:
        if self._probes >= _MOST_PROBES:
            raise NoCentre(
                f"no middle was found in {_MOST_PROBES} tries: does the beam answer the same twice?"
            )
        self._probes += 1
        touched = self._touched(offset, self._amplitude)
        if touched == "both":
            self._shrink()
            return
        {"nothing": self._clear, "upper": self._upper, "lower": self._lower}[touched].append(offset)
        found = [*self._lower, *self._clear, *self._upper]
        if [*sorted(self._lower), *sorted(self._clear), *sorted(self._upper)] != sorted(found):
            raise NoCentre(
                f"the beam touches {touched} at {offset:.4g} N, which other offsets contradict: is it loose, "
                "or are the two force channels swapped?"
            )

    def _shrink(self) -> None:
        """A sine that touches both sides says nothing of the middle."""
        if self._amplitude <= self._sine.least:
            raise NoCentre("the least sine touches both stops: is the clearance as small as that?")
        self._amplitude = max(self._amplitude / 2, self._sine.least)
        self._forget()

    def _next(self) -> float | None:
        """The next offset to try; None once both touches are known."""
        if not (self._upper or self._lower or self._clear):
            return self._start
        if not self._upper:
            return self._farther(max([*self._clear, *self._lower]), +1.0, self._high, "upper")
        if not self._lower:
            return self._farther(min([*self._clear, *self._upper]), -1.0, self._low, "lower")
        above, below = min(self._upper), max(self._lower)
        gaps = [(below, above)]
        if self._clear:
            gaps = [(max(self._clear), above), (below, min(self._clear))]
        low, high = max(gaps, key=lambda gap: gap[1] - gap[0])
        return (low + high) / 2 if high - low > self._precision else None

    def _farther(self, last: float, way: float, end: float, side: str) -> float:
        """Half a reach on, then in growing steps."""
        if (end - last) * way <= 0:
            raise NoCentre(
                f"nothing touches the {side} stop up to an offset of {last:.4g} N: are its sensor and the "
                "amplifier's DC output in order, is shaker_stiffness in [model] right?"
            )
        step = max(self._reach / 2, abs(last - self._start) / 2)
        return min(last + step, end) if way > 0 else max(last - step, end)
