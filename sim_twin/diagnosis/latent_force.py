"""What is missing at a joint, as a force: the measured joint's mean force less the twin's.

Both go through the same reconstruction (`RigModel.joint_records`) and are averaged against displacement,
velocity and time in the cycle, so that a motion which never repeats does not matter. Compare Rogers and Friis
2022, arXiv:2109.10681, who keep the force over time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_twin.diagnosis.campaign import Campaign, RunSetting
from sim_twin.diagnosis.subject import Draw
from sim_twin.rigs.rig_model import JointRecord

Array = NDArray[np.float64]
_RARE = 0.02
"""Share of the samples at either end of an axis that is not looked at."""
_BINS = 24
_FEWEST_SAMPLES = 20
_TWINS = 12
_FEWEST_TWINS = 8
_LONGEST_S = 60.0
_LEAST_SCATTER = 0.02
"""Of the largest mean force."""


@dataclass(frozen=True, slots=True)
class Axis:
    """What a force is told against, with its unit."""

    name: str
    unit: str


DISPLACEMENT, VELOCITY, TIME = (
    Axis("displacement", "m"),
    Axis("velocity", "m/s"),
    Axis("part of the cycle", ""),
)


@dataclass(frozen=True, slots=True)
class Curve:
    """Mean force in N in each bin of `axis`, whose `edges` (bins + 1,) have its unit.

    `scatter` is the standard deviation between healthy twins; all (bins,), nan where there is too little.
    """

    axis: Axis
    edges: Array
    measured: Array
    twin: Array
    scatter: Array

    @property
    def latent(self) -> Array:
        """What the measured joint has more than the twin's, N."""
        return self.measured - self.twin

    @property
    def size(self) -> float:
        """Root mean square of it in healthy scatters."""
        known = np.isfinite(self.latent / self.scatter)
        return (
            float(np.sqrt(np.mean((self.latent[known] / self.scatter[known]) ** 2))) if known.any() else 0.0
        )


@dataclass(frozen=True, slots=True)
class LatentForce:
    """A joint in a run, its force against displacement, velocity and time in the cycle."""

    run: int
    joint: str
    location: str
    curves: tuple[Curve, ...]

    @property
    def size(self) -> float:
        """The largest of its curves', in healthy scatters."""
        return max(curve.size for curve in self.curves)


def latent_forces(
    campaign: Campaign,
    records: Sequence[Mapping[str, NDArray[np.floating]]],
    sound: Sequence[NDArray[np.bool_]],
    seed: int,
) -> list[LatentForce]:
    """Of every joint in every run whose channels tell of one, the largest first.

    `records` holds the measured channels of each run, `sound` which of their samples can be used.
    """
    rng = np.random.default_rng(seed)
    draws = [Draw((), int(rng.integers(2**62))) for _ in range(_TWINS)]
    found = []
    for number, (setting, twins) in enumerate(zip(campaign.runs, campaign.records(draws), strict=True)):
        measured = _joints(setting, records[number], sound[number])
        healthy = [_joints(setting, twin) for twin in twins if twin is not None]
        for name in measured:
            others = [each[name] for each in healthy if name in each]
            if len(others) >= _FEWEST_TWINS:
                joint = measured[name]
                curves = tuple(_curve(axis, joint, others) for axis in (DISPLACEMENT, VELOCITY, TIME))
                found.append(LatentForce(number, name, joint.record.location, curves))
    return sorted(found, key=lambda each: -each.size)


@dataclass(frozen=True, slots=True)
class _Seen:
    """A joint's record, the part of the cycle (n,) at each sample, and which samples count."""

    record: JointRecord
    phase: Array
    sound: NDArray[np.bool_]

    def samples(self, axis: Axis) -> tuple[Array, Array]:
        """Place on the axis and force of every sample that counts."""
        record = self.record
        at = {TIME: self.phase, DISPLACEMENT: record.displacement, VELOCITY: record.velocity}[axis]
        counts = self.sound & np.isfinite(at) & np.isfinite(record.force)
        return at[counts], record.force[counts]


def _joints(
    setting: RunSetting,
    records: Mapping[str, NDArray[np.floating]],
    sound: NDArray[np.bool_] | None = None,
) -> dict[str, _Seen]:
    count = min(int(_LONGEST_S * setting.columns.rate), *(len(record) for record in records.values()))
    kept = {name: record[:count] for name, record in records.items()}
    cycles = setting.cycles_in(kept)
    phase = cycles.phases(count) / (2 * np.pi) % 1.0
    usable = np.ones(count, dtype=bool) if sound is None else sound[:count]
    joints = setting.twin.model.joint_records(setting.twin, kept, cycles)
    return {each.joint: _Seen(each, phase, usable) for each in joints}


def _curve(axis: Axis, measured: _Seen, twins: Sequence[_Seen]) -> Curve:
    seen, healthy = measured.samples(axis), [twin.samples(axis) for twin in twins]
    at = np.concatenate([seen[0], *(at for at, _ in healthy)])
    low, high = np.quantile(at, (_RARE, 1 - _RARE)) if axis is not TIME and len(at) else (0.0, 1.0)
    edges = np.linspace(low, high, _BINS + 1)
    means = np.array([_means(edges, *each) for each in healthy])
    enough = np.isfinite(means).sum(axis=0) >= _FEWEST_TWINS
    twin, scatter = np.full(_BINS, np.nan), np.full(_BINS, np.nan)
    twin[enough] = np.nanmean(means[:, enough], axis=0)
    scatter[enough] = np.nanstd(means[:, enough], axis=0, ddof=1)
    least = _LEAST_SCATTER * np.nanmax(np.abs(twin)) if enough.any() else 0.0
    return Curve(axis, edges, _means(edges, *seen), twin, np.maximum(scatter, least))


def _means(edges: Array, at: Array, force: Array) -> Array:
    """Mean force in each bin."""
    inside = (at >= edges[0]) & (at < edges[-1])
    bins = np.searchsorted(edges, at[inside], side="right") - 1
    count = np.bincount(bins, minlength=len(edges) - 1)
    total = np.bincount(bins, force[inside], minlength=len(edges) - 1)
    return np.where(count >= _FEWEST_SAMPLES, total / np.maximum(count, 1), np.nan)
