"""All that a view process has to know of a run; it travels there as JSON."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from daq.channel import Channel
from rig.live.displayed_channels import DisplayedChannels
from rig.live.picture import Picture
from rig.loaded_table import loaded, place_of
from rig.rigs import RIGS

if TYPE_CHECKING:
    from sim_twin.twin import AnyTwin


@dataclass(frozen=True, slots=True)
class Layout(DisplayedChannels):
    """What is shown, and the rig's picture where it has one."""

    picture: Picture | None = None

    def to_json(self) -> str:
        """Return the layout as text."""
        shown_by = place_of(type(self.picture)) if self.picture else None
        return json.dumps(dataclasses.asdict(self) | {"shown_by": shown_by})

    @classmethod
    def from_json(cls, text: str) -> Layout:
        """Rebuild a layout from `to_json`."""
        fields = json.loads(text)
        shown_by, values = fields.pop("shown_by"), fields.pop("picture")
        return cls(**fields, picture=loaded(shown_by)(**values) if shown_by else None)


def picture_of(twin: AnyTwin) -> Picture | None:
    """The rig of a twin in space and its own plots; None for a rig that has no picture."""
    place = RIGS[twin.rig.kind].picture
    picture: Picture | None = loaded(place).of(twin) if place else None
    return picture


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
