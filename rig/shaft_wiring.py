"""From the inverter and the encoder in a bench file to emulated instruments."""

from __future__ import annotations

from dataclasses import asdict
from typing import Final

import numpy as np

from drivers.canopen_cia406.emulator.process import EncoderSetup
from drivers.canopen_cia406.objects import SCALING
from drivers.canopen_cia406.settings import EncoderSettings
from drivers.mitsubishi_fr.emulator.drive import InverterSetup
from drivers.mitsubishi_fr.emulator.process import matching_setup
from drivers.mitsubishi_fr.settings import InverterSettings
from rig.files.bench import Emulation

RAMP_S: Final = 1.5
"""From 0 to 60 Hz, of the emulated inverter."""
_COUNTS: Final = 4096
_CLOCK_PPM: Final = 20.0
"""Standard deviation of a crystal from its rate."""


def inverter_setup(inverter: InverterSettings) -> InverterSetup:
    """An emulated inverter that is set as the bench says."""
    return matching_setup(inverter, RAMP_S)


def encoder_setup(encoder: EncoderSettings, seed: int, emulation: Emulation) -> EncoderSetup:
    """An emulated encoder as the bench wants it.

    Its zero lies anywhere and its clocks are off, by `seed`, unless it is to be nothing but nominal.
    """
    wanted = {name: value for name, value in asdict(encoder.identity).items() if value is not None}
    counts = wanted.pop("counts_per_revolution", _COUNTS)
    revolutions = max(wanted.pop("total_range", counts) // counts, 1)
    scaling = bool(wanted.pop("operating_parameters", SCALING) & SCALING)
    draw = np.random.default_rng([seed, 4])
    zero = int(draw.integers(counts))
    period_ppm, clock_ppm = (float(off) for off in draw.normal(0.0, _CLOCK_PPM, 2))
    return EncoderSetup(
        node=encoder.node,
        channel=str(encoder.options["channel"]),
        counts_per_revolution=counts,
        revolutions=revolutions,
        scaling=scaling,
        offset_counts=zero if emulation.healthy else 0,
        period_ppm=period_ppm if emulation.healthy else 0.0,
        clock_ppm=clock_ppm if emulation.healthy else 0.0,
        lag_s=emulation.encoder_lag,
        **wanted,
    )
