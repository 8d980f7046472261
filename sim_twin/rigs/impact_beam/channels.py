"""The channels of the impact beam."""

from __future__ import annotations

from sim_twin.rigs.channel_table import ChannelTable, RigChannel, Role

DRIVE = RigChannel("drive", "force", "N", Role.DRIVE)
UPPER = RigChannel("contact", "force", "N", Role.CONTACT, "upper", group="stops")
LOWER = RigChannel("contact", "force", "N", Role.CONTACT, "lower", group="stops")
YOKE = RigChannel("yoke", "force", "N")
BASE = RigChannel("base", "acceleration", "m/s2")
COVER = tuple(RigChannel("cover", "acceleration", "m/s2", place=place) for place in ("center", "corner"))
STATIONS = {
    percent: RigChannel(
        "beam",
        "acceleration",
        "m/s2",
        place=f"{percent:02d}",
        family="beam.acceleration_NN (NN: 01 to 100, % of the length)",
    )
    for percent in range(1, 101)
}
"""Accelerometers on the beam, by their place in percent of its length."""
_ALWAYS = (DRIVE, UPPER, LOWER, YOKE, BASE)
CHANNELS = ChannelTable((*_ALWAYS, *COVER, *STATIONS.values()))


def channel_names(stations: tuple[int, ...], covered: bool = False) -> tuple[str, ...]:
    """Channels of a rig with accelerometers on the beam at `stations` (percent of L), and maybe a cover."""
    shown = (*_ALWAYS, *(STATIONS[percent] for percent in stations), *(COVER if covered else ()))
    return tuple(channel.name for channel in shown)


def stations_of(names: tuple[str, ...]) -> tuple[int, ...]:
    """Stations (percent of L) of those `names` that are accelerometers on the beam."""
    percents = {channel.name: percent for percent, channel in STATIONS.items()}
    return tuple(percents[name] for name in names if name in percents)
