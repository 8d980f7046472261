"""How far the gap shrinks: twins repaired by what fits some cycles, held against others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sim_twin.diagnosis.attribution import Attribution
from sim_twin.diagnosis.cause import Hypothesis, parts_of, values_of
from sim_twin.diagnosis.findings import Gap
from sim_twin.diagnosis.gap import GapMeasure, shrink_of
from sim_twin.diagnosis.library import Library, Order, order_of
from sim_twin.diagnosis.refocus import Focus
from sim_twin.diagnosis.search import Ranked
from sim_twin.diagnosis.subject import Execute

Array = NDArray[np.float64]
Blocks = NDArray[np.float32]
_FEWEST_JUDGED = 6
_RESAMPLED = 400
_FEWEST_TWINS = 4
_RIDGE = 0.1
"""Of one rig that lies a deviation away: keeps slopes small that hardly any rig tells."""
_CLEARLY = 1.2
_CLOSED = 1.1
"""A gap below which a second effect has nothing to close: a few rigs tell gaps to a tenth."""


def halves(measured: Blocks) -> tuple[Blocks, Blocks]:
    """Blocks to fit to and blocks to judge on, by turns: what drifts is in both; of one block nothing is held
    out.
    """
    return (measured[::2], measured[1::2]) if len(measured) > 1 else (measured, measured)


def refitted(
    candidates: Sequence[Ranked], attribution: Attribution, fitted_to: Blocks, rng: np.random.Generator
) -> dict[Hypothesis, Ranked]:
    """Each candidate with the posterior of its parameters that some blocks alone give."""
    place = attribution.place(fitted_to).mean(axis=0)
    return {
        each.hypothesis: replace(each, posterior=attribution.posterior(each.hypothesis, place, rng))
        for each in candidates
    }


def repaired_twins(
    fits: Mapping[Hypothesis, Ranked], motions: int, execute: Execute, rng: np.random.Generator
) -> dict[Hypothesis, Array]:
    """Fingerprints (n, numbers) of healthy rigs with each hypothesis in, as it fits best."""
    return rigs_with({hypothesis: fit.best() for hypothesis, fit in fits.items()}, motions, execute, rng)


def rigs_with(
    wanted: Mapping[Hypothesis, Array], motions: int, execute: Execute, rng: np.random.Generator
) -> dict[Hypothesis, Array]:
    """Fingerprints (n, numbers) of healthy rigs with each hypothesis in at the parameters that are wanted.

    Those of which too few could be simulated are left out.
    """
    each = max(_FEWEST_JUDGED, motions // max(1, len(wanted)))
    orders = [order_of({h: np.tile(values, (each, 1))}, rng, together=1) for h, values in wanted.items()]
    shown = iter(execute(sum(orders, Order()).draws))
    rigs = {}
    for hypothesis, order in zip(wanted, orders, strict=True):
        blocks = [one[0] for _ in range(len(order)) for one in next(shown) if one is not None]
        rigs[hypothesis] = np.array(blocks, dtype=np.float64)
    return {hypothesis: found for hypothesis, found in rigs.items() if len(found) >= _FEWEST_TWINS}


def moved_by(
    fit: Ranked, focus: Focus | None, library: Library, rng: np.random.Generator, known: float = 1.0
) -> Array:
    """How far fingerprints lie from those of the fit's best parameters at others of its posterior.

    Shape (draws, numbers). By rigs about them where the `focus` is on them; else of each cause by itself,
    straight in its coordinates, as the library's rigs with it show; the nearer one is, the more it tells.
    Evidence counts by the share that is `known`.
    """
    best = fit.best()
    values = values_of(fit.hypothesis, fit.posterior.tempered(known).sample(_RESAMPLED, rng))
    if focus is not None and focus.hypothesis == fit.hypothesis:
        return focus.moved(best, values)
    moved = np.zeros((_RESAMPLED, 1))
    for cause, at in zip(fit.hypothesis, parts_of(fit.hypothesis), strict=True):
        simulated = cause.coordinates(library.values((cause,)))
        here, scale = cause.coordinates(best[None, at]), simulated.std(axis=0) + 1e-9
        x = (simulated - here) / scale
        weights = 1 / (1 + np.sum(x**2, axis=1))
        y = np.array([each[0] for each in library.fingerprints((cause,))], dtype=np.float64)
        x, y = x - np.average(x, axis=0, weights=weights), y - np.average(y, axis=0, weights=weights)
        ridge = _RIDGE * np.eye(x.shape[1])
        slopes = np.linalg.solve((x * weights[:, None]).T @ x + ridge, (x * weights[:, None]).T @ y)
        moved = moved + (cause.coordinates(values[:, at]) - here) / scale @ slopes
    return moved


def without_idle_partners(
    found: Ranked,
    candidates: Sequence[Ranked],
    repaired: Mapping[Hypothesis, Array],
    measure: GapMeasure,
    judged_on: Blocks,
) -> Ranked:
    """The fewest of what was found that mend as much on data that were not fitted as all of it does."""
    left = {
        each.hypothesis: gap_after(measure, judged_on, repaired[each.hypothesis])
        for each in candidates
        if each.hypothesis in repaired and set(each.hypothesis) <= set(found.hypothesis)
    }
    if found.hypothesis not in left:
        return found
    enough = max(_CLOSED, left[found.hypothesis])
    fewer = [each for each in candidates if left.get(each.hypothesis, np.inf) <= enough]
    return min(fewer, key=lambda each: (len(each.hypothesis), left[each.hypothesis]), default=found)


def gap_after(measure: GapMeasure, judged_on: Blocks, twins: Array) -> float:
    """Gap of the blocks `judged_on` from repaired rigs' fingerprints (n, numbers)."""
    mended = measure.of_repaired(twins)
    return mended.total(mended.cells(judged_on))


def leads_away(measure: GapMeasure, judged_on: Blocks, repaired: Array) -> bool:
    """Whether the blocks `judged_on` lie clearly farther from repaired rigs than from nominal ones.

    Where they lie near the nominal ones already, there is nothing to lead away from. By cells alone, since a
    repaired twin has another unit; a few rigs tell those to a tenth or two.
    """
    before, after = (np.mean(each.cells(judged_on) ** 2) for each in (measure, measure.of_repaired(repaired)))
    near = measure.total(measure.cells(judged_on)) <= 1.0
    return bool(not near and after >= _CLEARLY**2 * before)


def gap_between(
    measure: GapMeasure,
    judged_on: Blocks,
    measured: Blocks,
    repaired: Array | None,
    rng: np.random.Generator,
    selected: bool = False,
    moved: Array | None = None,
) -> Gap:
    """Gap of the blocks `judged_on` from the nominal twin and from `repaired` fingerprints (n, numbers).

    The interval is from resampled blocks and resampled rigs, and from what their parameters may be besides:
    by as much as a row of `moved` (m, numbers) their fingerprints would be others. `selected` with nothing
    repaired: nobody knows.
    """
    cells = measure.cells(judged_on)
    before = measure.total(cells)
    # how far the recording's blocks lie from their own mean
    centred = replace(measure, twin=np.mean(measured, axis=0, dtype=np.float64))
    own = centred.total(centred.cells(measured))
    if repaired is None:
        after = None if selected else before
        shrink = None if selected else shrink_of(before, before)
        units = measure.unit, measure.unit
        return Gap(before, after, shrink, None, cells, cells, *units, own, measure.course(measured))
    mended = measure.of_repaired(repaired)
    cells_after = mended.cells(judged_on)
    after = mended.total(cells_after)
    if moved is None:
        moved = np.zeros((1, repaired.shape[1]))
    shrink = shrink_of(before, after)
    interval = None if shrink is None else _interval(measure, judged_on, repaired, moved, rng)
    if shrink is not None and interval is not None:  # other parameters close the gap less well than the best
        interval = min(interval[0], shrink), max(interval[1], shrink)
    units, courses = (measure.unit, mended.unit), (measure.course(measured), mended.course(measured))
    return Gap(before, after, shrink, interval, cells, cells_after, *units, own, *courses)


def _interval(
    measure: GapMeasure, judged_on: Blocks, repaired: Array, moved: Array, rng: np.random.Generator
) -> tuple[float, float] | None:
    shrinks = []
    for _ in range(_RESAMPLED):
        data = judged_on[rng.integers(len(judged_on), size=len(judged_on))]
        rigs = repaired[rng.integers(len(repaired), size=len(repaired))]
        mended = measure.of_repaired(rigs + moved[rng.integers(len(moved))])
        shrink = shrink_of(measure.total(measure.cells(data)), mended.total(mended.cells(data)))
        if shrink is not None:
            shrinks.append(shrink)
    if not shrinks:
        return None
    low, high = np.percentile(shrinks, (2.5, 97.5))
    return float(low), float(high)
