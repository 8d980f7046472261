"""The rig as its kernel takes it: numbers in arrays, and where each state lies."""

from __future__ import annotations

from math import cos, pi, sin
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_twin.contact import ContactLaw, Friction
from sim_twin.joints.spatial import POINTS
from sim_twin.parts.beam import bending_modes
from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.rigs.spatial_slider_crank.model import SpatialSliderCrank

Array = NDArray[np.float64]
SOCKET, CONTACTS = POINTS, POINTS + 1
RIGID = 8
"""Coordinates of the rigid mechanism: pin 0-2, slider's Gibbs vector 3-5, joint angles alpha 6 and beta 7."""


class Constants(NamedTuple):
    """Numbers of the rig and its drive, SI.

    `modes` bending modes a plane with `omega`, `tip`, `sway` (modes,) as in BendingModes. `points` (8, 3)
    from the pin in the slider's frame; `pin` (3,) from the slider's centre. The crank's circle is spanned by
    `toward` and z around `centre`. `base` is frequency (rad/s), mass, damping ratio; mass 0 is a rigid base.
    `work` (9, 8) is scratch: the equations of motion, their right-hand side as the last row.
    """

    modes: int
    omega: Array
    tip: Array
    sway: Array
    damping: float
    rod_mass: float
    rod_length: float
    rod_swing: float
    rod_spin: float
    slider_mass: float
    inertia: Array
    pin: Array
    points: Array
    half_side: float
    guide_law: ContactLaw
    friction: Friction
    socket_law: ContactLaw
    socket_clearance: float
    radius: float
    toward: Array
    centre: Array
    gravity: Array
    base: Array
    drive: Array
    work: Array


def constants(rig: SpatialSliderCrank, drive: SpeedDrive) -> Constants:
    """The kernel's numbers for `rig` turned by `drive`."""
    modes, rod, guide = bending_modes(rig.rod, rig.bending_modes), rig.rod, rig.guide
    base = rig.base
    pin = np.array(rig.slider.pin)
    return Constants(
        modes=rig.bending_modes,
        omega=modes.omega,
        tip=modes.tip,
        sway=modes.sway,
        damping=rig.modal_damping,
        rod_mass=rod.mass,
        rod_length=rod.length,
        rod_swing=rod.mass * (rod.length**2 / 3 + rod.diameter**2 / 16),
        rod_spin=rod.mass * rod.diameter**2 / 8,
        slider_mass=rig.slider.mass,
        inertia=np.array(rig.slider.inertia),
        pin=pin,
        points=guide.points() - pin,
        half_side=guide.half_side,
        guide_law=guide.law,
        friction=guide.friction,
        socket_law=rig.socket.law,
        socket_clearance=rig.socket.clearance,
        radius=rig.crank_radius,
        toward=np.array([sin(rig.axis_angle), -cos(rig.axis_angle), 0.0]),
        centre=np.array([0.0, pin[1], pin[2]]),
        gravity=rig.gravity
        * np.array([sin(rig.incline), -cos(rig.incline) * sin(rig.roll), -cos(rig.incline) * cos(rig.roll)]),
        base=np.zeros(3)
        if base is None
        else np.array([2 * pi * base.frequency, base.mass, base.damping_ratio]),
        drive=np.array([drive.speed, drive.fluctuation, drive.order, drive.phase]),
        work=np.zeros((RIGID + 1, RIGID)),
    )


class Layout(NamedTuple):
    """Where things lie in a state vector of `size` entries.

    Coordinates from 0, their speeds from `speeds`: pin velocity (world), rod's angular velocity (rod's
    frame), joint rates; then crank angle `theta` (rad), motor's `work` and what is `lost` (J); the guide's
    place and velocity in y and z from `base`, where it moves.
    """

    speeds: int
    theta: int
    work: int
    lost: int
    base: int
    size: int


def layout(modes: int, moving_base: bool) -> Layout:
    """Layout with `modes` bending modes in each plane."""
    n = RIGID + 2 * modes
    return Layout(n, 2 * n, 2 * n + 1, 2 * n + 2, 2 * n + 3, 2 * n + 3 + 4 * moving_base)
