"""A circuit that oscillates like a driven mass on a spring: the twin is the linear oscillator.

It is driven by the recorded input, so the twin can follow the experiment; a block is one random multisine of
14 s. A fingerprint is the force that the linear twin lacks, by the response's own derivatives up to 150 Hz:
its mean where the response, its rate or the input lie between certain bounds.

What healthy circuits differ by: frequency 0.5 %, damping 3 % and gain 1 % from what the first seconds say,
where the response is small; 0.5 % at 0.2 V in the linearity of spring and damper, as analog circuits have;
20 us between the channels, and the noise of 0.25 mV that both show before the input begins.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import pi

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.signal import resample

from sim_twin.own_rig import Cause, Cell, Draw, Layout, Observed, binned, cause, number, with_effects

Array = NDArray[np.float64]
Blocks = NDArray[np.float32]
RATE = 1e7 / 2**14
_QUIET, _SMALL = 215, 6000
"""Samples: before there is an input; until when the response is small."""
_FIRST, _NEXT, _LENGTH, _MULTISINES = 40_546, 8693, 8640, 9
"""Samples: start of the first multisine, from one start to the next, what is used of each."""
_EDGE, _BLOCKS = 200, 4
_BAND = 150.0
_BOUNDS = np.array([-2.4, -1.8, -1.2, -0.7, -0.25, 0.25, 0.7, 1.2, 1.8, 2.4])
_WATCHED = {"response": 0.055, "rate": 0.055, "input": 0.0225}
"""What the force is compared with, and the unit of its bounds: V, w times V, V; about root mean squares."""
_FREQUENCY, _DAMPING, _GAIN, _SKEW, _NOISE = 0.005, 0.03, 0.01, 20e-6, 0.25e-3
_LINEARITY, _FULL = 0.005, 0.2

_OVERSAMPLING = 4
"""An input without content above half its rate is known between its samples; steps are two of these long."""


@dataclass(frozen=True, slots=True)
class Circuit:
    """Hz, share of critical damping, output over input (V/V) at rest; a linear one has none of the others.

    The spring's force is w2 (x + quadratic x2 + cubic x3) of x beyond a `dead` zone (V). Damping grows by
    `damping_2` and `damping_3` of itself, with the first and second power of the rate, until that is w times
    0.05 V; `friction` is in V of the input. What is shown bends towards a `limit` (V), is multiplied by
    `output` and comes late by `delay` (s).
    """

    frequency: float
    damping: float
    gain: float
    quadratic: float = 0.0
    cubic: float = 0.0
    dead: float = 0.0
    damping_2: float = 0.0
    damping_3: float = 0.0
    friction: float = 0.0
    limit: float = np.inf
    output: float = 1.0
    delay: float = 0.0

    def respond(self, u: Array, rate: float) -> Array:
        """What it does from rest on an input (V), sampled at `rate` (Hz), shape (n,)."""
        fine: Array = resample(u, _OVERSAMPLING * len(u))
        spring = (self.quadratic, self.cubic, self.dead)
        damper = (2 * self.damping, self.damping_2, self.damping_3, self.friction)
        return _respond(self.gain * fine, 2 * pi * self.frequency / rate, spring, damper)

    def shown(self, y: Array, rate: float) -> Array:
        """What its output shows of it."""
        bent: Array = self.limit * np.tanh(y / self.limit) if np.isfinite(self.limit) else y
        return self.output * filtered(bent, rate, lambda f: np.exp(-2j * pi * f * self.delay))


def filtered(x: Array, rate: float, response: Callable[[Array], NDArray[np.complex128]]) -> Array:
    """A record through a filter with the given frequency response (of Hz)."""
    frequencies = np.arange(len(x) // 2 + 1) * rate / len(x)
    return np.asarray(np.fft.irfft(response(frequencies) * np.fft.rfft(x), len(x)))


@njit(cache=True)
def _respond(
    u: Array, w: float, spring: tuple[float, float, float], damper: tuple[float, float, float, float]
) -> Array:
    """Runge and Kutta's classical steps, two a sample; time in samples."""
    found = np.zeros(len(u) // 4)
    x, v, step = 0.0, 0.0, 0.5 * w
    for k in range(2 * len(found) - 1):
        if k % 2 == 0:
            found[k // 2] = x
        a1 = _acceleration(x, v, u[2 * k], spring, damper)
        v2 = v + 0.5 * step * a1
        a2 = _acceleration(x + 0.5 * step * v, v2, u[2 * k + 1], spring, damper)
        v3 = v + 0.5 * step * a2
        a3 = _acceleration(x + 0.5 * step * v2, v3, u[2 * k + 1], spring, damper)
        v4 = v + step * a3
        a4 = _acceleration(x + step * v3, v4, u[2 * k + 2], spring, damper)
        x += step * (v + 2 * v2 + 2 * v3 + v4) / 6
        v += step * (a1 + 2 * a2 + 2 * a3 + a4) / 6
    return found


@njit(cache=True)
def _acceleration(
    x: float,
    v: float,
    u: float,
    spring: tuple[float, float, float],
    damper: tuple[float, float, float, float],
) -> float:
    """In units of w: the rate `v` is that of a phase."""
    quadratic, cubic, dead = spring
    linear, second, third, friction = damper
    stretched = np.sign(x) * max(abs(x) - dead, 0.0)
    fast = abs(v) / 0.05
    force = stretched * (1 + quadratic * x + cubic * x * x)
    return float(
        u - force - linear * v * (1 + second * fast + third * fast * fast) - friction * np.tanh(v / 1e-3)
    )


CAUSES = (
    cause("quadratic_stiffness", "spring", number("quadratic", "1/V", (-3.0, -0.1), (0.1, 3.0))),
    cause("cubic_stiffness", "spring", number("cubic", "1/V2", (-5.0, -0.5), (0.5, 30.0))),
    cause("dead_zone", "spring", number("dead", "V", (1e-3, 0.03))),
    cause("quadratic_damping", "damper", number("damping_2", "", (0.1, 3.0))),
    cause("cubic_damping", "damper", number("damping_3", "", (0.05, 2.0))),
    cause("coulomb_friction", "damper", number("friction", "V", (2e-4, 8e-3))),
    cause("output_gain", "sensor", number("output", "", (0.5, 0.95), (1.05, 2.0)), sensing=True),
    cause("output_saturation", "sensor", number("limit", "V", (0.12, 1.0)), sensing=True),
    cause("output_delay", "sensor", number("delay", "s", (-2e-3, -1e-4), (1e-4, 2e-3)), sensing=True),
)
"""What may bend an oscillator's response, of sizes that 0.2 V at 70 Hz can show."""


@dataclass(frozen=True, slots=True)
class Silverbox:
    """The circuit as a subject: its linear twin, and the inputs given, shape (multisines, samples)."""

    twin: Circuit
    inputs: Array
    width: float = 1.0

    @property
    def layout(self) -> Layout:
        """Mean lacking force, in root mean squares of the input, by what it goes with."""
        cells = [Cell(0, channel, f"class {k + 1}") for channel in _WATCHED for k in range(len(_BOUNDS) - 1)]
        return Layout(tuple(cells))

    @property
    def causes(self) -> tuple[Cause, ...]:
        return CAUSES

    def observe(self, draws: Sequence[Draw]) -> list[Observed]:
        """Give each circuit as many of the multisines as its draw has blocks."""
        return [self._observe(draw) for draw in draws]

    def wider(self, times: float) -> Silverbox:
        return replace(self, width=times)

    def _observe(self, draw: Draw) -> Observed:
        rng = np.random.default_rng(draw.seed)
        circuit = _healthy(with_effects(self.twin, draw.effects), self.width, rng)
        inputs = self.inputs[rng.permutation(len(self.inputs))[: draw.blocks]]
        responses = [circuit.respond(u, RATE) for u in inputs]
        if not np.isfinite(responses).all():  # a softening spring lets go
            return (None,) * len(draw.sensing)
        noise = self.width * _NOISE * rng.standard_normal((2, *inputs.shape))
        seen = [with_effects(circuit, effects) for effects in draw.sensing]
        shown = [np.array([one.shown(y, RATE) for y in responses]) for one in seen]
        return tuple(self.fingerprints(inputs + noise[0], each + noise[1]) for each in shown)

    def fingerprints(self, inputs: Array, outputs: Array) -> Blocks:
        """Of some multisines and what the circuit made of them, both in V and (multisines, samples)."""
        return np.array([self._fingerprint(u, y) for u, y in zip(inputs, outputs, strict=True)], np.float32)

    def _fingerprint(self, u: Array, y: Array) -> Array:
        w = 2 * pi * self.twin.frequency
        rate, bend = _derivative(y, 1) / w, _derivative(y, 2) / w**2
        explained = (bend + 2 * self.twin.damping * rate + _derivative(y, 0)) / self.twin.gain
        lacking = _derivative(u, 0) - explained
        inside = slice(_EDGE, -_EDGE)
        watched = zip((y, rate, u), _WATCHED.values(), strict=True)
        means = [
            np.nan_to_num(binned(lacking[inside], each[inside] / unit, _BOUNDS)) for each, unit in watched
        ]
        return np.asarray(np.concatenate(means) / u.std())


def measured(files: Sequence[Mapping[str, Array]]) -> tuple[Silverbox, Blocks]:
    """The subject, its twin matched to the record's small beginning, and the first measured fingerprints."""
    [table] = files
    u, y = (table[f"SNLS80mV_V{k}"].astype(np.float64) for k in (1, 2))
    u, y = u - u[:_QUIET].mean(), y - y[:_QUIET].mean()
    starts = _FIRST + _NEXT * np.arange(_MULTISINES)
    inputs, outputs = (np.array([each[at : at + _LENGTH] for at in starts]) for each in (u, y))
    subject = Silverbox(_matched(u[:_SMALL], y[:_SMALL]), inputs)
    return subject, subject.fingerprints(inputs[:_BLOCKS], outputs[:_BLOCKS])


def _matched(u: Array, y: Array) -> Circuit:
    """The linear circuit that answers most like the measured one."""

    def left(numbers: Array) -> Array:
        return Circuit(*numbers.tolist()).respond(u, RATE)[_EDGE:] - y[_EDGE:]

    found = least_squares(left, [70.0, 0.05, 1.0], x_scale=[1.0, 0.01, 0.1])
    return Circuit(*found.x.tolist())


def _healthy(circuit: Circuit, width: float, rng: np.random.Generator) -> Circuit:
    frequency, damping, gain = 1 + width * np.array([_FREQUENCY, _DAMPING, _GAIN]) * rng.standard_normal(3)
    quadratic, cubic, damping_2 = (
        width * _LINEARITY / np.array([_FULL, _FULL**2, _FULL / 0.05]) * rng.standard_normal(3)
    )
    return replace(
        circuit,
        frequency=circuit.frequency * frequency,
        damping=circuit.damping * damping,
        gain=circuit.gain * gain,
        quadratic=circuit.quadratic + quadratic,
        cubic=circuit.cubic + cubic,
        damping_2=circuit.damping_2 + damping_2,
        delay=width * _SKEW * rng.standard_normal(),
    )


def _derivative(x: Array, order: int) -> Array:
    """Of a record in 1/s, below the band's end."""

    def response(f: Array) -> NDArray[np.complex128]:
        turned = np.zeros(len(f), np.complex128)
        turned[f < _BAND] = (2j * pi * f[f < _BAND]) ** order
        return turned

    return filtered(x, RATE, response)
