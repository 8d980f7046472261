"""Whether the answer of a subject could be believed: looked at before anything is diagnosed with it."""

from __future__ import annotations

import pickle
import traceback
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from sim_twin.diagnosis.cause import Cause, Hypothesis, drawn, named
from sim_twin.diagnosis.library import Library, Order, order_of
from sim_twin.diagnosis.screening import numbers_of
from sim_twin.diagnosis.search import Search, believed
from sim_twin.diagnosis.subject import Draw, Execute, Observed, OfRuns, Subject

Array = NDArray[np.float64]
Blocks = NDArray[np.float32]
_PROBED = (0.02, 0.5, 0.98)
"""Places of each parameter at which it is tried, the others in the middle."""
_FELT = 0.3
"""Healthy scatters in the number that a parameter moves most, below which nobody can tell its value."""
_HEALTHY = 32
_MOST_BLOCKS = 6
_WIDER = 1.7
"""Times what any simulated rig's blocks scatter, from which on measured ones scatter otherwise."""
_OTHER_UNIT = 8.0
_EMPTY = 1e-9
_SAME = 1e-6
_FIRST_LOOK = 0.8
"""Of the rigs to search with: more than that for a first look leave none for a closer one."""
_HIDDEN = 3
"""Rigs with each cause hidden."""
_NAMED = 4
_OURS = __file__.rpartition("diagnosis")[0]
_RANDOM = "the same draw gives other numbers: everything random has to come from draw.seed"


@dataclass(frozen=True, slots=True)
class Check:
    """`faults` make every answer worthless; `remarks` are to be known before one is believed.

    `found_again`: of so many simulated rigs with each cause in (and with "nothing"), how many were taken for
    that, and what most of the others were taken for.
    """

    faults: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    found_again: Mapping[str, tuple[int, int, str]] = field(default_factory=dict)


def check(
    subject: Subject,
    measured: Blocks,
    execute: Execute,
    seed: int = 0,
    motions: int = 240,
    elsewhere: Execute | None = None,
) -> Check:
    """Try a subject and its `measured` fingerprints (blocks, numbers), by so many simulated rigs at least.

    `execute` has it observe draws, as a diagnosis would: other processes must see what this one does, by
    `elsewhere`, which keeps nothing, where that is given.
    """
    for look in (_said, _same_draws, _same_by_runs, _same_elsewhere):
        if faults := tuple(look(subject, measured, elsewhere or execute, seed)):
            return Check(faults)
    healthy = _observed([Draw((), seed + k, blocks=_blocks(measured)) for k in range(_HEALTHY)], execute)
    if len(healthy) < _HEALTHY // 2:
        lost = f"{_HEALTHY - len(healthy)} of {_HEALTHY} healthy rigs failed"
        return Check((f"{lost}: nothing can be compared with those",))
    told, effects = _parameters(subject, healthy, execute, seed)
    remarks = [
        *told.remarks,
        *_scatter(subject, healthy, measured),
        *_units(subject, healthy, effects, measured),
    ]
    if told.faults:
        return Check(told.faults, tuple(remarks))
    return _found_again(subject, measured, execute, seed, motions, remarks)


def first_draws(subject: Subject, seed: int) -> list[Draw]:
    """A healthy rig, and one with each cause somewhere in its range, which may have a branch of its own."""
    rng = np.random.default_rng(seed)
    draws = [Draw((), seed)]
    for cause in subject.causes:
        [values] = drawn((cause,), 1, rng)
        effects = named((cause,), values)
        moving, shown = ((), ((), effects)) if cause.sensing else (effects, ((), ()))
        draws.append(Draw(moving, seed, shown))
    return draws


def _said(subject: Subject, measured: Blocks, _: Execute, __: int) -> Iterator[str]:
    """What can be seen without simulating anything."""
    layout, causes = subject.layout, subject.causes
    numbers = np.asarray(measured)
    if numbers.ndim != 2 or not len(numbers) or numbers.shape[1] != layout.size:
        yield f"what was measured has the shape {numbers.shape}, wanted is (blocks, {layout.size})"
    elif not np.isfinite(numbers).all():
        block, at = np.argwhere(~np.isfinite(numbers))[0]
        cell = layout.of_numbers[at]
        yield f"measured, block {block + 1}: {cell.channel}, {cell.what} is no number"
    if not causes:
        yield "no cause is named, so nothing could be found"
    names = [(cause.name, cause.channel) for cause in causes]
    for name, channel in dict.fromkeys(each for each in names if names.count(each) > 1):
        yield f"{name} is there twice{f' on {channel}' if channel else ''}; one would hide the other"
    for cause in causes:
        if not cause.parameters:
            yield f"{cause.name} has no parameter, not even its size"
        for one in cause.parameters:
            ends = [end for interval in one.intervals for end in interval]
            if not ends or not np.isfinite(ends).all() or any(low >= high for low, high in one.intervals):
                yield f"{cause.name}.{one.name} lies within {one.intervals}; wanted are (low, high), ..."
    try:
        pickle.dumps(subject)
    except Exception as error:  # whatever a user's class does as it is written
        yield f"it cannot be sent to other processes ({error}); its functions have to stand by themselves"


def _same_draws(subject: Subject, measured: Blocks, _: Execute, seed: int) -> Iterator[str]:
    """In this process, so that what fails is told with its place."""
    draws = [Draw((), seed, blocks=2), Draw((), seed + 1, blocks=2), *first_draws(subject, seed)]
    try:
        first, again = subject.observe(draws), subject.observe(draws[::-1])[::-1]
    except Exception as error:
        yield f"observe failed: {type(error).__name__}: {error}{_where(error)}"
        return
    if len(first) != len(draws) or any(
        len(got) != len(draw.sensing) for got, draw in zip(first, draws, strict=False)
    ):
        yield "observe has to return one entry a draw, each with one fingerprint for each of draw.sensing"
        return
    for got, draw in zip(first, draws, strict=True):
        for one in got:
            if one is not None and np.shape(one) != (draw.blocks, subject.layout.size):
                wanted = f"({draw.blocks}, {subject.layout.size}), (draw.blocks, numbers)"
                yield f"observe gives a fingerprint of shape {np.shape(one)}, wanted is {wanted}"
                return
            if one is not None and not np.isfinite(one).all():
                yield "observe gives numbers that are not finite; a run that failed is None"
                return
    if not all(_alike(one, other) for one, other in zip(first, again, strict=True)):
        yield _RANDOM
    elif first[0][0] is not None and _alike(first[0], first[1]):
        yield "every healthy rig is the same: draw.seed is not used"


def _same_by_runs(subject: Subject, measured: Blocks, _: Execute, seed: int) -> Iterator[str]:
    """Of one that is simulated run by run: the runs stand in order, and each shows what it does among all."""
    runs = [cell.run for cell in subject.layout.cells]
    if not isinstance(subject, OfRuns) or len(set(runs)) < 2:
        return
    if runs != sorted(runs):
        yield "`only` simulates some of its runs: its cells have to stand run after run"
        return
    draw = Draw((), seed)
    [(whole,)] = subject.observe([draw])
    for run in sorted(set(runs)):
        [(alone,)] = subject.only((run,)).observe([draw])
        expected = None if whole is None else whole[:, numbers_of(subject.layout, [run])]
        if not _alike((alone,), (expected,)):
            yield f"only(({run},)) shows of a draw something else than that run does among all"


def _same_elsewhere(subject: Subject, measured: Blocks, execute: Execute, seed: int) -> Iterator[str]:
    draws = [Draw((), seed + k) for k in range(3)]
    here, there = subject.observe(draws), execute(draws)
    if not all(_alike(one, other) for one, other in zip(here, there, strict=True)):
        yield f"in another process {_RANDOM}"


def _parameters(
    subject: Subject, healthy: Sequence[Blocks], execute: Execute, seed: int
) -> tuple[Check, Array]:
    """Whether each parameter moves something, and the fingerprints (n, numbers) of all that was tried."""
    tried = [(cause, k, values) for cause in subject.causes for k, values in _probes(cause)]
    effects = [(cause, (cause.named(values),)) for cause, _, values in tried]
    draws = [Draw((), seed, (each,)) if cause.sensing else Draw(each, seed) for cause, each in effects]
    plain, *shown = execute([Draw((), seed), *draws])
    of: dict[tuple[Cause, int], list[Array]] = {}
    for (cause, k, _), got in zip(tried, shown, strict=True):
        if got and got[0] is not None:
            of.setdefault((cause, k), []).append(got[0][0].astype(np.float64))
    scatter = np.std([blocks[0] for blocks in healthy], axis=0, dtype=np.float64)
    scatter[scatter < _EMPTY] = np.inf
    faults, remarks = [], []
    for cause in subject.causes:
        names = [f"{cause.name}.{parameter.name}" for parameter in cause.parameters]
        places = [of.get((cause, k), []) for k in range(len(names))]
        if not any(places):
            faults.append(
                f"every rig with {cause.name} failed, so that it could neither be found nor ruled out: give "
                "it values that a rig can have, or leave it out"
            )
            continue
        moved = [np.ptp(each, axis=0) if len(each) > 1 else None for each in places]
        if (
            plain
            and plain[0] is not None
            and all(np.array_equal(x, plain[0][0]) for each in places for x in each)
        ):
            wanted = " and ".join(parameter.name for parameter in cause.parameters)
            faults.append(f"{cause.name} changes nothing: does observe look for {wanted}?")
            continue
        faults += [
            f"{name} moves nothing: does observe take it by that name?"
            for name, each in zip(names, moved, strict=True)
            if each is not None and not each.any()
        ]
        remarks += [
            f"{name} moves no number by more than {np.max(each / scatter):.2g} of what healthy rigs scatter: "
            "its value cannot be told"
            for name, each in zip(names, moved, strict=True)
            if each is not None and each.any() and np.max(each / scatter) < _FELT
        ]
    return Check(tuple(faults), tuple(remarks)), np.array([one for each in of.values() for one in each])


def _probes(cause: Cause) -> Iterator[tuple[int, Array]]:
    """Each parameter of a cause at some places, the others in the middle: its number, and all values."""
    for k in range(len(cause.parameters)):
        for place in _PROBED:
            u = np.full((1, len(cause.parameters)), 0.5)
            u[0, k] = place
            values = cause.values(u)
            if cause.allowed(values)[0]:
                yield k, values[0]


def _scatter(subject: Subject, healthy: Sequence[Blocks], measured: Blocks) -> Iterator[str]:
    """How wide healthy rigs are, beside what was measured: that decides every verdict."""
    first = np.array([blocks[0] for blocks in healthy], np.float64)
    whole = first.std(axis=0)
    empty = whole < _EMPTY
    if empty.any():
        cells = [cell for cell, alone in zip(subject.layout.of_numbers, empty, strict=True) if alone]
        names = list(dict.fromkeys(f"{cell.channel}, {cell.what}" for cell in cells))
        told = "; ".join(names[:_NAMED]) + (f" and {len(names) - _NAMED} more" if len(names) > _NAMED else "")
        off = not np.allclose(measured.mean(axis=0)[empty], first.mean(axis=0)[empty], rtol=1e-6, atol=_EMPTY)
        lost = f"left out{', though what was measured lies elsewhere' if off else ''}"
        yield f"{len(cells)} of {len(empty)} numbers are the same in all healthy rigs and are {lost}: {told}"
    if empty.all():
        return
    if len(measured) < 2:
        yield (
            "one measured block only: how much this rig scatters by itself cannot be seen, "
            "and the gap is judged on what was fitted; cut the record, or bring more"
        )
        return
    kept = ~empty
    own = _within(measured[:, kept], whole[kept])
    of_healthy = np.array([_within(blocks[:, kept], whole[kept]) for blocks in healthy if len(blocks) > 1])
    low, high, usual = of_healthy.min(), of_healthy.max(), float(np.median(of_healthy))
    compared = f"(in what healthy rigs differ by: {own:.2g}, simulated ones {low:.2g} to {high:.2g})"
    times = (
        f"the measured blocks scatter {own / max(usual, 1e-12):.2g} times as much as those of a healthy rig"
    )
    if high < _SAME:
        yield f"blocks of a simulated rig are all alike, measured ones are not {compared}: noise is missing"
    elif own > _WIDER * high:
        yield (
            f"{times} {compared}: healthy rigs are too narrow, and then every rig has a fault, "
            "or what is missing scatters"
        )
    elif own < low / _WIDER:
        yield f"{times} {compared}: too wide from block to block, and small effects hide there"


def _units(subject: Subject, healthy: Sequence[Blocks], effects: Array, measured: Blocks) -> Iterator[str]:
    """Whether what was measured is of the size of anything that was simulated."""
    simulated = np.concatenate([np.array([blocks[0] for blocks in healthy], np.float64), effects])
    of = np.array([cell.channel for cell in subject.layout.of_numbers])
    for channel in dict.fromkeys(of.tolist()):
        sizes = np.sqrt(np.mean(simulated[:, of == channel] ** 2, axis=1))
        own = float(np.sqrt(np.mean(measured[:, of == channel].astype(np.float64) ** 2)))
        low, high = float(sizes.min()), float(sizes.max())
        if own > _OTHER_UNIT * high or own < low / _OTHER_UNIT:
            yield (
                f"{channel}: measured numbers are about {own:.3g}, those of all that was simulated "
                f"{low:.3g} to {high:.3g}: is that the same unit?"
            )


def _found_again(
    subject: Subject, measured: Blocks, execute: Execute, seed: int, motions: int, remarks: list[str]
) -> Check:
    """Hide each cause in some rigs, and see what they are taken for."""
    rng = np.random.default_rng([seed, 1])
    library = Library()
    search = Search(subject, measured, execute, rng, library, motions)
    order = sum(search.first_order(), Order())
    if len(order) > _FIRST_LOOK * motions:
        remarks.append(
            f"{motions} rigs are too few to search {len(subject.causes)} causes: {len(order)} take a first "
            "look at each and are simulated all the same; the answer is then often unknown"
        )
    library.add(order, execute(order.draws))
    attribution = search.learn()
    hypotheses: list[Hypothesis] = [(), *((cause,) for cause in subject.causes)]
    wanted = {h: drawn(h, _HIDDEN, rng) if h else np.zeros((_HIDDEN, 0)) for h in hypotheses}
    hidden = order_of(wanted, rng, len(measured[:_MOST_BLOCKS]))
    taken: dict[Hypothesis, list[str]] = {h: [] for h in hypotheses}
    for cases, shown in zip(hidden.cases, execute(hidden.draws), strict=True):
        for (hypothesis, _), blocks in zip(cases, shown, strict=bool(shown)):
            if blocks is not None:
                one = replace(search, measured=blocks)
                best = believed(one.weigh(attribution, one.singles()))[0].hypothesis
                taken[hypothesis].append(_name(best))
    found = {}
    for hypothesis, names in taken.items():
        wrong = [each for each in names if each != _name(hypothesis)]
        usual = max(wrong, key=wrong.count, default="")
        found[_name(hypothesis)] = (len(names) - len(wrong), len(names), usual)
        if 2 * len(wrong) > len(names):
            remarks.append(
                f"{_name(hypothesis)}, hidden in {len(names)} simulated rigs, was found in "
                f"{len(names) - len(wrong)}; else it was mostly taken for {usual}"
            )
    return Check((), tuple(remarks), found)


def _name(hypothesis: Hypothesis) -> str:
    return hypothesis[0].name if hypothesis else "nothing"


def _observed(draws: Sequence[Draw], execute: Execute) -> list[Blocks]:
    return [got[0] for got in execute(draws) if got and got[0] is not None]


def _blocks(measured: Blocks) -> int:
    return max(2, min(len(measured), _MOST_BLOCKS))


def _within(blocks: NDArray[np.floating], unit: Array) -> float:
    """Root mean square of what blocks (n, numbers) scatter about their mean by, in a unit for each number."""
    return float(np.sqrt(np.mean(np.var(blocks.astype(np.float64) / unit, axis=0, ddof=1))))


def _alike(one: Observed, other: Observed) -> bool:
    exactly = [  # as they are kept
        [None if each is None else np.asarray(each, np.float32) for each in shown] for shown in (one, other)
    ]
    return len(one) == len(other) and all(
        (a is None and b is None) or (a is not None and b is not None and np.array_equal(a, b))
        for a, b in zip(*exactly, strict=True)
    )


def _names(cause: Cause) -> str:
    return " and ".join(parameter.name for parameter in cause.parameters)


def _where(error: BaseException) -> str:
    """The last place that is the user's own."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [
        each for each in frames if not each.filename.startswith(_OURS) and "-packages" not in each.filename
    ]
    place = (own or frames)[-1]
    return f" ({place.filename.rpartition('/')[2]}, line {place.lineno})"
