"""Operating points of the runs of a campaign, as an operator would set them, and their scenario files."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.catalogue import BEAM, CRANK, SPATIAL

PointOfRun: TypeAlias = dict[str, float | str]
"""What a truth engine takes: SI numbers by name, and the beam's material."""

_BEAM_HZ, _BEAM_N, _BEAM_GAP_MM, _BEAM_S = (5.0, 40.0), (6.0, 12.0), (0.1, 0.5), (4.0, 8.0)
_CRANK_RPM, _CRANK_GAP_MM, _CRANK_S = (120.0, 260.0), (0.5, 2.0), (6.0, 12.0)
_SPATIAL_RPM, _SPATIAL_DEG, _SPATIAL_GAP_MM, _SPATIAL_S = (50.0, 250.0), (65.0, 90.0), (0.1, 0.6), (3.0, 12.0)
_LEAST_TURNS = 5.0
_SETTLE_S = 1.0


def beam_points(runs: int, beam: str, rng: np.random.Generator) -> tuple[PointOfRun, ...]:
    """Runs of one beam; frequency, amplitude and clearance are set anew for each."""
    return tuple(
        {
            "beam": beam,
            "clearance": round(_by_ratio(_BEAM_GAP_MM, float(rng.random())), 3) * 1e-3,
            "frequency": round(_by_ratio(_BEAM_HZ, share), 1),
            "amplitude": round(float(rng.uniform(*_BEAM_N)), 1),
            "sample_rate": 51_200.0,
            "settle": _SETTLE_S,
            "duration": round(float(rng.uniform(*_BEAM_S)), 1),
        }
        for share in _apart(runs, rng)
    )


def crank_points(runs: int, rng: np.random.Generator) -> tuple[PointOfRun, ...]:
    """Runs of one crank at several speeds; its clearances stay as they are."""
    gaps = [round(_by_ratio(_CRANK_GAP_MM, float(share)), 2) * 1e-3 for share in rng.random(2)]
    low, high = _CRANK_RPM
    return tuple(
        {
            "speed": round(low + share * (high - low)) * math.pi / 30,
            "clearance_1": gaps[0],
            "clearance_2": gaps[1],
            "sample_rate": 25_600.0,
            "settle": _SETTLE_S,
            "duration": round(float(rng.uniform(*_CRANK_S)), 1),
        }
        for share in _apart(runs, rng)
    )


def spatial_points(runs: int, rng: np.random.Generator) -> tuple[PointOfRun, ...]:
    """Runs of one spatial crank at several speeds; angle and clearances stay as they are."""
    gaps = [round(_by_ratio(_SPATIAL_GAP_MM, float(share)), 2) * 1e-3 for share in rng.random(2)]
    degrees = round(float(rng.uniform(*_SPATIAL_DEG)))
    low, high = _SPATIAL_RPM
    speeds = [round(low + share * (high - low)) for share in _apart(runs, rng)]
    return tuple(
        {
            "speed": rpm * math.pi / 30,
            "axis_angle": math.radians(degrees),
            "socket_clearance": gaps[0],
            "guide_clearance": gaps[1],
            "sample_rate": 25_600.0,
            "settle": _SETTLE_S,
            "duration": round(max(float(rng.uniform(*_SPATIAL_S)), _LEAST_TURNS * 60 / rpm), 1),
        }
        for rpm in speeds
    )


def scenario_text(name: str, point: PointOfRun) -> str:
    """The scenario file that an operator would have written for a run."""
    rig, (model, drive) = _sections(point)
    acquisition = {
        "sample_rate": f"{_number(point, 'sample_rate') / 1e3:g} kHz",
        "settle": f"{point['settle']:g} s",
        "duration": f"{point['duration']:g} s",
    }
    sections = {"model": model, "drive": drive, "acquisition": acquisition}
    lines = [f'name = "{name}"', f'rig = "{rig}"']
    for title, keys in sections.items():
        lines += ["", f"[{title}]", *(f'{key} = "{text}"' for key, text in keys.items())]
    return "\n".join(lines) + "\n"


def _sections(point: PointOfRun) -> tuple[str, tuple[dict[str, str], dict[str, str]]]:
    if "beam" in point:
        return BEAM, _beam_sections(point)
    if "axis_angle" in point:
        return SPATIAL, _spatial_sections(point)
    return CRANK, (_gaps(point, "clearance_1", "clearance_2"), _speed(point))


def _beam_sections(point: PointOfRun) -> tuple[dict[str, str], dict[str, str]]:
    model = {"beam": str(point["beam"]), "clearance": _millimetres(point, "clearance")}
    return model, {"frequency": f"{point['frequency']:g} Hz", "amplitude": f"{point['amplitude']:g} N"}


def _spatial_sections(point: PointOfRun) -> tuple[dict[str, str], dict[str, str]]:
    angle = {"axis_angle": f"{math.degrees(_number(point, 'axis_angle')):g} deg"}
    return {**angle, **_gaps(point, "socket_clearance", "guide_clearance")}, _speed(point)


def _gaps(point: PointOfRun, *keys: str) -> dict[str, str]:
    return {key: _millimetres(point, key) for key in keys}


def _speed(point: PointOfRun) -> dict[str, str]:
    return {"speed": f"{round(_number(point, 'speed') * 30 / math.pi, 3):g} rpm"}


def _millimetres(point: PointOfRun, key: str) -> str:
    return f"{_number(point, key) * 1e3:g} mm"


def _number(point: PointOfRun, key: str) -> float:
    return float(point[key])


def _by_ratio(limits: tuple[float, float], share: float) -> float:
    low, high = limits
    return float(low * (high / low) ** share)


def _apart(runs: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """One number between 0 and 1 for each run, each in a part of its own, in any order."""
    return (rng.permutation(runs) + rng.random(runs)) / runs
