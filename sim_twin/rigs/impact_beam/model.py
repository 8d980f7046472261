"""Parameters of the impact beam, with the values of its source as defaults."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_twin.parts.beam import Beam
from sim_twin.ranges import require
from sim_twin.rigs.impact_beam.base.model import FlexibleBase
from sim_twin.rigs.impact_beam.channels import channel_names

FLEXURE_ROTATION = 0.16
"""N m/rad: EI/l of the flexure 4 x 19 x 0.127 mm as the source states it (Table 2)."""
FLEXURE_TRANSLATION = 1.258e5
"""N/m: 12 EI/l^3 of the same flexure."""


@dataclass(frozen=True, slots=True)
class BaseMass:
    """The yoke as a mass on spring and damper: `frequency` Hz, `mass` kg, `damping_ratio`."""

    frequency: float
    mass: float
    damping_ratio: float

    def __post_init__(self) -> None:
        require("BaseMass", "frequency", self.frequency, 0.0, unit="Hz", above=True)
        require("BaseMass", "mass", self.mass, 0.0, unit="kg", above=True)
        require("BaseMass", "damping_ratio", self.damping_ratio, 0.0, 1.0)


@dataclass(frozen=True, slots=True)
class ImpactBeam:
    """The rig, in SI.

    `clearance` g is half the free motion of the tip, `rest_offset` where the tip rests (towards the upper
    stop). `modal_damping` has one ratio for each mode kept. `pivot_stiffness` (N/m) None is the ideal pin.
    `hertz` (N/m^1.5) replaces the linear `contact_stiffness`. `pivot_friction` is a Coulomb torque in N m.
    `yoke_frequency` is the impedance head's mode. `stations` (percent of L) carry accelerometers.
    """

    beam: Beam
    clamped: bool
    contact_stiffness: float
    contact_damping: float
    modal_damping: tuple[float, ...]
    clearance: float = 0.127e-3
    rest_offset: float = 0.0
    rotation_stiffness: float = FLEXURE_ROTATION
    pivot_stiffness: float | None = None
    drive_position: float = 0.69
    shaker_mass: float = 0.0
    shaker_stiffness: float = 0.0
    shaker_damping: float = 0.0
    hertz: float | None = None
    pivot_friction: float = 0.0
    base: BaseMass | FlexibleBase | None = None
    yoke_frequency: float = 700.0
    yoke_damping: float = 0.03
    stations: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        for name, unit in _NOT_NEGATIVE.items():
            require("ImpactBeam", name, getattr(self, name), 0.0, unit=unit)
        for ratio in self.modal_damping:
            require("ImpactBeam", "modal_damping", ratio, 0.0, 1.0)
        fixed = 2 if self.clamped else int(self.pivot_stiffness is None)
        require("ImpactBeam", "modes", self.modes, 1, 2 * (self.beam.elements + 1) - fixed)
        require("ImpactBeam", "drive_position", self.drive_position, 0.0, 1.0, "L")
        for name, unit in (("hertz", "N/m^1.5"), ("pivot_stiffness", "N/m")):
            if getattr(self, name) is not None:
                require("ImpactBeam", name, getattr(self, name), 0.0, unit=unit, above=True)
        require("ImpactBeam", "rest_offset", abs(self.rest_offset), 0.0, self.clearance, "m")
        require("ImpactBeam", "rotation_stiffness", self.rotation_stiffness, 0.0, unit="N m/rad", above=True)
        require("ImpactBeam", "yoke_frequency", self.yoke_frequency, 0.0, unit="Hz", above=True)
        require("ImpactBeam", "yoke_damping", self.yoke_damping, 0.0, 1.0)

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels that a twin of it predicts."""
        covered = isinstance(self.base, FlexibleBase) and self.base.cover is not None
        return channel_names(self.stations, covered)

    @property
    def modes(self) -> int:
        """Number of modes kept."""
        return len(self.modal_damping)


_NOT_NEGATIVE = {
    "contact_stiffness": "N/m",
    "contact_damping": "N s/m",
    "clearance": "m",
    "shaker_mass": "kg",
    "shaker_stiffness": "N/m",
    "shaker_damping": "N s/m",
    "pivot_friction": "N m",
}
_BEAMS = {
    "steel": (Beam(207e9, 7800.0, 0.28, 0.019, 0.00635, 37), False, 1.5e7, 20.0),
    "aluminium": (Beam(70e9, 2700.0, 0.28, 0.019, 0.00318, 37), True, 9.6e6, 7.0),
}


def nominal(beam: str = "steel", modes: int = 15, elements: int = 37, damping: float = 0.01) -> ImpactBeam:
    """Return the rig of the source with its `steel` or `aluminium` beam (Table 2)."""
    part, clamped, stiffness, contact_damping = _BEAMS[beam]
    resized = Beam(part.E, part.rho, part.length, part.width, part.thickness, elements)
    return ImpactBeam(resized, clamped, stiffness, contact_damping, (damping,) * modes)


@dataclass(frozen=True, slots=True)
class SineDrive:
    """The coil's force: offset + A (sin p + second sin 2p + third sin 3p), p = 2 pi f t + phase.

    `amplitude` A and `offset` in N, `frequency` f in Hz; `second`, `third` are fractions of A.
    """

    amplitude: float
    frequency: float
    offset: float = 0.0
    second: float = 0.0
    third: float = 0.0

    def __post_init__(self) -> None:
        require("SineDrive", "frequency", self.frequency, 0.0, unit="Hz", above=True)
        for name in ("amplitude", "offset", "second", "third"):
            require("SineDrive", name, getattr(self, name), -1e6, 1e6)

    def phasors(self) -> NDArray[np.complex128]:
        """Complex amplitudes of orders 0, 1, 2, 3, shape (4,): the force is the sum of Re(U_k exp(i k p))."""
        A = self.amplitude
        return np.array([self.offset, -1j * A, -1j * A * self.second, -1j * A * self.third])

    def force(self, phase: NDArray[np.float64]) -> NDArray[np.float64]:
        """Force in N at phases p (rad), same shape."""
        second, third = self.second * np.sin(2 * phase), self.third * np.sin(3 * phase)
        return np.asarray(self.offset + self.amplitude * (np.sin(phase) + second + third))

    def force_at_steps(self, phase: float, step: float, count: int) -> NDArray[np.float64]:
        """Force in N at phases `phase` + k `step` (rad), k = 0 ... `count` - 1, without sines."""
        wide = 256
        coarse = np.exp(1j * (phase + step * wide * np.arange(-(-count // wide))))
        turn = np.outer(coarse, np.exp(1j * step * np.arange(wide))).ravel()[:count]
        force = self.offset + self.amplitude * turn.imag
        if self.second or self.third:
            double = turn * turn
            force = force + self.amplitude * (self.second * double.imag + self.third * (double * turn).imag)
        return np.asarray(force)
