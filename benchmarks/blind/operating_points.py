"""Operating points of the runs of a campaign, as an operator would set them, and their scenario files."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

PointOfRun: TypeAlias = dict[str, float | str]
"""What a truth engine takes: SI numbers by name, and the beam's material."""

_BEAM_HZ, _BEAM_N, _BEAM_GAP_MM, _BEAM_S = (5.0, 40.0), (6.0, 12.0), (0.1, 0.5), (4.0, 8.0)
_CRANK_RPM, _CRANK_GAP_MM, _CRANK_S = (120.0, 260.0), (0.5, 2.0), (6.0, 12.0)
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


def scenario_text(name: str, point: PointOfRun) -> str:
    """The scenario file that an operator would have written for a run."""
    model, drive = _beam_sections(point) if "beam" in point else _crank_sections(point)
    rig = "impact_beam" if "beam" in point else "planar_slider_crank"
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


def _beam_sections(point: PointOfRun) -> tuple[dict[str, str], dict[str, str]]:
    model = {"beam": str(point["beam"]), "clearance": _millimetres(point, "clearance")}
    return model, {"frequency": f"{point['frequency']:g} Hz", "amplitude": f"{point['amplitude']:g} N"}


def _crank_sections(point: PointOfRun) -> tuple[dict[str, str], dict[str, str]]:
    model = {key: _millimetres(point, key) for key in ("clearance_1", "clearance_2")}
    return model, {"speed": f"{round(_number(point, 'speed') * 30 / math.pi, 3):g} rpm"}


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
