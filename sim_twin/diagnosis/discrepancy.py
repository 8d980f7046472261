"""What a healthy rig shows otherwise than its matched twin, as one more thing by which like rigs differ.

Model discrepancy after Kennedy and O'Hagan 2001, doi:10.1111/1467-9868.00294. Reference runs tell its size;
its sign with an effect in nobody knows. So it is drawn anew for each simulated rig, and moves no mean.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.random import SeedSequence
from numpy.typing import NDArray

from sim_twin.diagnosis.fingerprint import Cell, Layout

Array = NDArray[np.float64]
_RARE = 0.99
"""Of healthy rigs so many are less off by themselves: what lies within that is no discrepancy."""
_OF_ALL, _OF_RUN = 4, 5
"""Of a draw's seed, beside what the campaign draws by it."""


@dataclass(frozen=True, slots=True)
class Discrepancy:
    """Standard deviation, in their unit, of the numbers of some cells about what the twin shows.

    Of `what` of a `channel` and its `partner`; of cells with a band, of those about 2**`octave` Hz.
    """

    channel: str
    what: str
    deviation: float
    partner: str = ""
    octave: int | None = None


_Kind: TypeAlias = tuple[str, str, str]


def learned(
    layout: Layout, measured: NDArray[np.floating], rigs: NDArray[np.floating]
) -> tuple[Discrepancy, ...]:
    """What `measured` fingerprints (blocks, numbers) are off beyond like `rigs` (n, blocks, numbers).

    Of every kind of figure in an octave by itself: the mean square over its numbers, less the rigs'. At least
    3 rigs.
    """
    blocks = min(len(measured), rigs.shape[1])
    shown = rigs[:, :blocks].mean(axis=1, dtype=np.float64)
    mean, variance = shown.mean(axis=0), shown.var(axis=0, ddof=1)
    beyond = (measured.mean(axis=0, dtype=np.float64) - mean) ** 2 / (1 + 1 / len(shown)) - variance
    # each rig against the others, as the measurement against all
    usual = (shown - mean) ** 2 * len(shown) / (len(shown) - 1) - variance
    found = []
    for group, inside in figures(layout).items():
        excess = float(beyond[inside].mean())
        if excess > max(float(np.quantile(usual[:, inside].mean(axis=1), _RARE)), 0.0):
            channel, what, partner, octave = group
            found.append(Discrepancy(channel, what, float(np.sqrt(excess)), partner, octave))
    return tuple(found)


def figures(layout: Layout) -> dict[tuple[str, str, str, int | None], NDArray[np.intp]]:
    """Which numbers are of each kind of figure in an octave: channel, what, partner, octave."""
    found: dict[tuple[str, str, str, int | None], list[int]] = {}
    for number, cell in enumerate(layout.of_numbers):
        found.setdefault((*_kind(cell), _octave(cell)), []).append(number)
    return {group: np.array(inside) for group, inside in found.items()}


def drawn(
    layout: Layout, discrepancies: Sequence[Discrepancy], seed: int, numbers: Sequence[int]
) -> NDArray[np.float32]:
    """What the rig of a `seed` shows otherwise, (numbers,); half of its variance all cells of a kind share.

    `numbers` are those of the layout's runs among all of a campaign: of each run the same, whichever are with
    it.
    """
    known = _by_kind(discrepancies)
    common = _normals(seed, _OF_ALL).standard_normal(len(discrepancies))
    own = [_normals(seed, _OF_RUN, number) for number in numbers]
    shifts = []
    for cell in layout.cells:
        alone = own[cell.run].standard_normal()
        at = _nearest(known.get(_kind(cell), {}), _octave(cell))
        shifts.append(
            0.0 if at is None else discrepancies[at].deviation * (common[at] + alone) * float(np.sqrt(0.5))
        )
    return np.repeat(shifts, np.diff(layout.starts)).astype(np.float32)


def _kind(cell: Cell) -> _Kind:
    return cell.channel, cell.what, cell.partner or ""


def _octave(cell: Cell) -> int | None:
    middle = 0.0 if cell.band is None else cell.band[0] * cell.band[1]
    return round(float(np.log2(middle)) / 2) if middle > 0 else None


def _by_kind(discrepancies: Sequence[Discrepancy]) -> dict[_Kind, dict[int | None, int]]:
    """Which of them is of a kind and an octave."""
    known: dict[_Kind, dict[int | None, int]] = {}
    for k, each in enumerate(discrepancies):
        known.setdefault((each.channel, each.what, each.partner), {})[each.octave] = k
    return known


def _nearest(known: dict[int | None, int], octave: int | None) -> int | None:
    """That of the octave or of one beside it: at another setting the bands lie elsewhere."""
    near = (octave,) if octave is None else (octave, octave - 1, octave + 1)
    return next((known[each] for each in near if each in known), None)


def _normals(seed: int, *key: int) -> np.random.Generator:
    return np.random.default_rng(SeedSequence(seed, spawn_key=key))
