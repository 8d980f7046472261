"""Numbers as people read them; a dash stands where there is none."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

DASH: Final = "–"
_LARGE = 1e5
_SHORT_TIMES = ((1e-3, 1e6, "µs"), (0.1, 1e3, "ms"))


_AS_WRITTEN: Final = {"m/s2": (1.0, "m/s²"), "rad/s": (60 / math.tau, "rpm"), "degC": (1.0, "°C")}


def as_written(unit: str) -> tuple[float, str]:
    """A unit as people write it, and how many of it one of `unit` is."""
    return _AS_WRITTEN.get(unit, (1.0, unit))


def number(value: float | None, unit: str = "") -> str:
    """What was measured or computed, with four significant digits and the unit as people write it."""
    if value is None or not math.isfinite(value):
        return DASH
    factor, unit = as_written(unit)
    value *= factor
    size = abs(value)
    if 1e4 <= size < 1e7:
        text = f"{value:.0f}"
    else:
        text = f"{value:.4g}" if 1e-3 <= size < 1e4 or value == 0 else f"{value:.3e}"
    return f"{text} {unit}".rstrip()


def numbers(values: Sequence[float]) -> list[str]:
    """What stands in one row, each with four significant digits; powers only where the largest is one."""
    most = max((abs(value) for value in values if math.isfinite(value)), default=0.0)
    if not 1e-3 <= most < 1e4:
        return [f"{value:.3e}" if math.isfinite(value) and value else number(value) for value in values]
    return [
        np.format_float_positional(value, 4, fractional=False, trim="-") if math.isfinite(value) else DASH
        for value in values
    ]


def signed(value: float, decimals: int = 2) -> str:
    """With its sign; none where it rounds to 0."""
    rounded = round(value, decimals)
    return f"{rounded:+.{decimals}f}".replace("-", "−") if rounded else f"{0.0:.{decimals}f}"


def estimate(value: float, unit: str = "") -> str:
    """What was estimated, with the three digits that count and the unit; short times in ms and µs."""
    if unit == "s":
        for limit, factor, short in _SHORT_TIMES:
            if 0 < abs(value) < limit:
                return f"{factor * value:.3g} {short}"
    shown = f"{value:.3g}" if abs(value) >= _LARGE else f"{float(f'{value:.3g}'):g}"
    text = shown.replace("e+0", "e").replace("e-0", "e-").replace("e+", "e")
    return f"{text} {unit}".rstrip()


def span(low: float, high: float, unit: str) -> str:
    """From one estimate to another; the unit is said once."""
    first, last = estimate(low, unit), estimate(high, unit)
    _, space, shared = last.partition(" ")
    return f"{first.removesuffix(space + shared)} to {last}"


def spread(mean: float, deviation: float, unit: str) -> str:
    """Mean and standard deviation with the unit."""
    if not math.isfinite(deviation):
        return number(mean, unit)
    factor, unit = as_written(unit)
    return f"{factor * mean:.1f} ± {factor * deviation:.1f} {unit}"


def change(share: float, decimals: int = 1) -> str:
    """A share by which something is more or less, in percent with its sign; none where it rounds to 0."""
    return f"{signed(100 * share, decimals)} %"


def difference(predicted: float, measured: float) -> str:
    """How much the prediction lies above what was measured, in percent."""
    if not (math.isfinite(predicted) and math.isfinite(measured)) or measured == 0:
        return DASH
    return change((predicted - measured) / measured)


def probability(share: float) -> str:
    """In percent; what rounds to certainty is not called so."""
    if share < 0.005:
        return "< 1 %"
    return "> 99 %" if share >= 0.995 else f"{100 * share:.0f} %"


def counted(count: int, what: str) -> str:
    """Return "1 gap", "2 gaps", "no gaps"."""
    return f"{count or 'no'} {what}{'' if count == 1 else 's'}"


def listed(names: Sequence[str], last: str = "and") -> str:
    """Names one after the other."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} {last} {names[-1]}"
