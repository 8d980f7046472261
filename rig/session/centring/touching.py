"""Which stop a beam touches, by its two contact forces."""

from __future__ import annotations

from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from daq.signals.impacts import FAINTEST_N, Levels, contacts_above
from rig.session.centring.search import Touched

_LEVELS: Final = Levels(FAINTEST_N, FAINTEST_N / 2)
_CYCLES_WITH: Final = 0.3
"""Share of the sine's cycles with an impact where a stop is touched; a knock on the bench is in one."""
_PRESSED: Final = 0.15
"""Share of the sine's force that a stop feels at its frequency once the tip leans on it, at least; the
lever of the drive point would pass on 0.69. A pick-up of the drive by the sensor's cable is far below."""


def what_is_touched(
    upper: NDArray[np.floating],
    lower: NDArray[np.floating],
    sample_rate: float,
    frequency: float,
    amplitude: float,
) -> Touched:
    """Which side is touched while a sine (Hz, N) shakes the beam.

    Contact forces in N, shape (n,) each, over some cycles. Impacts tell, and the sine itself where the tip
    leans on a stop so gently that no force of a piezoelectric sensor stands out of its noise.
    """
    above, below = (_is_touched(force, sample_rate, frequency, amplitude) for force in (upper, lower))
    if above and below:
        return "both"
    if above or below:
        return "upper" if above else "lower"
    return "nothing"


def _is_touched(force: NDArray[np.floating], sample_rate: float, frequency: float, amplitude: float) -> bool:
    values = np.nan_to_num(np.asarray(force, dtype=np.float64))
    turns = np.arange(len(values), dtype=np.float64) * frequency / sample_rate
    found = contacts_above(_LEVELS, values, sample_rate)
    cycles_with = len(np.unique(turns[found.index].astype(np.intp)))
    if cycles_with >= max(2.0, _CYCLES_WITH * turns[-1]):
        return True
    return abs(_sine_of(values, turns)) > _PRESSED * amplitude


def _sine_of(values: NDArray[np.float64], turns: NDArray[np.float64]) -> complex:
    """Complex amplitude of the sine that most of the whole cycles agree on."""
    begins = np.searchsorted(turns, np.arange(np.floor(turns[-1] + 0.5 / len(turns)) + 1))
    spans = [slice(first, last) for first, last in pairwise(begins)]
    each = [
        2 * np.mean((values[span] - values[span].mean()) * np.exp(-2j * np.pi * turns[span]))
        for span in spans
    ]
    return complex(np.median(np.real(each)), np.median(np.imag(each)))
