"""Effects, places and numbers in words."""

from __future__ import annotations

from collections.abc import Sequence

from sim_twin.diagnosis.cause import Cause
from sim_twin.diagnosis.estimate import Estimate
from sim_twin.diagnosis.fingerprint.layout import Cell
from sim_twin.effects.effect import Parameter

_UNITS = ("_hz", "_kg", "_nm", "_n_per_m15", "_n_per_m", "_ns_per_m", "_rad")
_LARGE = 1e5
_SHORT_TIMES = ((1e-3, 1e6, "µs"), (0.1, 1e3, "ms"))


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


def percent(share: float) -> str:
    """A probability; what rounds to certainty is not called so."""
    if share < 0.005:
        return "< 1 %"
    return "> 99 %" if share >= 0.995 else f"{100 * share:.0f} %"


def number(value: float, unit: str = "") -> str:
    """Three digits that count, with the unit."""
    if unit == "s":
        for limit, factor, short in _SHORT_TIMES:
            if 0 < abs(value) < limit:
                return f"{factor * value:.3g} {short}"
    shown = f"{value:.3g}" if abs(value) >= _LARGE else f"{float(f'{value:.3g}'):g}"
    text = shown.replace("e+0", "e").replace("e-0", "e-").replace("e+", "e")
    return f"{text} {unit}".rstrip()


def unit_words(unit: str) -> str:
    """A unit beside an axis."""
    return unit.replace("s2", "s²") or "-"


def span(low: float, high: float, unit: str) -> str:
    """From one number to another; the unit is said once."""
    first, last = number(low, unit), number(high, unit)
    _, space, shared = last.partition(" ")
    return f"{first.removesuffix(space + shared)} to {last}"


def floors(gap: float | None) -> str:
    """A gap."""
    return "–" if gap is None else f"{gap:.2f}"


def estimate(found: Estimate, unit: str) -> str:
    """A parameter with its interval."""
    return f"{number(found.value, unit)}, 95 % interval {span(found.low, found.high, unit)}"


def plausible(parameter: Parameter) -> str:
    """Where a parameter may lie once its effect is there."""
    return " or ".join(span(low, high, parameter.unit) for low, high in parameter.intervals)


def listed(names: Sequence[str], last: str = "and") -> str:
    """Names one after the other."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} {last} {names[-1]}"


def cell_words(cell: Cell) -> str:
    """What a cell compares."""
    whose = cell.channel if cell.partner is None else f"{cell.channel} with {cell.partner}"
    if cell.band:
        return f"{whose}: {cell.what}, {cell.band[0]:.0f} to {cell.band[1]:.0f} Hz"
    if cell.phase:
        return f"{whose}: {cell.what}, {cell.phase[0]:.2f} to {cell.phase[1]:.2f} of the cycle"
    return f"{whose}: {cell.what}"
