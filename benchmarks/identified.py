"""Whether `rattle identify` finds the values of rigs that lie far from what their scenarios say.

Usage: python -m benchmarks.identified rigs DIR [--count 20] [--seed 1] [--only RIG]
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.blind.campaigns import PointOfRun
from benchmarks.blind.catalogue import BEAM, CRANK
from benchmarks.blind.crank.rig import CRANK_X, CRANK_Y, PISTON_Y
from benchmarks.blind.engines import engine_of
from benchmarks.blind.logs import write_log
from benchmarks.blind.operating_points import beam_points, crank_points, scenario_text

FREE: Final = {
    BEAM: (
        "beam_modulus", "beam_density", "beam_length", "beam_width", "beam_thickness", "contact_stiffness",
        "contact_damping", "modal_damping", "yoke_frequency", "clearance",
    ),
    CRANK: (
        "crank_length", "crank_mass", "rod_length", "rod_mass", "rod_inertia", "piston_mass", "clearance_1",
        "clearance_2", "restitution", "friction", *(
            f"frame_{where}_{what}" for where in ("crank_y", "crank_x", "piston_y")
            for what in ("frequency", "damping")
        ),
    ),
}  # fmt: skip
_FRAMES: Final = {"crank_y": CRANK_Y, "crank_x": CRANK_X, "piston_y": PISTON_Y}


def beam_of(values: Mapping[str, float], rig: Any) -> Any:
    """The truth's beam with the values of keys of [model]."""
    beam, stop = rig.beam, rig.upper
    names = {"modulus": "beam_modulus", "density": "beam_density", "length": "beam_length",
             "width": "beam_width", "thickness": "beam_thickness"}  # fmt: skip
    ratios = np.array(beam.damping) / np.mean(beam.damping) * values["modal_damping"]
    beam = replace(beam, **{name: values[key] for name, key in names.items()}, damping=tuple(ratios.tolist()))
    stop = replace(
        stop,
        gap=values["clearance"],
        stiffness=values["contact_stiffness"],
        damping=values["contact_damping"],
    )
    return replace(rig, beam=beam, upper=stop, lower=stop, head=values["yoke_frequency"])


def crank_of(values: Mapping[str, float], crank: Any) -> Any:
    """The truth's crank with the values of keys of [model]; the rod's inertia goes with mass and length."""
    plain = ("crank_length", "crank_mass", "rod_length", "rod_mass", "piston_mass", "restitution", "friction")
    frames = {
        channel: replace(
            crank.frames[channel],
            frequency=values[f"frame_{where}_frequency"],
            damping_ratio=values[f"frame_{where}_damping"],
        )
        for where, channel in _FRAMES.items()
    }
    gaps = (values["clearance_1"], values["clearance_2"])
    return replace(crank, **{key: values[key] for key in plain}, clearances=gaps, frames=frames)


BUILT: Final[Mapping[str, Callable[[Mapping[str, float], Any], Any]]] = {BEAM: beam_of, CRANK: crank_of}


@dataclass(frozen=True, slots=True)
class Truth:
    """A rig with its runs."""

    rig: str
    number: int
    points: tuple[PointOfRun, ...]
    values: Mapping[str, float]


def points_of(rig: str, runs: int, rng: np.random.Generator) -> tuple[PointOfRun, ...]:
    if rig == CRANK:
        return crank_points(runs, rng)
    first, *others = beam_points(runs, "steel", rng)
    return (first, *({**each, "clearance": first["clearance"]} for each in others))


def record_truth(
    folder: Path, rig: str, points: tuple[PointOfRun, ...], values: Mapping[str, float], seed: int
) -> list[Path]:
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"run{number + 1}.mcap" for number in range(len(points))]
    engine: Any = engine_of(rig)
    for number, (path, point) in enumerate(zip(paths, points, strict=True)):
        if path.exists():
            continue
        recording = engine.record(point, (), seed, number, built=partial(BUILT[rig], values))
        part = path.with_suffix(".part")
        part.unlink(missing_ok=True)
        write_log(part, recording, scenario_text(f"rig {seed}, run {number + 1}", point), path.stem, number)
        part.rename(path)
    return paths
