"""How a log names what is computed from its channels, below `/derived/`."""

from __future__ import annotations

from daq.log.reader import Origin

CYCLE_PEAK, CYCLE_RMS = "cycle_peak", "cycle_rms"
CRANK_SPEED = "crank.speed"


def derived_name(origin: Origin, name: str, figure: str = "") -> str:
    """What was measured keeps its name, what was not says whose it is; `figure` is one of its cycles."""
    whose = name if origin == "measured" else f"{origin}.{name}"
    return f"{whose}.{figure}" if figure else whose
