"""The rigid spatial slider-crank in MuJoCo and in this twin: first peaks and speed, alternately in one run.

The same mechanism: free slider, universal joint as two hinges, crank kept at its speed by a huge inertia,
socket as a limit on the distance between two sites, guide points as small spheres over planes. MuJoCo's
contacts are made into F = k d + c v by negative `solref` scaled with its own inverse inertia, at impedance
0.001. Its step is the largest of those tried whose first peaks come within 0.5 % of the twin's at its finest.

Needs the optional extra `peers`. Usage: python -m benchmarks.spatial_speed
"""

from __future__ import annotations

import time
from dataclasses import replace
from math import pi
from typing import Any

import mujoco
import numpy as np

from sim_twin.mechanisms.run import CONTACT, PEAK
from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.rigs.spatial_slider_crank.constants import SOCKET, constants
from sim_twin.rigs.spatial_slider_crank.model import SpatialSliderCrank
from sim_twin.rigs.spatial_slider_crank.motion import PRECISION, ideal_state, simulation, step_limits

RPM = 230.0
SPEED = RPM * 2 * pi / 60
STEPS = {
    "Euler": (2e-5, 1e-5, 5e-6, 2e-6),
    "implicitfast": (2e-5, 1e-5, 5e-6, 2e-6),
    "RK4": (2e-5, 1e-5, 5e-6, 2e-6),
}
COMPARED, WITHIN, ROUNDS, IMPEDANCE = 3, 0.005, 3, 1e-3
SHELL, DISC = 1e-4, 1e3


def world(rig: SpatialSliderCrank, integrator: str, step: float) -> str:
    """The mechanism as MuJoCo reads it; contact parameters are set once the inertias are known."""
    across = np.cos(rig.incline)
    g = rig.gravity * np.array([np.sin(rig.incline), -across * np.sin(rig.roll), -across * np.cos(rig.roll)])
    rod, slider, h = rig.rod, rig.slider, rig.guide_half_side
    across = rod.mass * (rod.length**2 / 12 + rod.diameter**2 / 16)
    faces = {"py": "0 -1 0 0", "ny": "0 1 0 0", "pz": "0 0 0 -1", "nz": "0 0 0 1"}
    normals = {"py": (0, 1, 0), "ny": (0, -1, 0), "pz": (0, 0, 1), "nz": (0, 0, -1)}
    outside = np.array(list(normals.values()) * 2) * SHELL
    spheres = "".join(
        f'<geom name="s{i}" type="sphere" size="{SHELL}" pos="{x} {y} {z}" mass="0"/>'
        for i, (x, y, z) in enumerate(rig.guide.points() + outside)
    )
    planes = "".join(
        f'<geom name="{name}" type="plane" size="1 1 1" pos="{h * n[0]} {h * n[1]} {h * n[2]}" '
        f'zaxis="{n[0]} {n[1]} {n[2]}"/>'
        for name, n in normals.items()
    )
    pairs = "".join(
        f'<pair geom1="{name}" geom2="s{i}" condim="3" friction="{rig.friction} {rig.friction}"/>'
        for i, name in enumerate(list(faces) * 2)
    )
    a = rig.axis_angle
    return f"""<mujoco><compiler angle="radian"/>
      <option timestep="{step}" gravity="{g[0]} {g[1]} {g[2]}" integrator="{integrator}" cone="elliptic"/>
      <default><geom contype="0" conaffinity="0"/></default>
      <worldbody>{planes}
        <body name="crank">
          <joint name="turn" type="hinge" axis="{-np.cos(a)} {-np.sin(a)} 0" armature="{DISC}"/>
          <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
          <site name="socket" pos="{rig.crank_radius * np.sin(a)} {-rig.crank_radius * np.cos(a)} 0"/></body>
        <body name="slider"><freejoint/>
          <inertial pos="0 0 0" mass="{slider.mass}"
            diaginertia="{" ".join(map(str, slider.inertia))}"/>{spheres}
          <body name="rod" pos="{" ".join(map(str, slider.pin))}">
            <joint name="alpha" type="hinge" axis="0 1 0"/><joint name="beta" type="hinge" axis="0 0 1"/>
            <inertial pos="{-rod.length / 2} 0 0" mass="{rod.mass}"
              diaginertia="{rod.mass * rod.diameter**2 / 8} {across} {across}"/>
            <site name="ball" pos="{-rod.length} 0 0"/></body></body>
      </worldbody>
      <tendon><spatial name="gap" limited="true" range="-1 {rig.socket_clearance}">
        <site site="socket"/><site site="ball"/></spatial></tendon>
      <contact>{pairs}</contact></mujoco>"""


def peer(rig: SpatialSliderCrank, integrator: str, step: float) -> tuple[Any, Any]:
    """MuJoCo's model and data, at the twin's start."""
    model = mujoco.MjModel.from_xml_string(world(rig, integrator, step))
    y = ideal_state(constants(rig, SpeedDrive(SPEED)), 0.0)
    data = mujoco.MjData(model)
    data.qpos[:] = [0.0, y[0], y[1] - rig.slider.pin[1], y[2] - rig.slider.pin[2], 1, 0, 0, 0, y[6], y[7]]
    data.qvel[:] = [SPEED, y[8], 0, 0, 0, 0, 0, y[14], y[15]]
    stiff = np.array([IMPEDANCE, IMPEDANCE, 1e-9, 0.5, 1.0])
    weight = model.tendon_invweight0[0]
    model.tendon_solref_lim[0] = -np.array([rig.socket_stiffness, rig.socket_damping]) * weight
    model.tendon_solimp_lim[0] = stiff
    weight = model.body_invweight0[model.body("slider").id, 0]
    model.pair_solref[:] = -np.array([rig.guide_stiffness, rig.guide_damping]) * weight
    model.pair_solimp[:] = stiff
    return model, data


def peaks_of_peer(rig: SpatialSliderCrank, integrator: str, step: float) -> np.ndarray:
    """Largest forces of the socket's first contacts, N."""
    model, data = peer(rig, integrator, step)
    peaks, peak = list[float](), 0.0
    while len(peaks) < COMPARED and data.time < 0.05:
        mujoco.mj_step(model, data)
        limit = data.efc_force[data.efc_type == mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON]
        force = float(limit[0]) if len(limit) else 0.0
        if peak > 0.0 and force == 0.0:
            peaks.append(peak)
        peak = max(peak, force) if force > 0.0 else 0.0
    return np.array(peaks)


def first_peaks(rig: SpatialSliderCrank, precision: float) -> np.ndarray:
    """The same of the twin."""
    run = simulation(rig, SpeedDrive(SPEED), 0.0, 0.03, step_limits(rig, precision))
    episodes = run.advance(2).episodes
    return np.asarray(episodes[episodes[:, CONTACT] == SOCKET][:COMPARED, PEAK])


def row(name: str, peaks: np.ndarray, exact: np.ndarray) -> float:
    """Print peaks with their errors; returns the largest error."""
    errors = peaks / exact - 1
    text = ", ".join(
        f"{peak:7.2f} N ({100 * error:+.2f} %)" for peak, error in zip(peaks, errors, strict=True)
    )
    print(f"  {name:28s}{text}")
    return float(np.abs(errors).max())


def speed_of_peer(rig: SpatialSliderCrank, integrator: str, step: float, seconds: float) -> float:
    """Simulated seconds per second."""
    model, data = peer(rig, integrator, step)
    start = time.process_time()
    mujoco.mj_step(model, data, nstep=round(seconds / step))
    return seconds / (time.process_time() - start)


def speed(rig: SpatialSliderCrank, seconds: float, precision: float = PRECISION) -> float:
    """Simulated seconds per second, contacts and 51 200 samples a second included."""
    run = simulation(rig, SpeedDrive(SPEED), 0.0, 1 / 51_200, step_limits(rig, precision))
    run.advance(10)
    start = time.process_time()
    run.advance(round(seconds * 51_200))
    return seconds / (time.process_time() - start)


def best_of_peer(rig: SpatialSliderCrank, exact: np.ndarray) -> tuple[str, float]:
    """Of each integrator the largest step that comes within the error, the faster of them."""
    fit = []
    for integrator, steps in STEPS.items():
        for step in steps:
            peaks = peaks_of_peer(rig, integrator, step)
            if row(f"MuJoCo {integrator}, {1e6 * step:.0f} us", peaks, exact) < WITHIN:
                fit.append((speed_of_peer(rig, integrator, step, 0.2), integrator, step))
                break
    if not fit:
        raise SystemExit(f"no step of MuJoCo's comes within {100 * WITHIN:.1f} %")
    return max(fit)[1:]


def main() -> None:
    """Print first peaks, then the speeds, measured alternately."""
    # Without roll, friction 0.1: where MuJoCo gives the same second peak too.
    flexible = SpatialSliderCrank(incline=np.deg2rad(66.0), roll=0.0, friction=0.1)
    rigid = replace(flexible, rod_modes=0)
    exact = first_peaks(rigid, 1e-12)
    print(f"peaks of the first {COMPARED} contacts in the socket, rigid rod, {RPM:.0f} rpm")
    row("twin, finest", exact, exact)
    row("twin, as used", first_peaks(rigid, PRECISION), exact)
    integrator, step = best_of_peer(rigid, exact)
    rows = []
    for _ in range(ROUNDS):
        rows.append((speed(rigid, 4.0), speed_of_peer(rigid, integrator, step, 1.0), speed(flexible, 4.0)))
    twin, mujocos, bending = np.median(rows, axis=0)
    ratios = [row[0] / row[1] for row in rows]
    print("simulated seconds per second of processor time, one core, medians of alternating runs")
    print(
        f"  twin, rigid rod             {twin:8.2f}\n"
        f"  MuJoCo {integrator}, {1e6 * step:.0f} us {mujocos:9.2f}"
    )
    print(f"  ratio                       {np.median(ratios):8.1f}  ({min(ratios):.1f} to {max(ratios):.1f})")
    print(f"  twin, flexible rod, 8 modes {bending:8.2f}  (1 is real time)")


if __name__ == "__main__":
    main()
