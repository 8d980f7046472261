"""The rig in a plane, as the operator's page draws it: one cycle in slow motion, measured and predicted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from daq.log.reader import Origin
from rig.stream import Shape

FRAMES: Final = 24
"""Pictures of a cycle."""
LATER: Final = ", from the start of the record on"
"""Said of a picture that does not move yet."""

Line = NDArray[np.floating]
"""Points in a plane, m, y upward, shape (n, 2)."""


class Sketch(Protocol):
    """Draws a rig from what comes of it."""

    def note(self, shape: Shape, begin_s: float, cycle_s: float) -> None:
        """Take where the twin's rig is; cycles begin at `begin_s` and every `cycle_s` from there."""

    def drawn(self, angles: Mapping[Origin, NDArray[np.floating]]) -> dict[str, Any]:
        """What `sketched` gives; `angles` of a crank in rad through a cycle, shape (FRAMES,), where known."""


def sketched(
    caption: str,
    fixed: Sequence[Line],
    frames: Sequence[Sequence[tuple[str, Line]]],
    room: tuple[float, float, float, float],
    stops: Sequence[tuple[str, tuple[float, float], float]] = (),
) -> dict[str, Any]:
    """As the page reads it: lines that stay, and those of each frame by whose they are.

    `room`: from left and lower to right and upper edge, m. `stops`: a channel whose force is an arrow that
    ends at a point, and its direction, 1 upward or -1.
    """
    left, low, right, high = room
    scale = 1000.0 / max(right - left, high - low)

    def told(line: Line) -> list[list[int]]:
        placed: list[list[int]] = np.rint((line - [left, low]) * scale).astype(int).tolist()
        return placed

    return {
        "caption": caption,
        "size": [round((right - left) * scale), round((high - low) * scale)],
        "fixed": [told(line) for line in fixed],
        "frames": [[[whose, told(line)] for whose, line in frame] for frame in frames],
        "stops": [[channel, *told(np.array([at]))[0], way] for channel, at, way in stops],
    }
