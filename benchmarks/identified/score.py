"""What the results of rigs that were identified come to, held against their bars."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.blind.intervals import share_of
from benchmarks.identified.rigs import FREE, RIGS_A_KIND
from benchmarks.kept_results import Results

HOLD, GAP, WALL_S, CORES, POINTS, CALLED_OFF = (0.88, 0.99), 1.15, 300.0, 2, 0.05, 3 / 60
"""Bars: share of values held, gap afterwards, seconds of wall time on so many cores, share of first answers
that fewer are right, share of healthy rigs called off."""


def score(results: Mapping[str, Results]) -> bool:
    """Print what the rigs' results come to; whether none is missing and every figure meets its bar."""
    met, called_off, effects = True, list[bool](), list[dict[str, Any]]()
    for step, kept in results.items():
        print(f"{step}: program {kept.digest}; results of others, left out: {kept.others(f'*_{step}')}")
    for rig in FREE:
        found = {step: kept.every(f"{rig}_*_{step}") for step, kept in results.items()}
        print(f"{rig}: {', '.join(f'{step} {len(each)} of {RIGS_A_KIND}' for step, each in found.items())}")
        met &= all(len(each) >= RIGS_A_KIND for each in found.values())
        met &= _score_values(found["rigs"])
        effects += found["effects"]
        _score_effects(found["effects"])
        for name, words in (("usual", "as shipped"), ("own", "as learnt of five")):
            beyond = [each[name] for each in found["healthy"]]
            print(f"  healthy rigs twice as wide, called off by tolerances {words}: {share_of(beyond)}")
        called_off += [each["own"] for each in found["healthy"]]
    print(f"healthy rigs of all kinds, called off by tolerances as learnt of five: {share_of(called_off)}")
    print("effects in rigs of all kinds:")
    met &= _score_effects(effects)
    return met and sum(called_off) <= CALLED_OFF * len(called_off)


def _score_values(results: Sequence[Mapping[str, Any]]) -> bool:
    """A rig that was refused holds no value and closes no gap."""
    done = [each for each in results if each["code"] == 0]
    if not done:
        return False
    still = sum(each["converged"] for each in done)
    print(f"  identified {len(done)}, refused {len(results) - len(done)}; converged {still}")
    every = [
        (interval["told"], interval["low"] <= each["truth"][key] <= interval["high"])
        for each in done
        for key, interval in each["identified"].items()
    ]
    held = [holds for told, holds in every if told]
    share = float(np.mean(held)) if held else 0.0
    print(f"  values told, of those that were looked for: {share_of([told for told, _ in every])}")
    print(f"  values told that their 95 % intervals hold: {share_of(held)}")
    print(f"  the others, that theirs hold: {share_of([holds for told, holds in every if not told])}")
    after, before = (
        [np.inf if each[name] is None else each[name] for each in done] for name in ("gap", "gap_before")
    )
    within = [gap <= GAP for gap in after]
    print(f"  gap afterwards within {GAP}: {share_of(within)}")
    middle = f"{np.median(before):.2f} before, {np.median(after):.2f} after"
    print(f"  gap, medians: {middle}; largest {max(after):.2f}")
    wall_s, most = [float(each["wall_s"]) for each in results], max(int(each["cores"]) for each in results)
    print(f"  seconds on {most} cores: median {np.median(wall_s):.0f}, largest {max(wall_s):.0f}")
    on_time = max(wall_s) <= WALL_S and most <= CORES
    return len(done) == len(results) and HOLD[0] <= share <= HOLD[1] and all(within) and on_time


def _score_effects(results: Sequence[Mapping[str, Any]]) -> bool:
    right: dict[str, list[bool]] = {
        name: [each[name]["right"] for each in results] for name in ("identified", "nominal")
    }
    for name, each in right.items():
        print(f"  single effects on {name} rigs, first answer right: {share_of(each)}")
    return sum(right["identified"]) >= sum(right["nominal"]) - POINTS * len(results)
