"""Where things are in the recording, and in which colours."""

from __future__ import annotations

from collections.abc import Callable

import rerun as rr

from daq.log.reader import Origin

TIMELINE = "time"
COLOURS = {
    "measured": (38, 132, 214),
    "predicted": (230, 126, 34),
    "nominal": (230, 126, 34),
    "repaired": (150, 150, 150),
    "surrogate": (90, 143, 41),
}
"""Blue and orange, apart for every eye, and legible on a dark and on a light theme, as is grey."""

WIDTHS = {"measured": 2.6, "predicted": 1.2, "nominal": 1.2, "repaired": 1.2, "surrogate": 1.2}
"""Predictions are drawn last, and thin, so that what was measured shows on both sides of them."""

DIM = (105, 110, 118)
LABEL = (125, 130, 138)
EVENTS = "/events"
STATUS = "/status"
BEAM = "/beam"
PEAKS = "/peaks"


def trace(origin: Origin, channel: str) -> str:
    """Samples of a channel."""
    return rr.new_entity_path([origin, channel])


def _below(what: str) -> Callable[[str], str]:
    return lambda name: rr.new_entity_path([what, name])


peaks = _below("peaks")
"""Largest force of each impact, by origin."""
derived = _below("derived")
"""Values of a derived channel."""
impacts = _below("impacts")
"""Impacts of a group of channels over the crank angle."""
orders = _below("orders")
"""Amplitudes of a channel over orders."""
spectrum = _below("spectra")
"""Picture of a channel's autospectrum."""
