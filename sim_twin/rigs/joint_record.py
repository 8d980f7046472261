"""What passed through a joint, as far as a rig's channels tell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class JointRecord:
    """A joint's force (N), displacement (m) and velocity (m/s), each of shape (n,).

    `location` is a word of the effect table. Not a number: what is not known, or of a joint that is open.
    """

    joint: str
    location: str
    force: Array
    displacement: Array
    velocity: Array
