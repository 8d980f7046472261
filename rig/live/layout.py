"""All that a view process has to know of a run; it travels there as JSON."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from dataclasses import dataclass

from daq.channel import Channel
from rig.live.displayed_channels import DisplayedChannels
from rig.live.picture import Picture
from rig.live.rigs import PICTURES


@dataclass(frozen=True, slots=True)
class Layout(DisplayedChannels):
    """What is shown, and the rig's picture where it has one."""

    picture: Picture | None = None

    def to_json(self) -> str:
        """Return the layout as text."""
        name = self.picture.rig if self.picture else None
        return json.dumps(dataclasses.asdict(self) | {"rig": name})

    @classmethod
    def from_json(cls, text: str) -> Layout:
        """Rebuild a layout from `to_json`."""
        fields = json.loads(text)
        name, values = fields.pop("rig"), fields.pop("picture")
        return cls(**fields, picture=PICTURES[name](**values) if name else None)


def layout_of(
    title: str,
    measured: Sequence[Channel],
    predicted: Sequence[Channel],
    picture: Picture | None = None,
    window_s: float | None = None,
    nominal: Sequence[Channel] = (),
    derived: Sequence[Channel] = (),
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
        derived=[channel.name for channel in derived],
        picture=picture,
        window_s=window_s,
    )
