"""Operating points of the runs of a campaign, as an operator would set them, and their scenario files."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.catalogue import BEAM, CRANK, SPATIAL

PointOfRun: TypeAlias = dict[str, float | str]
"""What a truth engine takes: SI numbers by name, and the beam's material."""

_DURATION_S, CRANK_RPM, _RATES_HZ = (3.0, 12.0), (100.0, 260.0), (25_600.0, 51_200.0)
_BEAM_HZ, _BEAM_N, _BEAM_GAP_MM = (5.0, 40.0), (6.0, 12.0), (0.1, 0.5)
_CRANK_GAP_MM, _SPATIAL_GAP_MM, _SPATIAL_DEG = (0.5, 2.0), (0.1, 0.6), (65.0, 90.0)
_SETTLE_S = 1.0
_FEWER_CHANNELS, _MOST_MISSING = 0.4, 2
_MAY_LACK = {
    BEAM: ("contact.force_upper", "contact.force_lower", "yoke.force", "base.acceleration"),
    CRANK: (
        "crank_frame.acceleration_y", "crank_frame.acceleration_x", "piston_frame.acceleration_y",
        "crank.angle", "crank.marker",
    ),
    SPATIAL: (*(f"slider.force_{point}" for point in range(1, 9)), "socket.force", "motor.tachometer"),
}  # fmt: skip
_TELLS_THE_CYCLE = {"crank.angle", "crank.marker"}
"""Of the planar crank; one of them stays."""


def points(rig: str, runs: int, rng: np.random.Generator, beam: str = "steel") -> tuple[PointOfRun, ...]:
    """Runs of one rig: speed (or frequency), clearances, sample rate and duration are set anew for each.

    The shortest have three whole cycles.
    """
    settings = {BEAM: _beam, CRANK: _crank, SPATIAL: _spatial}[rig]
    return tuple(
        {
            **settings(share, rng),
            **({"beam": beam} if rig == BEAM else {}),
            "sample_rate": float(rng.choice(_RATES_HZ)),
            "settle": _SETTLE_S,
            "duration": round(_by_ratio(_DURATION_S, float(rng.random())), 1),
        }
        for share in _apart(runs, rng)
    )


def longest(point: PointOfRun) -> PointOfRun:
    """The same for as long as any run lasts: 18 whole cycles at the least."""
    return {**point, "duration": _DURATION_S[1]}


def _beam(share: float, rng: np.random.Generator) -> PointOfRun:
    return {
        "clearance": _gap(_BEAM_GAP_MM, 3, rng),
        "frequency": round(_by_ratio(_BEAM_HZ, share), 1),
        "amplitude": round(float(rng.uniform(*_BEAM_N)), 1),
    }


def _crank(share: float, rng: np.random.Generator) -> PointOfRun:
    gaps = {key: _gap(_CRANK_GAP_MM, 2, rng) for key in ("clearance_1", "clearance_2")}
    return {"speed": _crank_speed(share), **gaps}


def _spatial(share: float, rng: np.random.Generator) -> PointOfRun:
    gaps = {key: _gap(_SPATIAL_GAP_MM, 2, rng) for key in ("socket_clearance", "guide_clearance")}
    angle = math.radians(round(float(rng.uniform(*_SPATIAL_DEG))))
    return {"speed": _crank_speed(share), "axis_angle": angle, **gaps}


def _crank_speed(share: float) -> float:
    low, high = CRANK_RPM
    return round(low + share * (high - low)) * math.pi / 30


def _gap(limits_mm: tuple[float, float], digits: int, rng: np.random.Generator) -> float:
    return round(_by_ratio(limits_mm, float(rng.random())), digits) * 1e-3


def whole_cycles(point: PointOfRun) -> int:
    """Cycles that a run holds for certain, wherever it begins."""
    hertz = _number(point, "frequency") if "frequency" in point else _number(point, "speed") / (2 * math.pi)
    return math.floor(hertz * _number(point, "duration") * (1 - 1e-3)) - 1


def left_out(rig: str, needed: Collection[str], rng: np.random.Generator) -> tuple[str, ...]:
    """Channels that a lab has not, if it has fewer than the twin; never one of the `needed`."""
    if rng.random() >= _FEWER_CHANNELS:
        return ()
    may = [name for name in _MAY_LACK[rig] if name not in needed]
    found = [str(name) for name in rng.choice(may, int(rng.integers(1, _MOST_MISSING + 1)), replace=False)]
    return tuple(found[:1] if set(found) >= _TELLS_THE_CYCLE else found)


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
