"""What a healthy rig may differ by: one draw of a lab's rig, and one of a run on it.

Standard deviations and noise of the impact beam; the rest belongs to the rig, drive and clearance to the run.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sim_twin.rigs.impact_beam.channels import channel_names, channel_unit
from sim_twin.rigs.impact_beam.model import ImpactBeam, SineDrive
from sim_twin.rigs.impact_beam.twin import BeamTwin
from sim_twin.sensors import SensorChain

_NOISE = {"N": 0.05, "m/s2": 0.03}
_DRIVE_NOISE = 0.02
_GAIN, _YOKE_GAIN, _SKEW = 0.005, 0.01, 2e-6


def noise_of(channel: str) -> float:
    """Rms noise of a channel, in its unit."""
    return _DRIVE_NOISE if channel == "drive.force" else _NOISE[channel_unit(channel)]


def nominal_sensors(rig: ImpactBeam) -> dict[str, SensorChain]:
    """The measuring chains without tolerances, noise in place."""
    return {name: SensorChain(noise=noise_of(name)) for name in channel_names(rig)}


def draw_healthy(
    twin: BeamTwin, rng: np.random.Generator, run_rng: np.random.Generator | None = None
) -> BeamTwin:
    """Return `twin` as a healthy rig may really be, on one run.

    `rng` draws what belongs to the rig, `run_rng` (default: the same) clearance and drive, set anew each run.
    """
    each_run = rng if run_rng is None else run_rng
    rig, sensors = _draw_rig(twin.rig, rng), _draw_sensors(twin, rng)
    rig = replace(rig, clearance=rig.clearance * _scaled(each_run, 0.02))
    return BeamTwin(rig, _draw_drive(twin.drive, each_run), sensors)


def _scaled(rng: np.random.Generator, deviation: float) -> float:
    return float(1 + deviation * rng.standard_normal())


def _draw_rig(rig: ImpactBeam, rng: np.random.Generator) -> ImpactBeam:
    part = rig.beam
    beam = replace(
        part,
        E=part.E * _scaled(rng, 0.01),
        rho=part.rho * _scaled(rng, 0.005),
        length=part.length * _scaled(rng, 0.003),
        width=part.width * _scaled(rng, 0.003),
        thickness=part.thickness * _scaled(rng, 0.003),
    )
    common = _scaled(rng, 0.12)
    damping = tuple(float(max(zeta * common * _scaled(rng, 0.09), 1e-4)) for zeta in rig.modal_damping)
    return replace(
        rig,
        beam=beam,
        modal_damping=damping,
        contact_stiffness=rig.contact_stiffness * _scaled(rng, 0.05),
        contact_damping=rig.contact_damping * max(_scaled(rng, 0.2), 0.05),
        hertz=None if rig.hertz is None else rig.hertz * _scaled(rng, 0.05),
        shaker_mass=rig.shaker_mass * _scaled(rng, 0.003),
        yoke_frequency=rig.yoke_frequency * _scaled(rng, 0.02),
    )


def _draw_drive(drive: SineDrive, rng: np.random.Generator) -> SineDrive:
    return replace(
        drive, amplitude=drive.amplitude * _scaled(rng, 0.01), frequency=drive.frequency * _scaled(rng, 2e-4)
    )


def _draw_sensors(twin: BeamTwin, rng: np.random.Generator) -> dict[str, SensorChain]:
    return {
        name: _drawn(
            twin.sensors.get(name, SensorChain(noise=noise_of(name))),
            _scaled(rng, _YOKE_GAIN if name == "yoke.force" else _GAIN),
            _SKEW * float(rng.standard_normal()),
        )
        for name in twin.channels
    }


def _drawn(chain: SensorChain, gain: float, skew: float) -> SensorChain:
    return replace(chain, gain=chain.gain * gain, skew=chain.skew + skew)
