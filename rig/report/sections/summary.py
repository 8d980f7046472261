"""The run on one screen."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from daq.log.recover import RECOVERED
from rig.pages.content import BigNumber, BigNumbers, Lead, Part, Sentence, Table
from rig.pages.plots import FROM_ZERO, Plots
from rig.pages.words import DASH, as_written, change, counted, difference, listed, number, spread
from rig.report.crank_figures import impacts_by_group, set_rpm, speed_figures, speeds
from rig.report.record import ORIGINS, RunRecord, Tally
from rig.report.summary import Closeness, closeness, half_cycle_statistics, overall, warnings_passed
from rig.twin.logged import DWELLS

_ROW_PX = 44
_CAPTION = (
    "Level difference between the autospectra of twin and measurement, rms over the bands within 40 dB of "
    "the channel's strongest. Shorter is closer. The blue bar is the difference between the measurement's "
    "own halves: no twin can come much closer, and a healthy rig's twin stays somewhat further off. Decibels "
    "compare mean spectra alone; the gap of the verdict and of a diagnosis compares distributions over the "
    "cycles, in units of a healthy rig's."
)
_WORSE_DB, _WORSE = 0.3, 0.01
"""By how much a figure has to be farther off before it is told."""
_NARROW = "\N{NARROW NO-BREAK SPACE}"


def parts(run: RunRecord) -> list[Part]:
    """The verdict, duration, state of the data, where the twin is worst, and a row for each channel."""
    state = BigNumber("Measured", "nothing", "a prediction only")
    if run.measured:
        remark = f"{counted(run.measured_gaps, 'gap')}, {counted(run.overloaded_blocks, 'overloaded block')}"
        whole = "cut short" if run.measured_gaps or not run.complete else "complete"
        state = BigNumber("Samples", f"{run.missing} missing" if run.missing else whole, remark)
    numbers = [
        BigNumber("Recorded", number(run.duration_s, "s"), run.facts.drive),
        state,
        *_worst_rms(run),
        *_peak_numbers(run),
        *_speed_numbers(run),
        *_impact_numbers(run),
    ]
    verdict = [] if run.verdict is None else [Lead(run.verdict.sentences, run.verdict.well is False)]
    found = []
    if not run.complete:
        found.append("The log was never finished (a crash). It is read up to its last whole chunk.")
    if damage := run.metadata.get(RECOVERED, {}).get("damage"):
        found.append(f"This is what could be recovered of a run whose log was damaged or cut: {damage}.")
    if run.until_stop_s is not None:
        found.append(
            f"Stopped before its time, after {run.until_stop_s:.3g} s: the rest is in the log, not here."
        )
    if dwells := run.metadata.get("run", {}).get(DWELLS):
        found.append(
            f"Recorded at several speeds ({dwells}): figures are of all of it, the ways between included."
        )
    if not any(origin == "predicted" for origin, _ in run.tallies):
        found.append("The log holds no prediction.")
    if not run.channels:
        found.append("The log holds no channel.")
    wrong = [name for name, tally in run.measured.items() if tally.samples > tally.finite]
    if passed := warnings_passed(run):
        found.append(f"{passed}.")
    if wrong:
        found.append(f"Samples that are no numbers: {', '.join(wrong)}.")
    return [
        *verdict,
        *_comparison(run),
        BigNumbers(numbers),
        *[Sentence(text, warning=True) for text in found],
        _channel_table(run),
    ]


def _comparison(run: RunRecord) -> list[Part]:
    """How far either twin lies from the measurement, in all and for each channel; empty without the two."""
    channels = closeness(run)
    if not channels:
        return []
    total = overall(channels)
    numbers = BigNumbers(
        [
            BigNumber("Nominal twin lies off by", f"{total.nominal_db:.1f} dB", "autospectra, all channels"),
            BigNumber("Repaired twin lies off by", f"{total.repaired_db:.1f} dB", "with the effects in it"),
            BigNumber("The run's halves differ by", f"{total.halves_db:.1f} dB", "what chatter alone does"),
        ]
    )
    # bars from left to right, the channels from top to bottom in the order of the run
    grid = Plots(rows=1, columns=1, row_px=_ROW_PX * len(channels) + 10)
    names = {"tickvals": list(range(len(channels))), "ticktext": [each.channel for each in channels]}
    downward = {**names, "autorange": "reversed"}
    grid.axes(0, "Distance to the measurement", "dB", x_axis=FROM_ZERO, y_axis=downward)
    rows = np.arange(len(channels), dtype=np.float64)
    for whose, lengths in (
        ("measured", [each.halves_db for each in channels]),
        ("nominal", [each.nominal_db for each in channels]),
        ("repaired", [each.repaired_db for each in channels]),
    ):
        grid.lying_bars(0, whose, rows, lengths)
    worse = farther_off(run, channels)
    told = [Sentence(worse, warning=True)] if worse else []
    return [numbers, *told, grid.figure("comparison", _CAPTION)]


def farther_off(run: RunRecord, channels: Sequence[Closeness]) -> str:
    """What the effects of an overlay make worse, in a sentence; empty for nothing."""
    worse = [
        f"spectrum of {each.channel} ({each.nominal_db:.1f} dB off without them, {each.repaired_db:.1f} with)"
        for each in channels
        if each.repaired_db > each.nominal_db + _WORSE_DB
    ]
    worse += _worse_peaks(run)
    return f"Farther off with the effects in: {listed(worse)}." if worse else ""


def _worse_peaks(run: RunRecord) -> list[str]:
    """Mean peaks of half cycles that the repaired twin misses by more than the nominal one."""
    measured, nominal, repaired = (half_cycle_statistics(run, origin) for origin in ORIGINS)
    if not (measured and nominal and repaired):
        return []
    told = []
    for name, field in (("first", "first_mean_n"), ("max", "max_mean_n")):
        true, *twins = (getattr(each, field) for each in (measured, nominal, repaired))
        before, after = (each / true - 1 for each in twins)
        if abs(after) > abs(before) + _WORSE:
            told.append(f"peak force, {name} ({change(before)} without them, {change(after)} with)")
    return told


def _peak_numbers(run: RunRecord) -> list[BigNumber]:
    measured, nominal, predicted = (half_cycle_statistics(run, origin) for origin in ORIGINS)
    if not (measured or predicted):
        return []
    twins = {"predicted": predicted} if nominal is None else {"nominal": nominal, "repaired": predicted}
    by_whose = {"measured": measured, **twins}
    first = {
        whose: (each.first_mean_n, each.first_sd_n) if each else None for whose, each in by_whose.items()
    }
    largest = {whose: (each.max_mean_n, each.max_sd_n) if each else None for whose, each in by_whose.items()}
    return [_peaks("Peak force, first", "N", first), _peaks("Peak force, max", "N", largest)]


def _worst_rms(run: RunRecord) -> Iterator[BigNumber]:
    """The channel whose rms the last twin misses by most, of those that are compared."""
    apart: dict[str, float] = {}
    aside = run.still | run.roles.unwrapped
    for name, measured in run.measured.items():
        twin = run.tallies.get(("predicted", name))
        if twin and twin.rms >= 0 and measured.rms > 0 and name not in aside:
            apart[name] = abs(math.log(twin.rms / measured.rms)) if twin.rms else math.inf
    if apart:
        name = max(apart, key=apart.__getitem__)
        rms = [run.tallies[origin, name].rms for origin in ("predicted", "measured")]
        told = f"rms of {name}, {run.whose('predicted')} against measured"
        if run.verdict is not None and run.verdict.well and not run.repaired:
            told += "; the run is within what healthy rigs do"
        yield BigNumber("Largest difference", difference(*rms), told)


def _impact_numbers(run: RunRecord) -> Iterator[BigNumber]:
    """The group of sensors whose peaks a twin misses by most, with how often it is struck."""
    found: list[tuple[float, BigNumber]] = []
    if not run.roles.turns:
        return
    for group, by_whose in impacts_by_group(run).items():
        if not any(len(each.peak) for each in by_whose.values()):
            continue
        peaks = {whose: each.spread for whose, each in by_whose.items()}
        means = [mean for mean, _ in peaks.values() if mean > 0]
        unit = next(iter(by_whose.values())).unit
        tile = _peaks(f"Peak of an impact, {group}", unit, peaks)
        often = ", ".join(f"{whose} {number(each.a_revolution)}" for whose, each in by_whose.items())
        tile = replace(tile, remark=f"{tile.remark}; a revolution {often}".removeprefix("; "))
        found.append((max(means) / min(means) if len(means) == len(peaks) else math.inf, tile))
    yield from [tile for _, tile in sorted(found, key=lambda each: -each[0])[:1]]


def _peaks(label: str, unit: str, peaks: Mapping[str, tuple[float, float] | None]) -> BigNumber:
    """Mean and deviation of peaks as measured; as a remark those of each twin, and how far off it is."""
    measured = peaks.get("measured")
    remarks = []
    for whose, pair in peaks.items():
        if whose == "measured":
            continue
        against = f": {difference(pair[0], measured[0])}" if pair and measured else ""
        remarks.append(f"{whose} {spread(*pair, unit)}{against}" if pair else "no prediction")
    return BigNumber(label, spread(*measured, unit) if measured else DASH, "; ".join(remarks))


def _speed_numbers(run: RunRecord) -> list[BigNumber]:
    found = {whose: speed_figures(speed) for whose, speed in speeds(run).items()}
    if not found:
        return []
    set_to, measured = set_rpm(run), found.pop("measured", None)
    remarks = [] if set_to is None else [f"set {number(set_to, 'rpm')}"]
    remarks += [] if measured is None else [f"ripple {measured.ripple:.2f} rpm"]
    remarks += [f"{whose} {each.mean:.2f} rpm" for whose, each in found.items()]
    return [BigNumber("Crank speed", f"{measured.mean:.2f} rpm" if measured else DASH, "; ".join(remarks))]


def _channel_table(run: RunRecord) -> Table:
    """Rms and peak of each channel, measured and predicted; beside a repaired twin the nominal one's too."""
    twin_rms = ("nominal", "repaired") if run.repaired else ("rms predicted", "difference")
    peaks = ("nominal", "repaired") if run.repaired else ("peak predicted",)
    headings = (
        "channel", "unit", "rms measured", *twin_rms, "peak measured", *peaks, "overloaded blocks",
        "missing samples",
    )  # fmt: skip
    rows = []
    for name, channel in run.channels.items():
        measured, nominal, predicted = (run.tallies.get((origin, name)) for origin in ORIGINS)
        unit = channel.unit
        twins = [predicted]
        if run.repaired:
            twins = [nominal, predicted]
            against = [
                f"{_value(twin, 'rms', unit)} ({difference(twin.rms, measured.rms)})".replace(" ", _NARROW)
                if twin and measured and name not in run.still
                else _value(twin, "rms", unit)
                for twin in twins
            ]
        else:
            apart = difference(twins[0].rms, measured.rms) if twins[0] and measured else DASH
            against = [_value(twins[0], "rms", unit), "not compared" if name in run.still else apart]
        peaks_of = [_value(each, "peak", unit) for each in (measured, *twins)]
        figures = [_value(measured, "rms", unit), *against, *peaks_of]
        if name in run.roles.unwrapped:  # these only tell how long the run was
            figures = [DASH] * len(figures)
        lost = [measured.overloaded_blocks, measured.missing] if measured else [DASH, DASH]
        rows.append([name, as_written(unit)[1] or DASH, *figures, *map(str, lost)])
    still = [name for name in run.channels if name in run.still & run.measured.keys()]
    caption = "Channels"
    if still:
        caption += f"; the twin says 0 of {listed(still)}, whose sensor shows no more than its noise"
    if free := _not_predicted(run):
        caption += f"; no twin predicts {listed(free)}"
    return Table(headings, rows, caption)


def _not_predicted(run: RunRecord) -> list[str]:
    """What was measured and no twin has, where there is one at all."""
    twins = {name for origin, name in run.tallies if origin in ("nominal", "predicted")}
    return [name for name in run.measured if twins and name not in twins]


def _value(trace: Tally | None, name: str, unit: str) -> str:
    return (
        DASH if trace is None else number(as_written(unit)[0] * (trace.rms if name == "rms" else trace.peak))
    )
