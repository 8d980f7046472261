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
from rig.surrogates.recordings import PAPER, QUICK_SECONDS, Setting, log_of
from rig.twin.recorded_samples import samples_of
from sim_twin.surrogates.samples import COLUMNS, LEARNT, SETTINGS, TESTED, Samples

Array = NDArray[np.float64]
_UNITS, _EVERY = 10, 20
"""Every so many of the recorded samples, filtered: 1280 Hz."""
_GOAL, _MANY = 0.01, 400
_EXACT, _POOR = 90.0, 50.0
_SHORT = {"crank_frame.acceleration_y": "crank y", "crank_frame.acceleration_x": "crank x",
          "piston_frame.acceleration_y": "piston y"}  # fmt: skip
_GAPS = {"1 and 1 mm": (1, 1), "1 and 2 mm": (1, 2), "2 and 2 mm": (2, 2)}
_POINTS = (
    f"{LEARNT + TESTED} points at 1280 Hz of two speeds and two materials (steel and aluminium; the paper "
    f"does not say which), as many of each, {LEARNT} drawn at random to learn from and {TESTED} to test. "
    "The recordings are of the emulated bench, whose frame rings at 180 to 310 Hz after each impact."
)


@dataclass(frozen=True, slots=True)
class _Curves:
    """The paper's number of points of recordings, which are its runs, and which of them are learnt."""

    settings: Sequence[Setting]
    points: Samples
    learnt: NDArray[np.bool_]

    @property
    def shown(self) -> Array:
        return self.points.outputs

    @property
    def inputs(self) -> Array:
        """Time and the settings that differ, scaled, shape (n, inputs)."""
        from sim_twin.surrogates.surrogate import Features

        columns = Features.of_samples(self.points, "time").of(self.points.inputs)
        return np.asarray((columns - columns.mean(axis=0)) / columns.std(axis=0))


def _curves(effort: paper.Effort, *gaps: tuple[float, float]) -> _Curves:
    """Of some pairs of clearances. Raises LogError where the recordings are not there."""
    settings = [each for each in PAPER if (each.clearance_1, each.clearance_2) in gaps]
    parts = []
    for number, setting in enumerate(settings):
        log = None if effort.recordings is None else log_of(effort.recordings, setting, QUICK_SECONDS)
        if log is None:
            raise LogError(f"no recording of {setting.name}; rattle surrogate report makes it")
        parts.append(_points(log)[: (LEARNT + TESTED + len(settings) - 1 - number) // len(settings)])
    points = Samples.joined(parts)
    learnt = np.zeros(len(points), bool)
    learnt[np.random.default_rng(paper.SEED).permutation(len(points))[:LEARNT]] = True
    return _Curves(settings, points, learnt)


@functools.lru_cache(maxsize=len(PAPER))
def _points(log: Path) -> Samples:
    with LogReader(log) as reader:
        return samples_of(reader, _EVERY)


def _explained(curves: _Curves, predicted: Array) -> paper.Sample:
    """Percent of the variance of the points that were not learnt, of each channel."""
    test = ~curves.learnt
    shown = curves.shown[test]
    return paper.Sample(100 - 100 * np.mean((shown - predicted[test]) ** 2, axis=0) / shown.var(axis=0))


def _mean(shares: paper.Sample) -> paper.Ratio:
    return paper.Ratio(shares.mean, shares.error)


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


_BY_POINTS = np.geomspace(0.002, 2.0, 16).tolist(), np.geomspace(0.002, 2.0, 6).tolist()


def _best_grnn(curves: _Curves, effort: paper.Effort) -> Any:
    return _best(curves, _grnn(0.1), effort.of(*_BY_POINTS))


def _by_ten(curves: _Curves) -> Array:
    return _fitted(curves, _best(curves, _rbf(max_units=_UNITS), (0.25, 0.5, 1.0, 2.0)))


def _grnn_figure(gaps: tuple[float, float], claim: paper.Claim, effort: paper.Effort) -> paper.Outcome:
    curves = _curves(effort, gaps)
    network = _best_grnn(curves, effort)
    found = _fitted(curves, network)
    plain = _fitted(curves, _grnn(1.0), curves.points.inputs[:, _PLAIN])
    subject = "variance of the test points that the GRNN explains"
    apart = float(np.median(np.diff(curves.inputs[:, 0])))
    remark = f"Width by cross-validation: {network.width / apart:.1f} times the time between two points."
    wide = "A spread of 1 in inputs as they come, seconds among them: of each recording one average."
    return paper.Outcome(
        [
            paper.against(subject, claim, _mean(_explained(curves, found)), "%", remark),
            paper.against(
                "the same, as wide as the toolbox makes it",
                claim,
                _mean(_explained(curves, plain)),
                "%",
                wide,
                what_if=True,
            ),
        ],
        [Sentence(_POINTS), _drawn(curves, "GRNN", found, f"psc-grnn-{gaps[0]}-{gaps[1]}")],
    )


def _rbf_figure(gaps: tuple[float, float], claim: paper.Claim, effort: paper.Effort) -> paper.Outcome:
    curves = _curves(effort, gaps)
    ten = _by_ten(curves)
    units = effort.of(_MANY, 60)
    many = _fitted(curves, _rbf(max_units=units, error_goal=_GOAL))
    remark = "Ten Gaussians have no part in a frame that rings at 180 to 310 Hz."
    if claim is _BETTER:
        subject, less = (
            "variance that the RBF network explains, less what the GRNN does",
            _explained(curves, _fitted(curves, _best_grnn(curves, effort))).values,
        )
    else:
        subject, less = "variance of the test points that the RBF network explains", np.zeros(len(_SHORT))
    statements = [
        paper.against(
            f"{subject}, {words}",
            claim,
            _mean(paper.Sample(_explained(curves, found).values - less)),
            "%",
            said,
            what_if=found is many,
        )
        for found, words, said in (
            (ten, "ten units", remark),
            (
                many,
                "units until the error is 1 %",
                f"At most {units} units for {LEARNT} points: it interpolates.",
            ),
        )
    ]
    return paper.Outcome(
        statements,
        [Sentence(_POINTS), _drawn(curves, "RBF, ten units", ten, f"psc-rbf-{gaps[0]}-{gaps[1]}")],
    )


def _drawn(curves: _Curves, whose: str, predicted: Array, name: str) -> Part:
    chart = Plots(rows=len(_SHORT), columns=len(curves.settings), row_px=150, legend=True)
    for column, setting in enumerate(curves.settings):
        here = curves.points.runs == column
        times = curves.points.column("time")[here]
        for row, channel in enumerate(_SHORT.values()):
            cell = len(curves.settings) * row + column
            title = f"{channel}, {setting.speed:g} rpm, {setting.material}"
            chart.axes(cell, title, "time, s", "" if column else "m/s²", share_x_with=column)
            chart.line(cell, "recorded", times, curves.shown[here, row], Style(BLUE, 1.6))
            chart.line(cell, whose, times, predicted[here, row], paper.OURS_LINE)
    return chart.figure(name, f"All {LEARNT + TESTED} points, learnt and tested.")


def _history(effort: paper.Effort) -> paper.Outcome:
    curves, units = _curves(effort, *_GAPS.values()), effort.of(_MANY, 60)
    network = _rbf(max_units=units, error_goal=_GOAL)
    _fitted(curves, network)
    errors = np.asarray(network.history_)
    chart = Plots(rows=1, columns=1, row_px=260, legend=True)
    logarithmic = {"type": "log", "exponentformat": "power", "dtick": 1}
    chart.axes(
        0, "Training history", "units", "mean squared error, share of the variance", y_axis=logarithmic
    )
    across = np.arange(1, len(errors) + 1)
    chart.line(0, "learnt points", across, errors, paper.OURS_LINE)
    chart.line(0, "goal", across[[0, -1]], [_GOAL, _GOAL], paper.TEXT_LINE)
    desired = paper.below(_GOAL, "repeated until the desired mean squared error is obtained")
    ten = paper.about(_UNITS, "one hidden layer with ten nonlinear neurons", "4.1")
    remark = (
        f"The goal is ours, {_GOAL:.0%} of the variance: the text's figure has no number that can be read."
    )
    statements = [
        paper.Statement(
            f"mean squared error of the {LEARNT} points, ten units",
            desired,
            float(errors[min(_UNITS, len(errors)) - 1]),
            remark=remark,
        ),
        paper.Statement(
            "units that it takes to the goal, or are there at most", ten, len(errors), remark=remark
        ),
    ]
    return paper.Outcome(statements, [Sentence(_ALL_POINTS), chart.figure("psc-history")])


_ALL_POINTS = f"{LEARNT + TESTED} points of all twelve recordings, so that all five inputs vary."
_PLAIN = [list(COLUMNS).index(name) for name in ("time", "speed", "density")]
"""In s, rpm and kg/m3: what differs between the points of a figure."""
_INPUTS = dict(
    zip(("time", *SETTINGS), ("time", "speed", "clearance c₁", "clearance c₂", "material"), strict=True)
)
_NODE = Style(BLUE, mode="markers+text", size=10)
_EDGE = Style(GREY, 0.5)
_BARE = {"visible": False}


def _labelled(chart: Plots, name: str, caption: str) -> Part:
    """A drawing whose nodes have their names above them."""
    drawing = chart.figure(name, caption)
    for trace in drawing.traces:
        trace["textposition"] = "top center"
    return drawing


def _structure(effort: paper.Effort) -> paper.Outcome:
    """Figure 3: the network as it is implemented, once it has learnt, and its neurons."""
    from sim_twin.surrogates.surrogate import Features

    curves, network = _curves(effort, *_GAPS.values()), _rbf(max_units=_UNITS)
    _fitted(curves, network)
    taken = Features.of_samples(curves.points, "time")
    names = [said for name, said in _INPUTS.items() if name not in taken.constants]
    layers = [network.n_features_in_, len(network.centres_), network.weights_.shape[1]]
    heights = [np.linspace(1, -1, count) * (count - 1) / (max(layers) - 1) for count in layers]
    chart = Plots(rows=2, columns=1, row_px=420, legend=True)
    chart.axes(
        0, "(a) the network", x_axis={**_BARE, "range": [-0.4, 2.4]}, y_axis={**_BARE, "range": [-1.15, 1.2]}
    )
    for left, (first, second) in enumerate(pairwise(heights)):
        ends = np.array([(one, other, np.nan) for one in first for other in second])
        across = np.tile([left, left + 1.0, np.nan], len(ends))
        chart.line(0, "centres" if left == 0 else "weights", across, ends.ravel(), _EDGE)
    labels = (names, [f"a{number}" for number in range(1, layers[1] + 1)], list(_SHORT.values()))
    for column, (height, texts) in enumerate(zip(heights, labels, strict=True)):
        chart.line(0, "neurons", np.full(len(height), column), height, _NODE, texts=texts)
    widest = float(network.widths_.max())
    chart.axes(
        1,
        "(b) its neurons (eq. 15 to 17)",
        "distance v of the inputs from a centre, in their deviations",
        "a",
    )
    far = np.linspace(0, 3 * widest, 200)
    for width in network.widths_:
        chart.line(1, "a of one neuron", far, np.exp(-(far**2) / (2 * width**2)), paper.SECOND_LINE)
    said = "five linear neurons, ten nonlinear neurons, three linear neurons"
    return paper.Outcome(
        [
            paper.Statement(what, paper.about(count, said, "4.1"), ours)
            for what, count, ours in zip(
                ("inputs", "hidden units", "outputs"), (5, 10, 3), layers, strict=True
            )
        ],
        [
            Sentence(_ALL_POINTS),
            _labelled(chart, "psc-structure", "As it has learnt: widths are those of its units."),
        ],
    )


_STEPS = ("emulated bench", "logs", "inputs", "to learn", "to test", "network", "error")


def _flow(effort: paper.Effort) -> paper.Outcome:
    """Figure 4: from the bench to the error, as it is implemented."""
    curves = _curves(effort, *_GAPS.values())
    learnt, tested = int(curves.learnt.sum()), int((~curves.learnt).sum())
    counts = (
        "",
        f"{len(curves.settings)} ",
        f"{curves.inputs.shape[1]} ",
        f"{learnt} ",
        f"{tested} ",
        "",
        "",
    )
    places = {0: (0, 0), 1: (1, 0), 2: (2, 0), 3: (3, 0.6), 4: (3, -0.6), 5: (4, 0.6), 6: (5, 0)}
    ways = ((0, 1), (1, 2), (2, 3), (2, 4), (3, 5), (4, 5), (5, 6), (4, 6))
    chart = Plots(rows=1, columns=1, row_px=240, legend=True)
    chart.axes(
        0,
        "From the bench to the error",
        x_axis={**_BARE, "range": [-0.6, 5.6]},
        y_axis={**_BARE, "range": [-1, 1]},
    )
    ends = np.array([[places[one], places[other], (np.nan, np.nan)] for one, other in ways]).reshape(-1, 2)
    chart.line(0, "then", ends[:, 0], ends[:, 1], _EDGE)
    across, up = np.array(list(places.values())).T
    texts = [count + step for count, step in zip(counts, _STEPS, strict=True)]
    chart.line(0, "step", across, up, _NODE, texts=texts)
    said = "500 and 259 data are used in training and testing stages"
    return paper.Outcome(
        [
            paper.Statement("points that are learnt", paper.about(500, said, "5"), learnt),
            paper.Statement("points that are tested", paper.about(259, said, "5"), tested),
        ],
        [_labelled(chart, "psc-flow", "An error over the goal adds a unit to the network.")],
    )


_BETTER = paper.above(0.0, "better convergence ability to the experimental results than that of the GRNN")
_SAID = {
    5: paper.below(_POOR, "a certain deviation from the experimental results; not suitable for modeling"),
    6: paper.above(_EXACT, "a good convergence to the experimental results; an accurate prediction"),
    7: paper.below(_POOR, "the GRNN gives a poor modeling characteristic"),
    8: paper.above(_EXACT, "fully follow the experimental values; an exact matching"),
    9: paper.below(_POOR, "the GRNN gives poor convergence ability for all simulations", "6"),
    10: _BETTER,
}


def _figure(number: int) -> paper.PaperFigure:
    words, gaps = list(_GAPS.items())[(number - 5) // 2]
    name, compute = ("GRNN", _grnn_figure) if number % 2 else ("RBF network", _rbf_figure)
    return paper.PaperFigure(
        f"psc-{number}",
        f"{name} and recordings, clearances of {words}",
        f"5, Fig. {number}",
        functools.partial(compute, gaps, _SAID[number]),
        recorded=True,
    )


FIGURES = (
    paper.PaperFigure("psc-3", "The network's structure", "4.1, Fig. 3", _structure, recorded=True),
    paper.PaperFigure("psc-4", "From recordings to predictions", "4.1, Fig. 4", _flow, recorded=True),
    *map(_figure, _SAID),
    paper.PaperFigure("psc-11", "Training history of the RBF network", "5, Fig. 11", _history, recorded=True),
)
