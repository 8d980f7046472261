"""The frame under the accelerometers: oscillators, exact for forces that are linear between samples."""

from __future__ import annotations

from math import pi

import numpy as np
from scipy.signal import cont2discrete, ss2tf

from sim_twin.rigs.planar_slider_crank.model import FrameMode
from sim_twin.sensors import LinearFilter


def frame_acceleration(mode: FrameMode, rate: float) -> LinearFilter:
    """Acceleration in m/s2 of an oscillator at rest, from the force on it in N, sampled at `rate` Hz."""
    omega = 2 * pi * mode.frequency
    decay = 2 * mode.damping_ratio * omega
    A = np.array([[0.0, 1.0], [-(omega**2), -decay]])
    B, C, D = (
        np.array([[0.0], [1 / mode.mass]]),
        np.array([[-(omega**2), -decay]]),
        np.array([[1 / mode.mass]]),
    )
    A, B, C, D, _ = cont2discrete((A, B, C, D), 1 / rate, method="foh")
    numerator, denominator = ss2tf(A, B, C, D)
    return LinearFilter(np.asarray(numerator[0]), np.asarray(denominator))
