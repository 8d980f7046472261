"""Effects, places and gaps in words."""

from __future__ import annotations

from rig.pages.words import DASH, span
from sim_twin.diagnosis.cause import Cause
from sim_twin.diagnosis.fingerprint.layout import Cell
from sim_twin.effects.effect import Parameter

_UNITS = ("_hz", "_kg", "_nm", "_n_per_m15", "_n_per_m", "_ns_per_m", "_rad")


def plain(name: str) -> str:
    """An effect's name as words."""
    return name.replace("_", " ")


def parameter_words(parameter: Parameter) -> str:
    """A parameter's name as words; its unit stands beside the number."""
    name = next(
        (parameter.name.removesuffix(end) for end in _UNITS if parameter.name.endswith(end)), parameter.name
    )
    return plain(name)


def place(cause: Cause) -> str:
    """Where a cause sits."""
    if cause.location == "sensor":
        return f"in the sensor of {cause.channel}"
    if cause.location == "clock":
        return f"in the clock of {cause.channel}"
    article = "" if cause.location[-1].isdigit() else "the "
    channel = f" ({cause.channel})" if cause.channel else ""
    return f"at {article}{cause.location}{channel}"


def what_and_where(cause: Cause) -> str:
    """An effect with its place."""
    return f"{plain(cause.name)} {place(cause)}"


def unit_words(unit: str) -> str:
    """A unit beside an axis."""
    return unit.replace("s2", "s²") or "-"


def floors(gap: float | None) -> str:
    """A gap."""
    return DASH if gap is None else f"{gap:.2f}"


def plausible(parameter: Parameter) -> str:
    """Where a parameter may lie once its effect is there."""
    return " or ".join(span(low, high, parameter.unit) for low, high in parameter.intervals)


def cell_words(cell: Cell) -> str:
    """What a cell compares."""
    whose = cell.channel if cell.partner is None else f"{cell.channel} with {cell.partner}"
    if cell.band:
        return f"{whose}: {cell.what}, {cell.band[0]:.0f} to {cell.band[1]:.0f} Hz"
    if cell.phase:
        return f"{whose}: {cell.what}, {cell.phase[0]:.2f} to {cell.phase[1]:.2f} of the cycle"
    return f"{whose}: {cell.what}"
