"""Effects of sensors and clocks; each sits on one analog channel."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from sim_twin.effects.effect import Effect, Parameter, ParameterValues
from sim_twin.sensors import SensorChain
from sim_twin.twin import AnyTwin


def _chain(twin: AnyTwin, values: ParameterValues, field: str, parameter: str) -> AnyTwin:
    channel, number = str(values["channel"]), float(values[parameter])
    chain = twin.sensors.get(channel, SensorChain())
    if not isinstance(chain, SensorChain):
        raise ValueError(f"{channel} is not an analog channel")
    if field == "gain":
        chain = replace(chain, gain=chain.gain * number)
    elif field == "skew":
        chain = replace(chain, skew=chain.skew + number)
    elif field == "droop_corner":
        chain = replace(chain, droop_corner=number)
    else:
        chain = replace(chain, bandwidth_corner=number)
    return replace(twin, sensors={**twin.sensors, channel: chain})


def _on_a_channel(
    name: str,
    location: str,
    parameter: Parameter,
    field: str,
    channels: tuple[str, ...],
) -> Effect:
    change = partial(_chain, field=field, parameter=parameter.name)
    return Effect(name, location, (parameter,), change, channels, sensing=True)


def sensor_gain(channels: tuple[str, ...]) -> Effect:
    """The channel's values are multiplied."""
    parameter = Parameter("gain", "", ((0.5, 0.92), (1.08, 2.0)))
    return _on_a_channel("sensor_gain", "sensor", parameter, "gain", channels)


def sensor_droop(channels: tuple[str, ...]) -> Effect:
    """A first-order high-pass: the time constant of a charge amplifier."""
    parameter = Parameter("corner_hz", "Hz", ((0.3, 10.0),))
    return _on_a_channel("sensor_droop", "sensor", parameter, "droop_corner", channels)


def sensor_bandwidth(channels: tuple[str, ...]) -> Effect:
    """A second-order Butterworth low-pass before the anti-alias filter."""
    parameter = Parameter("corner_hz", "Hz", ((800.0, 8000.0),))
    return _on_a_channel("sensor_bandwidth", "sensor", parameter, "bandwidth_corner", channels)


def time_skew(channels: tuple[str, ...]) -> Effect:
    """The channel shows x(t - seconds)."""
    parameter = Parameter("seconds", "s", ((-2e-3, -5e-5), (5e-5, 2e-3)))
    return _on_a_channel("time_skew", "clock", parameter, "skew", channels)
