"""A circuit that oscillates like a driven mass on a spring: the twin is the linear oscillator.

It is driven by the recorded input, so the twin can follow the experiment; a block is one random multisine of
14 s. A fingerprint is the force that the linear twin lacks, by the response's own derivatives up to 150 Hz:
its mean where the response, its rate or the input lie between certain bounds.

What healthy circuits differ by: frequency 0.5 %, damping 3 % and gain 1 % from what the first seconds say,
where the response is small; 0.5 % at 0.2 V in the linearity of spring and damper, as analog circuits have;
20 us between the channels, and the noise of 0.25 mV that both show before the input begins.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import pi
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from sim_twin.diagnosis.cause import Cause
from sim_twin.diagnosis.fingerprint import Cell, Layout
from sim_twin.diagnosis.subject import Draw, Observed
from tests.own_rigs.effects import cause, number, with_effects
from tests.own_rigs.oscillator import Circuit, filtered

Array = NDArray[np.float64]
Blocks = NDArray[np.float32]
RATE = 1e7 / 2**14
_QUIET, _SMALL = 215, 6000
"""Samples: before there is an input; until when the response is small."""
_FIRST, _NEXT, _LENGTH, _MULTISINES = 40_546, 8693, 8640, 9
"""Samples: start of the first multisine, from one start to the next, what is used of each."""
_EDGE = 200
_BAND = 150.0
_BOUNDS = np.array([-2.4, -1.8, -1.2, -0.7, -0.25, 0.25, 0.7, 1.2, 1.8, 2.4])
_WATCHED = {"response": 0.055, "rate": 0.055, "input": 0.0225}
"""What the force is compared with, and the unit of its bounds: V, w times V, V; about root mean squares."""
_FREQUENCY, _DAMPING, _GAIN, _SKEW, _NOISE = 0.005, 0.03, 0.01, 20e-6, 0.25e-3
_LINEARITY, _FULL = 0.005, 0.2


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

    @property
    def layout(self) -> Layout:
        """Mean lacking force, in root mean squares of the input, by what it goes with."""
        cells = [Cell(0, channel, "force", 1) for channel in _WATCHED for _ in range(len(_BOUNDS) - 1)]
        return Layout(tuple(cells))

    @property
    def causes(self) -> tuple[Cause, ...]:
        return CAUSES

    def observe(self, draws: Sequence[Draw]) -> list[Observed]:
        """Give each circuit as many of the multisines as its draw has blocks."""
        return [self._observe(draw) for draw in draws]

    def _observe(self, draw: Draw) -> Observed:
        rng = np.random.default_rng(draw.seed)
        circuit = _healthy(with_effects(self.twin, draw.effects), rng)
        inputs = self.inputs[rng.permutation(len(self.inputs))[: draw.blocks]]
        responses = [circuit.respond(u, RATE) for u in inputs]
        if not np.isfinite(responses).all():  # a softening spring lets go
            return (None,) * len(draw.sensing)
        noise = _NOISE * rng.standard_normal((2, *inputs.shape))
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
        means = [_means(lacking[inside], each[inside] / unit) for each, unit in watched]
        return np.asarray(np.concatenate(means) / u.std())


def measured(path: Path, blocks: int) -> tuple[Silverbox, Blocks]:
    """The subject, its twin matched to the record's small beginning, and `blocks` measured fingerprints."""
    with np.load(path) as table:
        u, y = (table[f"SNLS80mV_V{k}"].astype(np.float64) for k in (1, 2))
    u, y = u - u[:_QUIET].mean(), y - y[:_QUIET].mean()
    starts = _FIRST + _NEXT * np.arange(_MULTISINES)
    inputs, outputs = (np.array([each[at : at + _LENGTH] for at in starts]) for each in (u, y))
    subject = Silverbox(_matched(u[:_SMALL], y[:_SMALL]), inputs)
    return subject, subject.fingerprints(inputs[:blocks], outputs[:blocks])


def _matched(u: Array, y: Array) -> Circuit:
    """The linear circuit that answers most like the measured one."""

    def left(numbers: Array) -> Array:
        return Circuit(*numbers.tolist()).respond(u, RATE)[_EDGE:] - y[_EDGE:]

    found = least_squares(left, [70.0, 0.05, 1.0], x_scale=[1.0, 0.01, 0.1])
    return Circuit(*found.x.tolist())


def _healthy(circuit: Circuit, rng: np.random.Generator) -> Circuit:
    frequency, damping, gain = 1 + np.array([_FREQUENCY, _DAMPING, _GAIN]) * rng.standard_normal(3)
    quadratic, cubic, damping_2 = (
        _LINEARITY / np.array([_FULL, _FULL**2, _FULL / 0.05]) * rng.standard_normal(3)
    )
    return replace(
        circuit,
        frequency=circuit.frequency * frequency,
        damping=circuit.damping * damping,
        gain=circuit.gain * gain,
        quadratic=circuit.quadratic + quadratic,
        cubic=circuit.cubic + cubic,
        damping_2=circuit.damping_2 + damping_2,
        delay=_SKEW * rng.standard_normal(),
    )


def _derivative(x: Array, order: int) -> Array:
    """Of a record in 1/s, below the band's end."""

    def response(f: Array) -> NDArray[np.complex128]:
        turned = np.zeros(len(f), np.complex128)
        turned[f < _BAND] = (2j * pi * f[f < _BAND]) ** order
        return turned

    return filtered(x, RATE, response)


def _means(force: Array, watched: Array) -> Array:
    """Mean force where what is watched lies in each class."""
    classes = np.digitize(watched, _BOUNDS)
    counts = np.bincount(classes, minlength=len(_BOUNDS) + 1)
    means = np.bincount(classes, force, len(_BOUNDS) + 1) / np.maximum(counts, 1)
    return np.asarray(means[1:-1])
