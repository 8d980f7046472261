"""What a truth engine hands to the campaigns: channels as instruments would have sampled them."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Recording:
    """One run on one time base: `sample_rate` in Hz, samples of shape (n,) and a unit for each channel."""

    sample_rate: float
    channels: dict[str, NDArray[np.float64]]
    units: dict[str, str]

    def __post_init__(self) -> None:
        if self.channels.keys() != self.units.keys():
            raise ValueError("every channel needs exactly one unit")
        if len({samples.shape for samples in self.channels.values()}) > 1:
            raise ValueError("channels differ in length")

    def without(self, missing: Collection[str]) -> Recording:
        """The same with fewer channels."""
        kept = {name: samples for name, samples in self.channels.items() if name not in missing}
        return Recording(self.sample_rate, kept, {name: self.units[name] for name in kept})
