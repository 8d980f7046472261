"""An encoder against the card's mark of crank angle zero: is it late, and how is it mounted?"""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from daq.angle import Skew, angles_at_marks, find_skew

Array = NDArray[np.float64]


def encoder_at_marks(
    encoder_s: Array, encoder_rad: Array, mark_s: Array, count_rad: float, sample_rate: float
) -> Skew | None:
    """What an encoder shows where the card sees the mark, in one run; None where both never met.

    Times in s on the run's time base, `encoder_s` (n,) and `mark_s` (m,); the card samples at `sample_rate`.
    """
    known = np.concatenate([[True], np.diff(encoder_s) > 0]) if len(encoder_s) else np.zeros(0, np.bool_)
    at_marks = angles_at_marks(
        encoder_s[known], encoder_rad[known], mark_s, count_rad, 1.0 / (sample_rate * sqrt(12.0))
    )
    return find_skew([at_marks])
