"""What passed through the planar slider-crank's joints to the frame, from how the frame shakes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.signal.windows import tukey

from sim_twin.rigs.cycles import Cycles
from sim_twin.rigs.planar_slider_crank.channels import CRANK_X, CRANK_Y, PISTON_Y
from sim_twin.rigs.planar_slider_crank.model import FrameMode
from sim_twin.rigs.rig_model import JointRecord
from sim_twin.twin import AnyTwin

Array = NDArray[np.float64]
_JOINTS = (
    (CRANK_X, "crank bearing, along the guide", "joint 1"),
    (CRANK_Y, "crank bearing, across the guide", "joint 1"),
    (PISTON_Y, "piston guide", "guide"),
)
_LOWEST = 0.7
"""Of the frequency of the crank: below it an accelerometer tells nothing of a force."""
_FADE_CYCLES = 1.0


def joint_records(
    twin: AnyTwin, records: Mapping[str, NDArray[np.floating]], cycles: Cycles
) -> tuple[JointRecord, ...]:
    """Forces on the frame, without their constant part; displacement and velocity are the slider's.

    Joints are taken as ideal for its motion, 0 in the middle of the stroke.
    """
    rig = twin.rig
    count = min(len(record) for record in records.values())
    theta = cycles.phases(count)
    r, length = rig.crank_length, rig.rod_length
    rod = np.sqrt(length**2 - (r * np.sin(theta)) ** 2)
    along = r * np.cos(theta) + rod - length
    speed = -2 * np.pi * cycles.frequency * r * np.sin(theta) * (1 + r * np.cos(theta) / rod)
    return tuple(
        JointRecord(joint, location, _force(rig.frames[name], records[name][:count], cycles), along, speed)
        for name, joint, location in _JOINTS
        if name in records
    )


def _force(mode: FrameMode, acceleration: NDArray[np.floating], cycles: Cycles) -> Array:
    """The force in N that shakes an oscillator so; not at the ends, which have to be faded out."""
    count, faded = len(acceleration), int(_FADE_CYCLES * cycles.rate / cycles.frequency)
    fade = min(1.0, 2 * faded / count)
    level = float(np.mean(acceleration, dtype=np.float64))
    shaken = fft.rfft((np.asarray(acceleration, dtype=np.float64) - level) * tukey(count, fade))
    frequency = fft.rfftfreq(count, 1 / cycles.rate)
    told = frequency >= _LOWEST * cycles.frequency
    s, omega = 2j * np.pi * frequency[told], 2 * np.pi * mode.frequency
    force = np.zeros(len(shaken), dtype=np.complex128)
    force[told] = shaken[told] * mode.mass * (s**2 + 2 * mode.damping_ratio * omega * s + omega**2) / s**2
    shaking = np.full(count, np.nan)
    shaking[faded : count - faded] = fft.irfft(force, count)[faded : count - faded]
    return shaking
