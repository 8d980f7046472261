"""Scenario and bench files of these tests."""

from __future__ import annotations

import re
from pathlib import Path

from drivers import lock
from rig.rigs import RIGS

BENCH, PLANAR_BENCH = RIGS["impact_beam"].bench, RIGS["planar_slider_crank"].bench
SCENARIOS = Path(__file__).parents[2] / "scenarios"
CHANNELS = ("drive.force", "contact.force_upper", "contact.force_lower", "yoke.force", "base.acceleration")


def forget_stop(address: str) -> None:
    """Leave no emergency stop latched: the next emulated instrument may get the same port."""
    for path in lock.Latch("", address)._paths:
        Path(path).unlink(missing_ok=True)


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


def write_crank(path: Path, rig: str, duration_s: float = 1.0) -> Path:
    """The scenario of a slider-crank that rattle brings, made short."""
    text = (SCENARIOS / f"{rig}.toml").read_text()
    path.write_text(re.sub(r'duration = ".*"', f'duration = "{duration_s:g} s"', text))
    return path


def write_crank_bench(path: Path, inverter: str, card: str, encoder: str) -> Path:
    """The planar crank's embedded bench with a CAN encoder, all of it real and at these addresses."""
    host, _, port = encoder.rpartition(":")
    text = PLANAR_BENCH.replace("emulated = true", f'port = "{inverter}"', 1)
    text = text.replace("emulated = true", f'grpc = "{card}"', 1).replace(
        "valid_until = 2036", "valid_until = 2096"
    )
    bus = f'interface = "socketcand"\nhost = "{host}"\nport = {port}\nchannel = "can0"\nnode = 7\n'
    path.write_text(f"{text}\n[encoder]\n{bus}")
    return path
