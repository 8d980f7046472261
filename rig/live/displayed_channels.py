"""What a view shows of a run: the channels of every origin, and how much of the newest data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from daq.log.reader import Origin

_POINTS_PER_S = 12_000
_FEWEST, _MOST = 800, 2_500


@dataclass(frozen=True, slots=True)
class DisplayedChannels:
    """Channels of all origins, drawn in their order.

    `units` has the unit of every channel, in the order of the views. `window_s` is how much of the newest
    data the plots show, None for everything. `derived`: channels that are computed from them.
    """

    title: str
    units: Mapping[str, str]
    origins: Mapping[Origin, Sequence[str]]
    window_s: float | None = None
    derived: Sequence[str] = ()

    def whose(self, origin: str) -> str:
        """The origin as the view names it: beside a nominal twin, the prediction is the repaired one."""
        return "repaired" if origin == "predicted" and self.origins.get("nominal") else origin

    @property
    def points_per_s(self) -> float:
        """Points per second and trace, so that a browser keeps up with all of them together."""
        traces = sum(len(names) for names in self.origins.values())
        return min(max(_POINTS_PER_S / max(traces, 1), _FEWEST), _MOST)
