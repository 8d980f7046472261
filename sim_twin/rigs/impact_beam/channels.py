"""The channels of the impact beam: names, units, quantities."""

from __future__ import annotations

import re

STATION = re.compile(r"beam\.acceleration_(0[1-9]|[1-9][0-9]|100)")
_UNITS = {
    "drive.force": "N",
    "contact.force_upper": "N",
    "contact.force_lower": "N",
    "yoke.force": "N",
    "base.acceleration": "m/s2",
}
COVER_UNITS = {"cover.acceleration_center": "m/s2", "cover.acceleration_corner": "m/s2"}


def channel_names(stations: tuple[int, ...], covered: bool = False) -> tuple[str, ...]:
    """Channels of a rig with accelerometers on the beam at `stations` (percent of L), and maybe a cover."""
    on_beam = (f"beam.acceleration_{percent:02d}" for percent in stations)
    return (*_UNITS, *on_beam, *(COVER_UNITS if covered else ()))


def channel_unit(name: str) -> str:
    """Unit of a channel; raises KeyError for a name that the rig does not have."""
    if STATION.fullmatch(name):
        return "m/s2"
    return {**_UNITS, **COVER_UNITS}[name]


def stations_of(names: tuple[str, ...]) -> tuple[int, ...]:
    """Stations (percent of L) of those `names` that are accelerometers on the beam."""
    matches = (STATION.fullmatch(name) for name in names)
    return tuple(int(match[1]) for match in matches if match)
