"""The search for the middle between two stops: which side is touched, from where on.

A small sine shakes the tip by less than the clearance. With the offset in the middle it touches nothing;
from some offset on it touches the upper stop, from another on the lower one. Whatever the sine's size, the
beam's stiffness or the clearance are, the middle between these two offsets holds the tip in the middle.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
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
    low, high = max(start - FARTHEST * reach, -farthest), min(start + FARTHEST * reach, farthest)
    return _Search(touched, sine, reach, precision, start, low, high, sine.amplitude).middle()


@dataclass(slots=True)
class _Search:
    """Tries offsets between `low` and `high`; `clear`, `upper` and `lower` are those with that answer."""

    touched: Callable[[float, float], Touched]
    sine: Sine
    reach: float
    precision: float
    start: float
    low: float
    high: float
    amplitude: float
    probes: int = 0
    clear: list[float] = field(default_factory=list)
    upper: list[float] = field(default_factory=list)
    lower: list[float] = field(default_factory=list)

    def middle(self) -> Middle:
        """The answer, as soon as both touches are known well enough."""
        while (offset := self._next()) is not None:
            self._probe(offset)
        above, below = min(self.upper), max(self.lower)
        clear = self.clear or [(above + below) / 2]
        top, bottom = (max(clear) + above) / 2, (below + min(clear)) / 2
        widths = (above - max(clear)) + (min(clear) - below)
        return Middle((top + bottom) / 2, widths / 4, top - bottom, self.amplitude, self.probes)

    def _probe(self, offset: float) -> None:
        if self.probes >= _MOST_PROBES:
            raise NoCentre(
                f"no middle was found in {_MOST_PROBES} tries: does the beam answer the same twice?"
            )
        self.probes += 1
        touched = self.touched(offset, self.amplitude)
        if touched == "both":
            if self.amplitude <= self.sine.least:
                raise NoCentre("the least sine touches both stops: is the clearance as small as that?")
            # a sine that touches both sides says nothing of the middle
            self.amplitude = max(self.amplitude / 2, self.sine.least)
            self.clear, self.upper, self.lower = [], [], []
            return
        {"nothing": self.clear, "upper": self.upper, "lower": self.lower}[touched].append(offset)
        found = [*self.lower, *self.clear, *self.upper]
        if [*sorted(self.lower), *sorted(self.clear), *sorted(self.upper)] != sorted(found):
            raise NoCentre(
                f"the beam touches {touched} at {offset:.4g} N, which other offsets contradict: is it loose, "
                "or are the two force channels swapped?"
            )

    def _next(self) -> float | None:
        """The next offset to try; None once both touches are known."""
        if not (self.upper or self.lower or self.clear):
            return self.start
        if not self.upper:
            return self._farther(max([*self.clear, *self.lower]), +1.0, self.high, "upper")
        if not self.lower:
            return self._farther(min([*self.clear, *self.upper]), -1.0, self.low, "lower")
        above, below = min(self.upper), max(self.lower)
        gaps = [(below, above)]
        if self.clear:
            gaps = [(max(self.clear), above), (below, min(self.clear))]
        low, high = max(gaps, key=lambda gap: gap[1] - gap[0])
        return (low + high) / 2 if high - low > self.precision else None

    def _farther(self, last: float, way: float, end: float, side: str) -> float:
        """Half a reach on, then in growing steps."""
        if (end - last) * way <= 0:
            raise NoCentre(
                f"nothing touches the {side} stop up to an offset of {last:.4g} N: are its sensor and the "
                "amplifier's DC output in order, is shaker_stiffness in [model] right?"
            )
        step = max(self.reach / 2, abs(last - self.start) / 2)
        return min(last + step, end) if way > 0 else max(last - step, end)
