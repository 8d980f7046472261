"""Values of one quantity, met again and again in a run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Sample:
    """`values` of shape (n,)."""

    values: NDArray[np.float64]

    @property
    def mean(self) -> float:
        """Their mean."""
        return float(np.mean(self.values))

    @property
    def deviation(self) -> float:
        """Their standard deviation."""
        return float(np.std(self.values, ddof=1))

    @property
    def error(self) -> float:
        """Standard error of their mean, as if they were independent."""
        return self.deviation / float(np.sqrt(len(self.values)))

    @property
    def relative_deviation(self) -> float:
        """Standard deviation over mean."""
        return self.deviation / self.mean


def ratio(over: Sample, under: Sample) -> tuple[float, float]:
    """Ratio of two means, and its standard error (first order)."""
    value = over.mean / under.mean
    return value, abs(value) * float(np.hypot(over.error / over.mean, under.error / under.mean))
