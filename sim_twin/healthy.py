"""What healthy rigs of every kind may differ by in their measuring chains."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from sim_twin.sensors import Sensor, SensorChain
from sim_twin.twin import AnyTwin

_GAIN, _SKEW = 0.005, 2e-6


def scaled(rng: np.random.Generator, deviation: float) -> float:
    """A factor about 1 with a relative standard `deviation`."""
    return float(1 + deviation * rng.standard_normal())


def draw_sensors(
    twin: AnyTwin, rng: np.random.Generator, gains: Mapping[str, float] | None = None
) -> dict[str, Sensor]:
    """Draw gain (0.5 %, or the channel's deviation in `gains`) and time (2 us) of every analog chain."""
    deviations = gains or {}
    return {
        name: _drawn(twin.sensors.get(name, SensorChain()), rng, deviations.get(name, _GAIN))
        for name in twin.channels
    }


def _drawn(sensor: Sensor, rng: np.random.Generator, deviation: float) -> Sensor:
    if not isinstance(sensor, SensorChain):
        return sensor
    gain = sensor.gain * scaled(rng, deviation)
    return replace(sensor, gain=gain, skew=sensor.skew + _SKEW * float(rng.standard_normal()))
