"""Numbers as people read them: four digits, a dash where there is none."""

from __future__ import annotations

import math

DASH = "–"


def number(value: float | None, unit: str = "") -> str:
    """Four significant digits with the unit; a dash for None and for what is not finite."""
    if value is None or not math.isfinite(value):
        return DASH
    size = abs(value)
    if 1e4 <= size < 1e7:
        text = f"{value:.0f}"
    else:
        text = f"{value:.4g}" if 1e-3 <= size < 1e4 or value == 0 else f"{value:.3e}"
    return f"{text} {unit}".rstrip()


def spread(mean: float, deviation: float, unit: str) -> str:
    """Mean and standard deviation with the unit."""
    if not math.isfinite(deviation):
        return number(mean, unit)
    return f"{mean:.1f} ± {deviation:.1f} {unit}"


def difference(predicted: float, measured: float) -> str:
    """How much the prediction lies above what was measured, in percent."""
    if not (math.isfinite(predicted) and math.isfinite(measured)) or measured == 0:
        return DASH
    percent = round(100 * (predicted - measured) / measured, 1)
    return f"{percent:+.1f} %".replace("-", "−") if percent else "0.0 %"


def counted(count: int, what: str) -> str:
    """Return "1 gap", "2 gaps", "no gaps"."""
    return f"{count or 'no'} {what}{'' if count == 1 else 's'}"
