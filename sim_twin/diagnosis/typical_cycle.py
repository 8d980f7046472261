"""One cycle that stands for many: the nearest to the middle of them, measured and of the twins."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_twin.diagnosis.campaign import Campaign, RunSetting
from sim_twin.diagnosis.subject import Draw, Named

Array = NDArray[np.floating]
Records = Mapping[str, Array]
_RIGS = 2
"""Of each twin, whose cycles are chosen from."""
_PARTS = 32
_FAR = 3.0
"""Deviations: a cycle that is odd in one place is no odder than so."""
_MOST = 100


@dataclass(frozen=True, slots=True)
class TypicalCycle:
    """What a channel of a run shows over one cycle, (n,): "measured", and the twins "nominal", "repaired"."""

    run: int
    channel: str
    lines: Mapping[str, Array]


def typical_cycles(
    campaign: Campaign,
    records: Sequence[Records],
    sound: Sequence[NDArray[np.bool_]],
    wanted: Sequence[tuple[int, str]],
    effects: Sequence[Named],
    seed: int,
) -> list[TypicalCycle]:
    """Of the wanted channels, each with its run; `effects` are those of the repaired twin, none without.

    `records` holds the measured channels of each run, `sound` which of their samples can be used. Of a run,
    all channels of one cycle are shown. A few healthy rigs are simulated, the same for both twins.
    """
    twins = {"nominal": (), **({"repaired": tuple(effects)} if effects else {})}
    first = int(np.random.default_rng(seed).integers(2**62))
    draws = [Draw(given, first + k) for given in twins.values() for k in range(_RIGS)]
    shown: dict[int, dict[str, dict[str, Array]]] = {}
    for number in sorted({run for run, _ in wanted}):
        (setting,), (simulated,) = campaign.runs[number : number + 1], campaign.only((number,)).records(draws)
        recordings = {"measured": [(records[number], sound[number])]}
        for k, whose in enumerate(twins):
            of_twin = [each for each in simulated[k * _RIGS : (k + 1) * _RIGS] if each is not None]
            recordings[whose] = [(each, _all(each)) for each in of_twin]
        shown[number] = {whose: _typical(setting, each) for whose, each in recordings.items()}
    found = []
    for run, channel in wanted:
        lines = {whose: cycle[channel] for whose, cycle in shown[run].items() if channel in cycle}
        found += [TypicalCycle(run, channel, lines)] if "measured" in lines else []
    return found


def _all(records: Records) -> NDArray[np.bool_]:
    return np.ones(min(len(record) for record in records.values()), dtype=bool)


def _typical(
    setting: RunSetting, recordings: Sequence[tuple[Records, NDArray[np.bool_]]]
) -> dict[str, Array]:
    """All channels but angles over the cycle of some recordings that is nearest to the middle; {} of none."""
    names = [name for name in setting.columns.channels if name not in setting.columns.angles]
    cut: list[dict[str, Array]] = []
    for records, sound in recordings:
        cycles = setting.cycles_in(records)
        starts = cycles.starts(len(sound))
        starts = starts[[bool(sound[at : at + cycles.length].all()) for at in starts]][:_MOST]
        cut += [{name: records[name][at : at + cycles.length] for name in names} for at in starts]
    if not cut:
        return {}
    features = np.array([np.concatenate([_course(cycle[name]) for name in names]) for cycle in cut])
    off = np.abs(features - np.median(features, axis=0)) / (features.std(axis=0) + 1e-12)
    return cut[int(np.argmin(np.minimum(off, _FAR).mean(axis=1)))]


def _course(cycle: Array) -> NDArray[np.float64]:
    """Logarithms of the mean square in each part of a cycle."""
    squares = cycle[: len(cycle) // _PARTS * _PARTS].astype(np.float64).reshape(_PARTS, -1) ** 2
    return np.asarray(np.log(squares.mean(axis=1) + 1e-12))
