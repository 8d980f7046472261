"""What a motion without repeats can be known by: distributions of what its cycles show.

Of each cycle of each channel: energies in bands, courses over the phase, peaks, delays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import combinations, pairwise
from typing import Any, TypeAlias

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy import fft

SLICES = 5
"""A cell that is a distribution is kept as the means of its lowest to its highest fifth of values."""
Array = NDArray[np.float32]
_HIGHEST = 0.4
"""Of the sample rate: above it anti-alias filters differ."""
_BANDS_PER_OCTAVE, _NARROW_PER_OCTAVE = 3, 24
_PHASES = 16
_COUNTS_FROM = 0.1
_FAINT = 1e-12
COUNTED = "contacts"
CENTRE = ("early or late", "first or second half")
FIGURES = ("peak", "crest", "share of time", COUNTED, *CENTRE)
_ORDERS = (2, 3)
OF_A_SINE = tuple(f"harmonic {order}, {part}" for order in _ORDERS for part in ("in phase", "across"))
"""As shares of the first one, in step with it."""
_TOLERANCE = {
    "energy": 0.1,
    "rms": 0.1,
    "spectrum": 0.1,
    "response": 0.1,
    "peak": 0.04,
    "crest": 0.04,
    "coherence": 0.02,
    "quadrature": 0.02,
    "swing": 2e-4,
    **dict.fromkeys(OF_A_SINE, 1e-3),
}
"""Of what `Columns` make; logarithms of energies and amplitudes, rad."""


@dataclass(frozen=True, slots=True)
class Cell:
    """One thing that is compared: of `channel` (of both, for a coherence), in `run`.

    `band` in Hz or `phase` in fractions of a cycle say where it lies; neither: a figure of the whole cycle,
    `what` it is. `size` numbers stand for it, each compared by itself; those of a `distribution`, its
    `SLICES`, by their mean and their spread. `tolerance`, in the numbers' unit, is what two careful programs
    may differ by in the same motion. `unit` is theirs, where a page is to say it.
    """

    run: int
    channel: str
    what: str
    size: int = 1
    band: tuple[float, float] | None = None
    phase: tuple[float, float] | None = None
    partner: str | None = None
    distribution: bool = False
    tolerance: float = 0.0
    unit: str = ""

    def __post_init__(self) -> None:
        if self.distribution and self.size != SLICES:
            raise ValueError(
                f"{self.channel}, {self.what}: a distribution has {SLICES} numbers, not {self.size}"
            )


def of_cycles(
    run: int,
    channel: str,
    what: str,
    band: tuple[float, float] | None = None,
    phase: tuple[float, float] | None = None,
) -> Cell:
    """A cell that is the distribution of what the cycles of a channel show."""
    return Cell(
        run, channel, what, SLICES, band, phase, distribution=True, tolerance=_TOLERANCE.get(what, 0.0)
    )


@dataclass(frozen=True, slots=True)
class Layout:
    """The cells of a fingerprint, in the order of its numbers."""

    cells: tuple[Cell, ...]

    @property
    def starts(self) -> NDArray[np.intp]:
        """Where each cell's numbers begin, and where the last ends; shape (cells + 1,)."""
        return np.concatenate([[0], np.cumsum([cell.size for cell in self.cells])]).astype(np.intp)

    @property
    def of_numbers(self) -> list[Cell]:
        """The cell that each number belongs to."""
        return [cell for cell in self.cells for _ in range(cell.size)]

    def only(self, chosen: Callable[[Cell], bool]) -> tuple[Layout, NDArray[np.bool_]]:
        """Of the chosen cells alone, and which of the numbers are theirs."""
        kept = tuple(cell for cell in self.cells if chosen(cell))
        return Layout(kept), np.array([chosen(cell) for cell in self.of_numbers], dtype=bool)

    @property
    def size(self) -> int:
        """How many numbers a fingerprint has."""
        return int(self.starts[-1])


@dataclass(frozen=True)
class Columns:
    """How records of `channels` with cycles of `frequency` Hz at `rate` Hz become numbers.

    The coherence between each two of `coupled` channels goes in, too. Of `angles` there is only the swing
    over the cycle: the rest of what an encoder shows is the pattern of its own counts. Of a `sine` that
    drives, the harmonics are estimated directly: they are no more chaotic than it. Cycles are cut where the
    share `begins` of one is over, as a mark may be anywhere.
    """

    channels: tuple[str, ...]
    coupled: tuple[str, ...]
    frequency: float
    rate: float
    angles: tuple[str, ...] = ()
    sine: str = ""
    begins: float = 0.0

    @cached_property
    def harmonics(self) -> NDArray[np.intp]:
        """Edges of the bands as multiples of the frequency, third octaves where harmonics are dense."""
        top = int(_HIGHEST * self.rate / self.frequency)
        steps = int(np.log2(top) * _BANDS_PER_OCTAVE)
        return np.unique(np.round(np.geomspace(1, top, steps + 1)).astype(np.intp))

    @cached_property
    def octaves(self) -> NDArray[np.intp]:
        """Edges of the bands in which coherence is told."""
        top = int(_HIGHEST * self.rate / self.frequency)
        return np.unique(np.round(np.geomspace(2, top, int(np.log2(top)))).astype(np.intp))

    def cells(self, run: int) -> tuple[Cell, ...]:
        """The cells that `numbers` fills, in its order."""
        edges = self.harmonics * self.frequency
        bands = [(float(low), float(high)) for low, high in pairwise(edges)]
        starts = (self.begins + np.arange(_PHASES) / _PHASES) % 1.0
        parts = [(float(start), float(start) + 1.0 / _PHASES) for start in starts]
        half_a_sample = float(np.pi * self.frequency / self.rate)  # of a turn of the cycle, in rad
        cells: list[Cell] = []
        for name in self.channels:
            if name in self.angles:
                cells += [of_cycles(run, name, "swing", phase=part) for part in parts]
                continue
            cells += [of_cycles(run, name, "energy", band) for band in bands]
            cells += [of_cycles(run, name, what, phase=part) for what in ("mean", "rms") for part in parts]
            cells += [of_cycles(run, name, figure) for figure in FIGURES if figure not in CENTRE]
            cells += [replace(of_cycles(run, name, figure), tolerance=half_a_sample) for figure in CENTRE]
            cells += [of_cycles(run, name, part) for part in OF_A_SINE if name == self.sine]
        cells += [
            Cell(run, one, part, 1, (float(low), float(high)), partner=other, tolerance=_TOLERANCE[part])
            for one, other in combinations(self.coupled, 2)
            for part in ("coherence", "quadrature")
            for low, high in pairwise(self.octaves * self.frequency)
        ]
        return tuple(cells)

    def numbers(self, records: Sequence[Array], starts: NDArray[np.intp], length: int) -> CycleTable:
        """Look at `records` of the channels, each (n,), in cycles of `length` samples from `starts` on."""
        looks = [
            self.look(name, record, starts, length)
            for name, record in zip(self.channels, records, strict=True)
        ]
        return self.table(looks, {})

    def look(self, name: str, record: Array, starts: NDArray[np.intp], length: int) -> Look:
        """Look at the record (n,) of one channel."""
        windows = sliding_window_view(record, length)
        cycles = windows[starts]
        if name in self.angles:
            return Look(_course(cycles)[0])
        turned = fft.rfft(np.stack([cycles, windows[starts + length // 2]]) * _hann(length), axis=2)
        power = turned.real**2 + turned.imag**2
        energy = np.mean(power, axis=0)
        bands = np.add.reduceat(energy[:, : self.harmonics[-1]], self.harmonics[:-1], axis=1)
        own = [_of_a_sine(cycles)] if name == self.sine else []
        values = np.concatenate([np.log(bands + _FAINT), *_course(cycles), *own], axis=1)
        if name not in self.coupled:
            return Look(values)
        return Look(values, turned[:, :, : self.octaves[-1]], self._in_octaves(power))

    def table(self, looks: Sequence[Look], crossed: dict[tuple[int, int], Crossed]) -> CycleTable:
        """What the channels show together; what two `looks` make stays in `crossed`."""
        coupled = [(look, look.spectra) for look in looks if look.spectra is not None]
        cross = []
        for (one, first), (other, second) in combinations(coupled, 2):
            key = id(one), id(other)
            if key not in crossed:
                crossed[key] = one, other, self._in_octaves(first * np.conj(second))
            cross.append(crossed[key][2])
        values = np.concatenate([look.values for look in looks], axis=1)
        return CycleTable(values, np.array(cross), np.array([look.power for look, _ in coupled]))

    def _in_octaves(self, density: NDArray[Any]) -> NDArray[Any]:
        """Sums over the bands and both halves of each cycle, shape (cycles, bands)."""
        return np.add.reduceat(density[:, :, : self.octaves[-1]].sum(axis=0), self.octaves[:-1], axis=1)


@dataclass(frozen=True)
class NarrowColumns(Columns):
    """The same, with what resonances show: autospectra of the coupled channels in narrow bands.

    `alone`: these and the frequency responses between each two of them are all there is, not how a motion
    chatters.
    """

    alone: bool = False

    @cached_property
    def narrow(self) -> NDArray[np.intp]:
        """Edges of the narrow bands as multiples of the frequency."""
        top = int(_HIGHEST * self.rate / self.frequency)
        steps = int(np.log2(top) * _NARROW_PER_OCTAVE)
        return np.unique(np.round(np.geomspace(2, top, steps + 1)).astype(np.intp))

    def cells(self, run: int) -> tuple[Cell, ...]:
        bands = [
            (low * self.frequency, high * self.frequency) for low, high in pairwise(self.narrow.tolist())
        ]
        spectra = [
            Cell(run, name, "spectrum", 1, band, tolerance=_TOLERANCE["spectrum"])
            for name in self.coupled
            for band in bands
        ]
        if not self.alone:
            return (*Columns.cells(self, run), *spectra)
        pairs = combinations(self.coupled, 2)
        responses = [
            Cell(run, one, "response", 1, band, partner=other, tolerance=_TOLERANCE["response"])
            for one, other in pairs
            for band in bands
        ]
        return (*spectra, *responses)

    def table(self, looks: Sequence[Look], crossed: dict[tuple[int, int], Crossed]) -> CycleTable:
        table = Columns.table(self, looks, crossed)
        lines = np.array([look.spectra[0] for look in looks if look.spectra is not None])
        pairs = np.array(list(combinations(range(len(lines)), 2)) if self.alone else [], dtype=np.intp)
        one, other = pairs.reshape(-1, 2).T
        products = np.concatenate([np.abs(lines) ** 2, lines[other] * np.conj(lines[one])])
        inside = np.add.reduceat(products[:, :, : self.narrow[-1]], self.narrow[:-1], axis=2)
        return NarrowTable(table.values, table.cross, table.power, inside, one, self.alone)


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """One channel, a row a cycle: `values` (cycles, columns); of a coupled one `spectra` (2, cycles, lines)
    of both halves and `power` (cycles, bands)."""

    values: Array
    spectra: NDArray[np.complex64] | None = None
    power: Array | None = None


Crossed: TypeAlias = tuple[Look, Look, NDArray[Any]]
"""Two looks and their cross spectra (cycles, bands)."""


@cache
def _hann(length: int) -> Array:
    return np.hanning(length).astype(np.float32)


def _of_a_sine(cycles: Array) -> Array:
    """Harmonics of cycles (n, samples) in step with the first, its real and imaginary shares, (n, 4)."""
    first, *others = fft.rfft(cycles, axis=1)[:, 1 : max(_ORDERS) + 1].T
    turned = first / (np.abs(first) + _FAINT)
    shares = [
        line * np.conj(turned) ** order / (np.abs(first) + _FAINT)
        for order, line in zip(_ORDERS, others, strict=True)
    ]
    return np.column_stack([part for share in shares for part in (share.real, share.imag)]).astype(np.float32)


def _course(cycles: Array) -> tuple[Array, Array, Array]:
    """Mean and logarithm of the mean square in each part of the cycle, and the figures of whole cycles."""
    length = cycles.shape[1] // _PHASES * _PHASES
    parts = cycles[:, :length].reshape(len(cycles), _PHASES, -1)
    square, size = np.mean(parts * parts, axis=2), np.abs(cycles)
    peak, total = size.max(axis=1), square.sum(axis=1) + _FAINT
    beyond = size > _COUNTS_FROM * np.median(peak)
    centre = square @ np.exp(2j * np.pi * (np.arange(_PHASES) + 0.5) / _PHASES) / total
    figures = np.column_stack(
        [
            np.log(peak + _FAINT),
            np.log(peak + _FAINT) - 0.5 * np.log(total),
            np.mean(beyond, axis=1),
            np.count_nonzero(beyond[:, 1:] & ~beyond[:, :-1], axis=1),
            centre.real,
            centre.imag,
        ]
    ).astype(np.float32)
    return np.mean(parts, axis=2), np.log(square + _FAINT), figures


@dataclass(frozen=True, slots=True)
class CycleTable:
    """One row a cycle: `values` (cycles, columns); `cross` (pairs, cycles, bands), `power` (coupled, ...)."""

    values: Array
    cross: NDArray[np.complex64]
    power: Array

    def __len__(self) -> int:
        return len(self.values)

    def fingerprint(self, cycles: slice = slice(None)) -> Array:
        """The numbers of the cells over some of the cycles."""
        # means of the lowest to highest fifth of each column
        ordered = np.sort(self.values[cycles].astype(np.float64), axis=0)
        count = len(ordered)
        edges = np.linspace(0, count, SLICES + 1)
        sums = np.vstack([np.zeros(ordered.shape[1]), np.cumsum(ordered, axis=0)])
        whole = np.floor(edges).astype(np.intp)
        share = (edges - whole)[:, None]
        at = sums[whole] + share * ordered[np.minimum(whole, count - 1)]
        fifths = (np.diff(at, axis=0) * SLICES / count).T.astype(np.float32).ravel()
        if not len(self.cross):
            return fifths
        cross, power = self.cross[:, cycles].sum(axis=1), self.power[:, cycles].sum(axis=1)
        one, other = np.array(list(combinations(range(len(power)), 2))).T
        coherence = cross / np.sqrt(power[one] * power[other] + _FAINT)
        parts = np.stack([coherence.real, coherence.imag], axis=1).ravel()
        return np.concatenate([fifths, parts.astype(np.float32)])


@dataclass(frozen=True, slots=True)
class NarrowTable(CycleTable):
    """Also sums of products of lines in narrow bands, (channels and pairs, cycles, bands).

    First of each channel with itself, then of each pair, whose first channels are `inputs`.
    """

    narrow: NDArray[np.complex64]
    inputs: NDArray[np.intp]
    alone: bool

    def fingerprint(self, cycles: slice = slice(None)) -> Array:
        sums = np.log(np.abs(self.narrow[:, cycles].mean(axis=1)) + _FAINT)
        channels = len(sums) - len(self.inputs)
        sums[channels:] -= sums[self.inputs]
        own = sums.astype(np.float32).ravel()
        return own if self.alone else np.concatenate([CycleTable.fingerprint(self, cycles), own])
