"""PSC, figures 3 to 11: the two networks, and what they make of recordings of the emulated bench."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.errors import LogError
from daq.log.reader import LogReader
from rig.pages.content import Part, Sentence
from rig.pages.plots import BLUE, GREY, Plots, Style
from rig.reproduce import figure as paper
from rig.surrogates.recordings import PAPER, QUICK_SECONDS, log_of
from rig.twin.recorded_samples import samples_of

Array = NDArray[np.float64]
_LEARNT, _TESTED, _UNITS = 500, 259, 10
_EVERY = 20
"""Of the recorded samples: at 1280 Hz half of 759 points are about a revolution at either speed."""
_GOAL, _MANY = 0.01, 400
_EXACT, _POOR = 90.0, 50.0
_SHORT = {"crank_frame.acceleration_y": "crank y", "crank_frame.acceleration_x": "crank x",
          "piston_frame.acceleration_y": "piston y"}  # fmt: skip
_GAPS = {"1 and 1 mm": (1, 1), "1 and 2 mm": (1, 2), "2 and 2 mm": (2, 2)}
_POINTS = (
    "759 points at 1280 Hz, half of them at 150 and half at 200 rpm, 500 drawn at random to learn from and "
    "259 to test; time and speed vary, clearances and material are the same in all of a figure and dropped. "
    "The recordings are of the emulated bench, whose frame rings at 180 to 310 Hz after each impact."
)


@dataclass(frozen=True, slots=True)
class _Curves:
    """Points of one clearance setting at both speeds: `inputs` (time, speed), scaled, and what was shown."""

    times: Array
    speeds: Array
    shown: Array
    learnt: NDArray[np.bool_]

    @property
    def inputs(self) -> Array:
        columns = np.column_stack([self.times, self.speeds])
        return np.asarray((columns - columns.mean(axis=0)) / columns.std(axis=0))


def _curves(effort: paper.Effort, gaps: tuple[float, float]) -> _Curves:
    """Raises LogError where the recordings are not there."""
    parts = []
    for setting in PAPER:
        if (setting.clearance_1, setting.clearance_2) != gaps:
            continue
        log = None if effort.recordings is None else log_of(effort.recordings, setting, QUICK_SECONDS)
        if log is None:
            raise LogError(f"no recording of {setting.name}; rattle surrogate report makes it")
        parts.append(_points(log))
    number = np.concatenate([np.full(len(each.inputs), row) for row, each in enumerate(parts)])
    order = np.concatenate([np.arange(len(each.inputs)) for each in parts])
    points = np.flatnonzero(order < (_LEARNT + _TESTED + 1 - number) // 2)
    learnt = np.zeros(len(points), bool)
    learnt[np.random.default_rng(paper.SEED).permutation(len(points))[:_LEARNT]] = True
    times, speeds, shown = (
        np.concatenate(rows)[points]
        for rows in zip(
            *((each.column("time"), each.column("speed"), each.outputs) for each in parts), strict=True
        )
    )
    return _Curves(times, speeds, shown, learnt)


@functools.lru_cache(maxsize=8)
def _points(log: Path) -> Any:
    with LogReader(log) as reader:
        return samples_of(reader, _EVERY)


def _explained(curves: _Curves, predicted: Array) -> paper.Ratio:
    """Percent of the variance of the points that were not learnt, the mean over channels, and its error."""
    test = ~curves.learnt
    shown = curves.shown[test]
    left = np.mean((shown - predicted[test]) ** 2, axis=0) / shown.var(axis=0)
    return paper.Ratio(float(100 * (1 - left.mean())), float(100 * left.std(ddof=1) / np.sqrt(len(left))))


def _fitted(curves: _Curves, network: Any, inputs: Array | None = None) -> Array:
    given = curves.inputs if inputs is None else inputs
    network.fit(given[curves.learnt], curves.shown[curves.learnt])
    return np.asarray(network.predict(given))


def _rbf(**given: Any) -> Any:
    from sim_twin.surrogates.networks import RBFNetwork

    return RBFNetwork(random_state=paper.SEED, **given)


def _grnn(width: float) -> Any:
    from sim_twin.surrogates.networks import GRNN

    return GRNN(width=width)


def _best(curves: _Curves, network: Any, widths: Sequence[float]) -> Any:
    """The width by cross-validation over the points that are learnt."""
    from sklearn.model_selection import GridSearchCV, KFold

    folds = KFold(5, shuffle=True, random_state=paper.SEED)
    search = GridSearchCV(network, {"width": list(widths)}, scoring="neg_mean_squared_error", cv=folds)
    search.fit(curves.inputs[curves.learnt], curves.shown[curves.learnt])
    return search.best_estimator_


def _grnn_figure(gaps: tuple[float, float], effort: paper.Effort) -> paper.Outcome:
    curves = _curves(effort, gaps)
    found = _fitted(curves, _best(curves, _grnn(0.1), np.geomspace(0.002, 2.0, effort.of(16, 6)).tolist()))
    plain = _fitted(curves, _grnn(1.0), np.column_stack([curves.times, curves.speeds]))
    text = "a certain deviation; this type of network is not suitable"
    claim, subject = paper.below(_POOR, text), "variance of the test points that the GRNN explains"
    remark = "Width by cross-validation: so narrow that it interpolates between neighbours."
    return paper.Outcome(
        [
            paper.against(subject, claim, _explained(curves, found), "%", remark),
            paper.against(
                "the same, as wide as the toolbox makes it",
                claim,
                _explained(curves, plain),
                "%",
                "A spread of 1 in inputs as they come, seconds among them: all of the record is one average.",
                what_if=True,
            ),
        ],
        [Sentence(_POINTS), _drawn(curves, {"GRNN": found}, f"psc-grnn-{gaps[0]}-{gaps[1]}")],
    )


def _rbf_figure(gaps: tuple[float, float], effort: paper.Effort) -> paper.Outcome:
    curves = _curves(effort, gaps)
    ten = _fitted(curves, _best(curves, _rbf(max_units=_UNITS), (0.25, 0.5, 1.0, 2.0)))
    many = _fitted(curves, _rbf(max_units=effort.of(_MANY, 60), error_goal=_GOAL))
    subject = "variance of the test points that the RBF network explains"
    claim = paper.above(_EXACT, "exact matching; fully follows the experimental values")
    remark = "Ten Gaussians over 0.3 s have no part in a frame that rings at 180 to 310 Hz."
    return paper.Outcome(
        [
            paper.against(f"{subject}, ten units", claim, _explained(curves, ten), "%", remark),
            paper.against(
                f"{subject}, units until the error is 1 %",
                claim,
                _explained(curves, many),
                "%",
                f"Up to {effort.of(_MANY, 60)} units for {_LEARNT} points: it interpolates.",
                what_if=True,
            ),
        ],
        [Sentence(_POINTS), _drawn(curves, {"RBF, ten units": ten}, f"psc-rbf-{gaps[0]}-{gaps[1]}")],
    )


def _drawn(curves: _Curves, predicted: dict[str, Array], name: str) -> Part:
    chart = Plots(rows=len(_SHORT), columns=2, row_px=150, legend=True)
    for row, channel in enumerate(_SHORT.values()):
        for column, speed in enumerate(np.unique(curves.speeds)):
            cell, here = 2 * row + column, curves.speeds == speed
            chart.axes(cell, f"{channel}, {speed:g} rpm", "time, s", "m/s²", share_x_with=column)
            chart.line(cell, "recorded", curves.times[here], curves.shown[here, row], Style(BLUE, 1.6))
            for whose, values in predicted.items():
                chart.line(cell, whose, curves.times[here], values[here, row], paper.OURS_LINE)
    return chart.figure(name, "All 759 points, learnt and tested.")


def _history(effort: paper.Effort) -> paper.Outcome:
    curves = _curves(effort, (1, 1))
    units = effort.of(_MANY, 60)
    network = _rbf(max_units=units, error_goal=_GOAL)
    _fitted(curves, network)
    errors = np.asarray(network.history_)
    chart = Plots(rows=1, columns=1, row_px=260)
    logarithmic = {"type": "log", "exponentformat": "power"}
    chart.axes(
        0, "Training history", "units", "mean squared error, share of the variance", y_axis=logarithmic
    )
    chart.line(0, "ours", np.arange(1, len(errors) + 1), errors, paper.OURS_LINE)
    claim = paper.below(
        0.1, "fast convergence and high accuracy, with ten hidden neurons", "4.1 and 6, Fig. 11"
    )
    ten = float(errors[min(_UNITS, len(errors)) - 1])
    remark = "Of the points that are learnt. The text's figure has no number that can be read."
    statements = [paper.Statement("mean squared error with ten units", claim, ten, remark=remark)]
    return paper.Outcome(statements, [Sentence(_POINTS), chart.figure("psc-history")])


_INPUTS = ("time or crank angle", "speed", "material", "clearance c₁", "clearance c₂")
_NODE = Style(BLUE, mode="markers+text", size=10)
_EDGE = Style(GREY, 0.5)


def _labelled(chart: Plots, name: str, caption: str) -> Part:
    """A drawing whose nodes have their names above them."""
    drawing = chart.figure(name, caption)
    for trace in drawing.traces:
        trace["textposition"] = "top center"
    return drawing


def _structure(_: paper.Effort) -> paper.Outcome:
    """Figure 3: the network as it is implemented."""
    from sim_twin.surrogates.samples import SETTINGS

    layers = [len(_INPUTS), _UNITS, len(_SHORT)]
    heights = [np.linspace(-1, 1, count) * (count - 1) / (_UNITS - 1) for count in layers]
    chart = Plots(rows=1, columns=1, row_px=420, legend=True)
    bare = {"visible": False}
    chart.axes(
        0, "RBF network", x_axis={**bare, "range": [-0.6, 2.6]}, y_axis={**bare, "range": [-1.15, 1.2]}
    )
    for left, (above, below) in enumerate(pairwise(heights)):
        ends = np.array([(one, other, np.nan) for one in above for other in below])
        across = np.tile([left, left + 1.0, np.nan], len(ends))
        chart.line(0, "weights", across, ends.ravel(), _EDGE)
    labels = (_INPUTS, [f"a{number}" for number in range(1, _UNITS + 1)], list(_SHORT.values()))
    for column, (height, texts) in enumerate(zip(heights, labels, strict=True)):
        chart.line(0, "neurons", np.full(len(height), column), height, _NODE, texts=texts)
    said = "five linear neurons, ten nonlinear neurons, three linear neurons"
    return paper.Outcome(
        [
            paper.Statement("inputs", paper.about(5, said, "4.1"), 1 + len(SETTINGS)),
            paper.Statement("hidden units", paper.about(10, said, "4.1"), _rbf().max_units),
            paper.Statement("outputs", paper.about(3, said, "4.1"), len(_SHORT)),
        ],
        [
            _labelled(
                chart, "psc-structure", "Each a is a Gaussian of the distance to its centre (eq. 15 to 17)."
            )
        ],
    )


_STEPS = ("emulated bench", "log", "time, speed, material, c₁, c₂", "500 to learn", "259 to test",
          "network", "error")  # fmt: skip


def _flow(effort: paper.Effort) -> paper.Outcome:
    """Figure 4: from the bench to the error, as it is implemented."""
    places = {0: (0, 0), 1: (1, 0), 2: (2, 0), 3: (3, 0.6), 4: (3, -0.6), 5: (4, 0.6), 6: (5, 0)}
    ways = ((0, 1), (1, 2), (2, 3), (2, 4), (3, 5), (5, 6), (4, 6))
    chart = Plots(rows=1, columns=1, row_px=240, legend=True)
    bare = {"visible": False}
    chart.axes(
        0,
        "From the bench to the error",
        x_axis={**bare, "range": [-0.6, 5.6]},
        y_axis={**bare, "range": [-1, 1]},
    )
    ends = np.array([[places[one], places[other], (np.nan, np.nan)] for one, other in ways]).reshape(-1, 2)
    chart.line(0, "then", ends[:, 0], ends[:, 1], _EDGE)
    across, up = np.array(list(places.values())).T
    chart.line(0, "step", across, up, _NODE, texts=_STEPS)
    said = "500 and 259 data are used in training and testing stages"
    return paper.Outcome(
        [
            paper.Statement("points to learn from", paper.about(500, said, "5"), _LEARNT),
            paper.Statement("points to test on", paper.about(259, said, "5"), _TESTED),
        ],
        [_labelled(chart, "psc-flow", "An error over the goal adds a unit to the network.")],
    )


FIGURES = (
    paper.PaperFigure("psc-3", "The network's structure", "4.1, Fig. 3", _structure),
    paper.PaperFigure("psc-4", "From recordings to predictions", "4.1, Fig. 4", _flow),
    *(
        paper.PaperFigure(
            f"psc-{number + (0 if compute is _grnn_figure else 1)}",
            f"{'GRNN' if compute is _grnn_figure else 'RBF network'} and recordings, clearances of {words}",
            f"5, Fig. {number + (0 if compute is _grnn_figure else 1)}",
            functools.partial(compute, gaps),
            recorded=True,
        )
        for number, (words, gaps) in zip((5, 7, 9), _GAPS.items(), strict=True)
        for compute in (_grnn_figure, _rbf_figure)
    ),
    paper.PaperFigure("psc-11", "Training history of the RBF network", "5, Fig. 11", _history, recorded=True),
)
