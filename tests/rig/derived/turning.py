"""A crank that turns as a formula says, seen by an encoder, a marker, accelerometers and force sensors."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from math import tau

import numpy as np
from numpy.typing import NDArray

from daq.block import SampleBlock, sample_time_ns
from daq.channel import Channel
from daq.log.reader import Origin

RATE = 25_600.0
START_NS = 1_790_000_000_000_000_000
SPEED_HZ = 200 / 60
COUNTS = 4096
BLOW_AT, BLOW_MS2, BLOW_N = 0.3, 80.0, 120.0
"""Turn of the blow in each revolution, and its size."""

CHANNELS = (
    Channel("crank_frame.acceleration_y", "m/s2"),
    Channel("crank_frame.acceleration_x", "m/s2"),
    Channel("piston_frame.acceleration_y", "m/s2"),
    Channel("crank.angle", "rad"),
    Channel("crank.marker", "V"),
)
SPATIAL_CHANNELS = (
    *(Channel(f"slider.force_{point}", "N") for point in range(1, 9)),
    Channel("socket.force", "N"),
    Channel("motor.tachometer", "rad/s"),
    Channel("flywheel.marker", "V"),
)


def turns(
    seconds: float, fluctuation: float = 0.0, speed_hz: float = SPEED_HZ, rate: float = RATE
) -> NDArray[np.float64]:
    """Turns at every sample: even, or with a speed that goes 1 + `fluctuation` cos(turn) about the mean."""
    even = np.asarray(0.25 + speed_hz * np.arange(round(seconds * rate)) / rate, np.float64)
    return even + fluctuation * np.sin(tau * even) / tau


def encoder_rad(way: NDArray[np.float64]) -> NDArray[np.float64]:
    """The last whole count of an encoder."""
    return np.floor(way * COUNTS) / COUNTS * tau


def marker_v(way: NDArray[np.float64]) -> NDArray[np.float32]:
    """5 V in the first 5 degrees of each turn."""
    return np.where(way % 1.0 < 5 / 360, 5.0, 0.0).astype(np.float32)


def noise(count: int, size: float, seed: int = 1) -> NDArray[np.float64]:
    return np.random.default_rng(seed).normal(scale=size, size=count)


def after_blow_s(way: NDArray[np.float64]) -> NDArray[np.float64]:
    """Seconds since the last blow."""
    return (way - BLOW_AT) % 1.0 / SPEED_HZ


def acceleration(way: NDArray[np.float64], ring_hz: float = 230.0) -> NDArray[np.float32]:
    """A blow of 0.1 ms in each turn, and the frame's ringing after it; noise as a healthy sensor's."""
    since = after_blow_s(way)
    blow = BLOW_MS2 * np.where(since < 1e-4, np.sin(np.pi * np.minimum(since / 1e-4, 1.0)), 0.0)
    ring = 0.25 * BLOW_MS2 * np.exp(-since / 0.023) * np.sin(tau * ring_hz * since)
    return (blow + ring + noise(len(way), 0.05)).astype(np.float32)


def force(way: NDArray[np.float64], size_n: float = BLOW_N, at: float = BLOW_AT) -> NDArray[np.float32]:
    """A contact of 1 ms in each turn, and a sensor's noise."""
    since = (way - at) % 1.0 / SPEED_HZ
    contact = size_n * np.where(since < 1e-3, np.sin(np.pi * np.minimum(since / 1e-3, 1.0)), 0.0)
    return (contact + noise(len(way), 0.05)).astype(np.float32)


def traces(channels: Iterable[Channel], origin: Origin, seconds: float) -> dict[str, NDArray[np.floating]]:
    """All channels of one origin; no two blows of it are alike. What is predicted turns 0.3 % faster."""
    way = turns(seconds, speed_hz=SPEED_HZ * (1.0 if origin == "measured" else 1.003))
    strength = (1 + 0.4 * np.sin(1.7 * np.floor(way))).astype(np.float32)
    found: dict[str, NDArray[np.floating]] = {}
    for channel in channels:
        match channel:
            case Channel(name="crank.angle"):
                found[channel.name] = encoder_rad(way)
            case Channel(unit="V"):
                found[channel.name] = marker_v(way)
            case Channel(unit="m/s2"):
                found[channel.name] = strength * acceleration(way)
            case Channel(unit="N"):
                found[channel.name] = strength * force(way)
            case _:
                found[channel.name] = np.full(len(way), tau * SPEED_HZ, np.float32)
    if origin != "measured":
        quieter = {name for name in found if found[name].dtype == np.float32 and "marker" not in name}
        found |= {name: (0.4 * found[name]).astype(np.float32) for name in quieter}
    return found


def in_blocks(
    channel: str, values: NDArray[np.floating], length: int = 2560, first: int = 0
) -> Iterator[SampleBlock]:
    """The samples of one channel, cut."""
    for begin in range(0, len(values), length):
        at = first + begin
        time_ns = sample_time_ns(START_NS, at, RATE)
        yield SampleBlock(channel, at, time_ns, RATE, values[begin : begin + length])


def blocks(channels: Iterable[Channel], origin: Origin, seconds: float) -> Iterator[SampleBlock]:
    """Blocks of 0.1 s of all channels, as a card would deliver them."""
    cut = (in_blocks(name, values) for name, values in traces(channels, origin, seconds).items())
    for together in zip(*cut, strict=True):
        yield from together
