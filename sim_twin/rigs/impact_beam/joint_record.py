"""What passed through the stops of the impact beam: measured forces, and the tip's way by a linear beam.

Between the stops the beam is linear, so measured drive and contact forces tell how its tip moved. What small
errors in them add up to is slow; at every first touch the tip is at the stop, and a smooth curve through what
is missing there is taken off.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.interpolate import make_smoothing_spline

from sim_twin.rigs.cycles import Cycles
from sim_twin.rigs.impact_beam.channels import DRIVE, LOWER, UPPER
from sim_twin.rigs.impact_beam.model import ImpactBeam
from sim_twin.rigs.impact_beam.structure import structure_of
from sim_twin.rigs.rig_model import JointRecord
from sim_twin.twin import AnyTwin

Array = NDArray[np.float64]
_NEEDED = (DRIVE.name, UPPER.name, LOWER.name)
_TOUCHES_N, _LEAVES_N = 1.0, 0.5
_FEWEST_CONTACTS = 20
_SETTLE_S = 0.25
"""In which the bending modes forget that a record is taken as periodic."""
_SLOW_HZ = 30.0
"""What misses the stops more slowly than this is an error of the path."""


@dataclass(frozen=True, slots=True)
class _Path:
    """Displacement in m, velocity in m/s."""

    w: Array
    v: Array


def joint_records(
    twin: AnyTwin, records: Mapping[str, NDArray[np.floating]], cycles: Cycles
) -> tuple[JointRecord, ...]:
    """Both stops; none where a force is missing or hardly anything touches.

    Displacement is how far the tip is past the stop, velocity how fast it closes.
    """
    if any(name not in records for name in _NEEDED):
        return ()
    drive, upper, lower = (np.asarray(records[name], dtype=np.float64) for name in _NEEDED)
    spans = {1.0: _contacts(upper), -1.0: _contacts(lower)}
    if sum(len(each) for each in spans.values()) < _FEWEST_CONTACTS:
        return ()
    rig = twin.rig
    path = _anchored(rig, _linear_path(rig, drive, upper, lower, cycles.rate), spans, cycles.rate)
    settled = np.arange(len(drive)) >= _SETTLE_S * cycles.rate
    stops = (("upper stop", 1.0, upper), ("lower stop", -1.0, lower))
    found = []
    for name, sign, force in stops:
        past = np.where(settled, _since_touch(sign * path.w, force, spans[sign]), np.nan)
        closing = np.where(np.isfinite(past), sign * path.v, np.nan)
        found.append(JointRecord(name, "contact joint", force, past, closing))
    return tuple(found)


def _contacts(force: Array) -> NDArray[np.intp]:
    """First sample and end of each contact, shape (contacts, 2)."""
    pressed = np.concatenate([[False], force > _LEAVES_N, [False]])
    spans = np.flatnonzero(pressed[1:] != pressed[:-1]).reshape(-1, 2)
    return spans[[bool(force[first:end].max() > _TOUCHES_N) for first, end in spans]]


def _since_touch(way: Array, force: Array, spans: NDArray[np.intp]) -> Array:
    """How far the tip has gone since the force began to rise, in each contact; else not a number."""
    past = np.full(len(way), np.nan)
    for first, end in spans[(spans[:, 0] > 0) & (spans[:, 1] < len(way))]:
        rise = max(force[first + 1] - force[first], force[first] - force[first - 1], _LEAVES_N)
        before = min(force[first] / rise, 1.0)
        past[first:end] = way[first:end] - ((1 - before) * way[first] + before * way[first - 1])
    return past


def _linear_path(rig: ImpactBeam, drive: Array, upper: Array, lower: Array, rate: float) -> _Path:
    """The tip's way past the yoke under these forces, taken as periodic."""
    s = structure_of(rig)
    n, count = len(s.K), len(drive)
    poles, shapes = np.linalg.eig(np.block([[np.zeros((n, n)), np.eye(n)], [-s.K, -s.C]]))
    back = np.linalg.inv(shapes)[:, n:]
    seen = s.contact @ shapes[:n]
    omega = 2 * np.pi * fft.rfftfreq(count, 1 / rate)
    to_drive, to_stop = (seen * (back @ row) for row in (s.drive, s.contact))
    driven, pushed = fft.rfft(drive), fft.rfft(lower - upper)
    w = np.zeros(len(omega), dtype=np.complex128)
    for pole, by_drive, by_stop in zip(poles, to_drive, to_stop, strict=True):
        w += (by_drive * driven + by_stop * pushed) / (1j * omega - pole)
    return _Path(fft.irfft(w, count), fft.irfft(1j * omega * w, count))


def _anchored(rig: ImpactBeam, path: _Path, spans: Mapping[float, NDArray[np.intp]], rate: float) -> _Path:
    """The path that is at the stop at every first touch."""
    touched = {
        int(first): sign * (rig.clearance - sign * rig.rest_offset)
        for sign, each in spans.items()
        for first, _ in each
    }
    at = np.array(sorted(touched))
    missing = path.w[at] - np.array([touched[int(k)] for k in at])
    stiffness = len(at) / (len(path.w) / rate) / (2 * np.pi * _SLOW_HZ) ** 4
    slow = make_smoothing_spline(at / rate, missing, lam=stiffness)
    time = np.arange(len(path.w)) / rate
    return _Path(path.w - slow(time), path.v - slow(time, 1))
