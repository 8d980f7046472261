"""Effects of sensors and clocks; each sits on one channel."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from sim_twin.effects.effect import Effect, Parameter, ParameterValues
from sim_twin.rigs.impact_beam.twin import BeamTwin
from sim_twin.sensors import SensorChain


def _chain(twin: BeamTwin, values: ParameterValues, field: str, parameter: str) -> BeamTwin:
    channel, number = str(values["channel"]), float(values[parameter])
    chain = twin.sensors.get(channel, SensorChain())
    if field == "gain":
        chain = replace(chain, gain=chain.gain * number)
    elif field == "skew":
        chain = replace(chain, skew=chain.skew + number)
    elif field == "droop_corner":
        chain = replace(chain, droop_corner=number)
    else:
        chain = replace(chain, bandwidth_corner=number)
    return replace(twin, sensors={**twin.sensors, channel: chain})


def sensing_effects(channels: tuple[str, ...], low_passed: tuple[str, ...]) -> tuple[Effect, ...]:
    """The sensor and clock effects on `channels`; `low_passed` are those that can lack bandwidth."""
    rows = (
        ("sensor_gain", "sensor", "gain", "gain", "", ((0.5, 0.92), (1.08, 2.0)), channels),
        ("sensor_droop", "sensor", "corner_hz", "droop_corner", "Hz", ((0.3, 10.0),), channels),
        ("sensor_bandwidth", "sensor", "corner_hz", "bandwidth_corner", "Hz", ((800.0, 8000.0),), low_passed),
        ("time_skew", "clock", "seconds", "skew", "s", ((-2e-3, -5e-5), (5e-5, 2e-3)), channels),
    )
    return tuple(
        Effect(
            name,
            location,
            (Parameter(parameter, unit, intervals),),
            partial(_chain, field=field, parameter=parameter),
            on,
        )
        for name, location, parameter, field, unit, intervals, on in rows
    )
