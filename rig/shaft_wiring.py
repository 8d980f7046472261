"""From the inverter and the encoder in a bench file to driver settings and emulated instruments."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Final

import numpy as np

from drivers.canopen_cia406.emulator.setup import EncoderSetup
from drivers.canopen_cia406.objects import SCALING
from drivers.canopen_cia406.settings import EncoderSettings
from drivers.mitsubishi_fr.emulator.drive import InverterSetup
from drivers.mitsubishi_fr.emulator.matching import matching_setup
from drivers.mitsubishi_fr.settings import InverterSettings
from rig.files.actuators import Inverter
from rig.files.bench import Emulation
from rig.files.encoder import Encoder

RAMP_S: Final = 1.5
"""From 0 to 60 Hz, of the emulated inverter."""
_RPM_DIGITS: Final = 9
"""So that the way through rad/s adds nothing that a drive's maximum frequency would be short of."""
_COUNTS: Final = 4096
_CLOCK_PPM: Final = 20.0
"""Standard deviation of a crystal from its rate."""


def inverter_settings(inverter: Inverter, port: str | None) -> InverterSettings:
    """The driver's settings of the inverter that is at `port`."""
    return InverterSettings(
        port=str(port),
        station=inverter.station,
        baudrate=inverter.baudrate,
        parity=inverter.parity,
        rpm_per_hz=inverter.rpm_per_hz,
        maximum_speed_rpm=round(inverter.maximum_speed * 60.0 / math.tau, _RPM_DIGITS),
        answer_s=inverter.answer,
        poll_s=inverter.poll,
        silent_s=inverter.silent,
        unattended_s=inverter.unattended,
    )


def inverter_setup(inverter: Inverter) -> InverterSetup:
    """An emulated inverter that is set as the bench says."""
    return matching_setup(inverter_settings(inverter, None), RAMP_S)


def encoder_settings(encoder: Encoder, address: str | None) -> EncoderSettings:
    """The driver's settings; `address` (host:port) is where an emulated one is, None for a real one."""
    options = dict(encoder.options)
    if address is not None:
        host, _, port = address.rpartition(":")
        options |= {"host": host, "port": int(port)}
    return EncoderSettings(
        interface=encoder.interface,
        options=options,
        node=encoder.node,
        period_s=encoder.period,
        **asdict(encoder.identity),
    )


def encoder_setup(encoder: Encoder, seed: int, emulation: Emulation) -> EncoderSetup:
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
