"""Scenario and bench files of these tests."""

from __future__ import annotations

import re
from pathlib import Path

from rig.files.benches.impact_beam import BENCH

CHANNELS = ("drive.force", "contact.force_upper", "contact.force_lower", "yoke.force", "base.acceleration")


def write_scenario(
    path: Path,
    settle_s: float = 0.85,
    duration_s: float = 0.6,
    amplitude_n: float = 9.0,
    frequency_hz: float = 20.0,
    limits: str = "",
) -> Path:
    """A scenario of the steel beam."""
    path.write_text(f"""\
name = "tested beam"
rig = "impact_beam"

[drive]
frequency = "{frequency_hz:g} Hz"
amplitude = "{amplitude_n:g} N"

[acquisition]
sample_rate = "51.2 kHz"
settle = "{settle_s:g} s"
duration = "{duration_s:g} s"

{limits}
""")
    return path


def write_bench(
    path: Path, generator: str | None = None, card: str | None = None, emulation: str = ""
) -> Path:
    """The embedded bench with real instruments at these addresses, and an [emulation] table."""
    text = BENCH
    if generator is not None:
        text = text.replace("emulated = true", f'resource = "{generator}"', 1)
    if card is not None:
        head, table = text.split("[daq_card]")
        text = f"{head}[daq_card]{table.replace('emulated = true', f'grpc = {chr(34)}{card}{chr(34)}', 1)}"
    # Nobody calibrates a sensor that is an emulated one in truth; a real bench is held to its dates.
    text = re.sub(r"valid_until = 2036", "valid_until = 2096", text)
    path.write_text(f"{text}\n{emulation}\n")
    return path
