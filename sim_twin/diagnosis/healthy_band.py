"""Whether a run lies within what healthy rigs of its scenario do, and where it does not.

By gaps, which see anything that lies far off, and by levels: the mean of all figures of a kind, which sees
what is a little higher or lower everywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_twin.diagnosis.fingerprint import COUNTED, Cell, Layout
from sim_twin.diagnosis.gap import GapMeasure, gap_measure

Array = NDArray[np.float64]
_LEAST = 1e-3
_ALONE = 4.5
"""Deviations: the largest of hundreds of normal numbers lies nearer."""
_NORMAL = 0.05
"""Of healthy rigs with normal levels so many look otherwise."""
_LEAST_SPREAD = 0.02
"""Of logarithms of gaps and of levels: few rigs may not pretend less."""


@dataclass(frozen=True, slots=True)
class Level:
    """How far the mean of all figures `what` of a channel lies off, in deviations of healthy rigs.

    `beyond` what any of them does anywhere.
    """

    what: str
    off: float
    beyond: bool


@dataclass(frozen=True, slots=True)
class Place:
    """How far a run lies off in all ("") or in one channel: 1 as far as a typical healthy rig lies.

    Healthy ones lie up to `farthest`, by the most deviations that any of them does anywhere; `gap_beyond`
    that. `worst` is the cell that lies farthest off, `level` the one of the channel's kinds of figure.
    """

    channel: str
    gap: float
    farthest: float
    gap_beyond: bool
    worst: Cell
    level: Level | None = None

    @property
    def beyond(self) -> bool:
        return self.gap_beyond or (self.level is not None and self.level.beyond)


@dataclass(frozen=True, slots=True)
class HealthyBand:
    """Gaps and levels of `rigs` healthy rigs, each from the twin that the others make.

    `typical` and `spread`, shape (1 + channels + levels,), are mean and deviation of the logarithm of the gap
    over all cells and over those of each channel, and of the level of each kind of figure, in floors.
    `limits`, so too, are in deviations the most that any rig lies off the mean anywhere, gaps above it, so
    that one healthy rig in so many lies beyond. A place where one rig is far from all others, such as a point
    that is hardly ever struck, has a limit of its own, and a level that does not scatter as a normal number
    does has none: gaps judge it.
    """

    measure: GapMeasure
    typical: Array
    spread: Array
    limits: Array
    rigs: int

    @property
    def gap_up_to(self) -> float:
        """How far a healthy rig lies off in all at most, as a gap of the `measure`."""
        return float(np.exp(self.typical[0] + self.limits[0] * self.spread[0])) / self.measure.unit

    def places(self, blocks: NDArray[np.floating]) -> list[Place]:
        """All of a run's fingerprints (blocks, numbers) first, then its channels, the farthest off first."""
        cells, layout = self.measure.cells(blocks), self.measure.layout
        apart = _figures(self.measure, blocks) - self.typical
        off = apart / self.spread
        levels: dict[str, list[Level]] = {}
        places = _places(layout)
        for (channel, what), far, limit in zip(
            _kinds(layout), off[len(places) :], self.limits[len(places) :], strict=True
        ):
            levels.setdefault(channel, []).append(Level(what, float(far), bool(abs(far) > limit)))
        found = []
        for number, channel in enumerate(places):
            inside = [k for k, cell in enumerate(layout.cells) if _belongs(cell, channel)]
            worst = layout.cells[max(inside, key=lambda k: float(cells[k]))]
            beyond = bool(off[number] > self.limits[number])
            farthest = float(np.exp(self.limits[number] * self.spread[number]))
            level = max(levels.get(channel, []), key=lambda each: (each.beyond, abs(each.off)), default=None)
            found.append(Place(channel, float(np.exp(apart[number])), farthest, beyond, worst, level))
        whole, *channels = found
        order = np.argsort(-off[1 : len(places)], kind="stable")
        named = sorted((channels[k] for k in order), key=lambda place: not place.beyond)
        return [whole, *named]


def healthy_band(healthy: Sequence[NDArray[np.floating]], layout: Layout) -> HealthyBand:
    """The band of healthy rigs' fingerprints, each (blocks, numbers)."""
    from scipy.stats import jarque_bera  # half a second, which a diagnosis without a band need not wait for

    figures = np.array(
        [
            _figures(gap_measure([*healthy[:number], *healthy[number + 1 :]], layout), blocks)
            for number, blocks in enumerate(healthy)
        ]
    )
    measure = gap_measure(healthy, layout)
    gaps = len(_places(layout))
    besides = np.concatenate([np.zeros(gaps), _between_programs(measure)])
    typical, spread = _normal(figures, besides)
    off = (figures - typical) / spread
    # as a run is held against all: by a mean and deviation that it is in itself, a rig lies nearer
    beside = np.array([_beside_the_others(figures, number, besides) for number in range(len(figures))])
    alike = _most(off, gaps) < _ALONE
    most = _most(beside, gaps)
    limits = np.where(alike, most[alike].max(initial=0.0), _most(off, gaps))
    # a floor is what careful programs differ by, too: of what hardly scatters, rigs alone do not show it
    limits[:gaps] = np.maximum(limits[:gaps], -typical[:gaps] / spread[:gaps])
    with np.errstate(invalid="ignore"):  # of a figure that is the same in all
        skewed = jarque_bera(off[:, gaps:], axis=0).pvalue < _NORMAL
    limits[gaps:][skewed | ~alike[gaps:]] = np.inf
    return HealthyBand(measure, typical, spread, limits, len(healthy))


def _most(off: Array, gaps: int) -> Array:
    """That any rig is off: the gaps, which come first, above the mean, levels to either side."""
    return np.concatenate([off[:, :gaps].max(axis=0), np.abs(off[:, gaps:]).max(axis=0)])


def _normal(figures: Array, besides: Array) -> tuple[Array, Array]:
    """Mean, and the deviation of rigs and of what comes `besides`."""
    deviation = np.hypot(figures.std(axis=0, ddof=1), besides)
    return figures.mean(axis=0), np.maximum(deviation, _LEAST_SPREAD)


def _beside_the_others(figures: Array, number: int, besides: Array) -> Array:
    """How many deviations one rig lies off the mean of the others."""
    mean, deviation = _normal(np.delete(figures, number, axis=0), besides)
    return np.asarray((figures[number] - mean) / deviation)


def _places(layout: Layout) -> list[str]:
    return ["", *dict.fromkeys(cell.channel for cell in layout.cells)]


def _belongs(cell: Cell, channel: str) -> bool:
    return not channel or (cell.channel == channel and cell.partner is None)


def _kinds(layout: Layout) -> list[tuple[str, str]]:
    """Channel and figure of every level."""
    return [*dict.fromkeys((cell.channel, cell.what) for cell in layout.cells if _has_level(cell))]


def _has_level(cell: Cell) -> bool:
    """Of two channels together there is none, nor of what is counted: a count is no normal number."""
    return cell.partner is None and cell.what != COUNTED


def _figures(measure: GapMeasure, blocks: NDArray[np.floating]) -> Array:
    """Logarithms of gaps, then levels."""
    return np.concatenate([np.log(_gaps(measure, measure.cells(blocks))), _levels(measure, blocks)])


def _levels(measure: GapMeasure, blocks: NDArray[np.floating]) -> Array:
    """Means over all numbers of a kind, in floors."""
    floors = np.repeat(measure.floor, np.diff(measure.layout.starts))
    off = (np.mean(blocks, axis=0, dtype=np.float64) - measure.twin) / floors
    return _by_kind(measure.layout, off)


def _between_programs(measure: GapMeasure) -> Array:
    """What two careful programs may differ by in all numbers of a kind together: half of their tolerance."""
    layout = measure.layout
    share = np.sqrt(0.5) * np.array([cell.tolerance for cell in layout.cells]) / measure.floor
    return _by_kind(layout, np.repeat(share, np.diff(layout.starts)))


def _by_kind(layout: Layout, numbers: Array) -> Array:
    """Means over all numbers of a level."""
    kinds = {kind: number for number, kind in enumerate(_kinds(layout))}
    owners = np.array([kinds[c.channel, c.what] if _has_level(c) else -1 for c in layout.of_numbers])
    counts = np.bincount(owners[owners >= 0], minlength=len(kinds))
    return np.asarray(np.bincount(owners[owners >= 0], numbers[owners >= 0], len(kinds)) / counts)


def _gaps(measure: GapMeasure, cells: Array) -> Array:
    """In floors: the measure's unit is of all cells, and one rig in it would count in every channel."""
    totals = (
        measure.unit * measure.total(cells, lambda cell, channel=channel: _belongs(cell, channel))  # type: ignore[misc]
        for channel in _places(measure.layout)
    )
    return np.array([max(total, _LEAST) for total in totals])
