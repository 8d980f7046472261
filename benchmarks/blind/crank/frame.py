"""The frame under the accelerometers: three oscillators, driven by what the mechanism does to it."""

from __future__ import annotations

import numpy as np
from scipy import signal

from benchmarks.blind.crank.mechanism import Motion
from benchmarks.blind.crank.parts import Array
from benchmarks.blind.crank.rig import CRANK_X, CRANK_Y, FRAME_MASS, PISTON_Y, Crank, Mode


def accelerations(crank: Crank, motion: Motion, step: float) -> dict[str, Array]:
    """Accelerations of the frame in m/s2 at every step, shape (n,) each; at rest before the first."""
    speed = np.gradient(motion.angle, step)
    centrifugal = crank.crank_mass * crank.crank_length / 2 * speed**2
    forces = {
        CRANK_Y: motion.pin[:, 1] + centrifugal * np.sin(motion.angle),
        CRANK_X: motion.pin[:, 0] + centrifugal * np.cos(motion.angle),
        PISTON_Y: motion.piston[:, 1],
    }
    return {name: acceleration(force, crank.frames[name], step) for name, force in forces.items()}


def acceleration(force: Array, mode: Mode, step: float) -> Array:
    """Acceleration of one oscillator under `force` in N; bilinear, which bends frequencies by 1e-5."""
    omega = 2 * np.pi * mode.frequency
    b, a = signal.bilinear(
        [1 / FRAME_MASS, 0.0, 0.0], [1.0, 2 * mode.damping_ratio * omega, omega**2], fs=1 / step
    )
    return np.asarray(signal.lfilter(b, a, force))
