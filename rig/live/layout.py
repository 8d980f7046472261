"""What a view shows: channels, beam, stretch of time; it travels to the view process as JSON."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from daq.channel import Channel
from daq.log.reader import Origin
from rig.live.beam_picture import BeamPicture

_POINTS_PER_S = 12_000
_FEWEST, _MOST = 800, 2_500


@dataclass(frozen=True, slots=True)
class Layout:
    """Channels of all origins, drawn in their order, and how they are shown.

    `units` has the unit of every channel, in the order of the views. `window_s` is how much of the newest
    data the plots show, None for everything.
    """

    title: str
    units: Mapping[str, str]
    origins: Mapping[Origin, Sequence[str]]
    beam: BeamPicture | None = None
    window_s: float | None = None

    def whose(self, origin: Origin) -> str:
        """The origin as the view names it: beside a nominal twin, the prediction is the repaired one."""
        return "repaired" if origin == "predicted" and self.origins.get("nominal") else origin

    @property
    def points_per_s(self) -> float:
        """Points per second and trace, so that a browser keeps up with all of them together."""
        traces = sum(len(names) for names in self.origins.values())
        return min(max(_POINTS_PER_S / max(traces, 1), _FEWEST), _MOST)

    def to_json(self) -> str:
        """Return the layout as text."""
        return json.dumps(dataclasses.asdict(self))

    @classmethod
    def from_json(cls, text: str) -> Layout:
        """Rebuild a layout from `to_json`."""
        fields = json.loads(text)
        beam = fields.pop("beam")
        return cls(**fields, beam=BeamPicture(**beam) if beam else None)


def layout_of(
    title: str,
    measured: Sequence[Channel],
    predicted: Sequence[Channel],
    beam: BeamPicture | None = None,
    window_s: float | None = None,
    nominal: Sequence[Channel] = (),
) -> Layout:
    """Layout of the channels of all origins: the measured first, then what is only predicted."""
    return Layout(
        title=title,
        units={channel.name: channel.unit for channel in (*measured, *predicted)},
        origins={
            "measured": [channel.name for channel in measured],
            "nominal": [channel.name for channel in nominal],
            "predicted": [channel.name for channel in predicted],
        },
        beam=beam,
        window_s=window_s,
    )
