"""Where things are in the recording, and in which colours."""

from __future__ import annotations

import rerun as rr

from daq.log.reader import Origin

TIMELINE = "time"
COLOURS: dict[Origin, tuple[int, int, int]] = {"measured": (86, 180, 233), "predicted": (255, 145, 40)}
"""Sky blue and orange after Okabe and Ito: apart for every eye, and bright enough on black."""

DIM = (105, 110, 118)
EVENTS = "/events"
STATUS = "/status"
BEAM = "/beam"
PEAKS = "/peaks"


def trace(origin: Origin, channel: str) -> str:
    """Samples of a channel."""
    return rr.new_entity_path([origin, channel])


def peaks(origin: Origin) -> str:
    """Largest force of each half cycle."""
    return f"{PEAKS}/{origin}"


def spectrum(channel: str, part: str = "") -> str:
    """Picture of a channel's autospectrum, or a part of it."""
    return rr.new_entity_path(["spectra", channel, *([part] if part else [])])
