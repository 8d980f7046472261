"""How long a waveform of the twin means something."""

from __future__ import annotations

from math import pi

import numpy as np

from sim_twin.diagnosis.campaign import RunSetting
from sim_twin.ensembles.clean_samples import clean_samples
from sim_twin.ensembles.variant import Variant

_APART = 1e-7
"""Rad between the two starts: less than any measurement tells, and no visible shift in time."""
_PARTED = 0.1
_LONGEST_S = 2.0


def horizon_s(setting: RunSetting, response: int) -> float | None:
    """Seconds after which two motions from starts that nobody can tell apart differ by a tenth of their rms.

    `response` is the row of the channel that is compared. 2 s are the longest that is looked at; None where
    the motion could not be simulated.
    """
    columns = setting.columns
    starts = [Variant(setting.twin, pi / 3), Variant(setting.twin, pi / 3 + _APART)]
    pair = clean_samples(starts, columns.rate, 0.0, round(_LONGEST_S * columns.rate), setting.oversampling)
    if pair[0] is None or pair[1] is None:
        return None
    one, other = (rows[response] for rows in (pair[0], pair[1]))
    size = float(np.sqrt(np.mean(one**2)))
    length = max(1, round(columns.rate / columns.frequency / 8))
    count = len(one) // length
    apart = np.sqrt(np.mean((one - other)[: count * length].reshape(count, length) ** 2, axis=1))
    parted = np.flatnonzero(apart > _PARTED * size)
    return float(parted[0] * length / columns.rate) if len(parted) else _LONGEST_S
