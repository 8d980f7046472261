"""What a diagnosis asks a subject to simulate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Values: TypeAlias = Mapping[str, float | str]
Named: TypeAlias = tuple[str, Values]
"""An effect and its parameters."""


@dataclass(frozen=True, slots=True)
class Draw:
    """A healthy rig of `seed` with `effects` in, observed over `blocks` blocks of each run.

    `sensing` lists what may be wrong with the sensors besides: each entry is one more observation of the
    same motion, with those effects in.
    """

    effects: tuple[Named, ...]
    seed: int
    sensing: tuple[tuple[Named, ...], ...] = ((),)
    blocks: int = 1


Observed: TypeAlias = tuple[NDArray[np.float32] | None, ...]
"""A fingerprint for each entry of `sensing`, shape (blocks, numbers); None for a run that failed."""
