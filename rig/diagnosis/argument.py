"""What speaks for an answer and against it, in units that people read, for the file and the terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from math import exp, log
from typing import Any

import numpy as np

from daq.signals.envelope import envelope
from rig.pages.words import counted, estimate, probability, span
from sim_twin.diagnosis.cause import Hypothesis
from sim_twin.diagnosis.findings import Findings
from sim_twin.diagnosis.fingerprint import Cell
from sim_twin.diagnosis.typical_cycle import TypicalCycle

_DECIBELS = 10 / log(10)
_POINTS = 600
_DIGITS = 5
_BELIEVED = 0.01
SAME = 1.0
"""Apart by less in what healthy rigs differ by: two predictions that nobody can tell apart."""


def in_unit(cell: Cell, unit: str, number: float, nominal: float) -> tuple[float, str]:
    """The mean of a cell's numbers as people read it; `unit` is the channel's.

    Energies are told against the `nominal` twin's; a cell that says its own unit, or has none, as it is.
    """
    if cell.unit or not unit:
        return number, cell.unit
    if cell.what == "energy":
        return round(_DECIBELS * (number - nominal), _DIGITS), "dB"
    if cell.what in ("rms", "peak"):
        return exp(number / 2 if cell.what == "rms" else number), unit
    if cell.what == "share of time":
        return 100 * number, "%"
    return (
        (exp(number), "")
        if cell.what == "crest"
        else (number, unit if cell.what in ("mean", "swing") else "")
    )


def argument(findings: Findings, units: Mapping[str, str], cycles: Sequence[TypicalCycle]) -> dict[str, Any]:
    """The blocks of a diagnosis that one can argue with; `units` of the channels."""
    return {
        "runner_up": None if findings.runner_up is None else _names(findings.runner_up[0]),
        "contrasts": _contrasts(findings, units),
        "unexplained": asdict(findings.left),
        "not_fitting": [
            {
                "channel": each.channel, "with": each.partner or None, "what": each.what,
                "about_hz": None if each.octave is None else 2.0**each.octave, "times": times,
            }
            for each, times in findings.not_fitting
        ],
        "entered": [
            {
                "key": parameter.name, "probability": each.probability, "unit": parameter.unit,
                "value": each.estimate.value, "ci95": [each.estimate.low, each.estimate.high],
            }
            for each in findings.entered
            for parameter in each.cause.parameters
            if each.probability >= _BELIEVED
        ],
        "runs_alone": [
            {
                "run": each.run,
                "believed": [
                    {"effects": _names(hypothesis), "share": share}
                    for hypothesis, share in each.shares
                    if share >= _BELIEVED
                ],
                "parameters": [
                    {
                        "effect": cause.name, "channel": cause.channel, "parameter": parameter.name,
                        "unit": parameter.unit, "value": one.value, "ci95": [one.low, one.high],
                    }
                    for cause, estimates in zip(each.best, each.estimates, strict=False)
                    if not cause.entered
                    for parameter, one in zip(cause.parameters, estimates, strict=True)
                ],
            }
            for each in findings.alone
        ],
        "typical_cycle": [
            {
                "run": each.run, "channel": each.channel, "unit": units.get(each.channel, ""),
                **{whose: _points(line) for whose, line in each.lines.items()},
            }
            for each in cycles
        ],
    }  # fmt: skip


def _names(hypothesis: Hypothesis) -> list[str]:
    return [cause.name for cause in hypothesis]


def _contrasts(findings: Findings, units: Mapping[str, str]) -> list[dict[str, Any]]:
    starts, rows = findings.layout.starts, []
    for each in findings.contrasts:
        cell = findings.layout.cells[each.cell]
        nominal = float(findings.nominal[starts[each.cell] : starts[each.cell + 1]].mean())
        unit = units.get(cell.channel, "")
        values = [
            in_unit(cell, unit, number, nominal)[0] for number in (each.measured, each.chosen, each.rival)
        ]
        rows.append(
            {
                "run": cell.run, "channel": cell.channel, "with": cell.partner, "what": cell.what,
                "band_hz": cell.band, "phase": cell.phase, "unit": in_unit(cell, unit, 0.0, 0.0)[1],
                "measured": values[0], "selected": values[1], "runner_up": values[2], "apart": each.apart,
            }
        )  # fmt: skip
    return rows


def _points(line: np.ndarray[Any, Any]) -> dict[str, list[float]]:
    """A cycle by its extremes: where in it, and the value there."""
    chosen = envelope(np.asarray(line, np.float64), _POINTS)
    phase = np.round(chosen.indices / len(line), _DIGITS)
    return {"phase": phase.tolist(), "values": [float(f"{value:.{_DIGITS}g}") for value in chosen.values]}


def of_cut_short(searched: float, judging: float) -> str:
    """What is said of an answer for which time ran out after these shares of the search and the judging."""
    told = "time ran out: fewer rigs were simulated than planned, so another machine may answer differently"
    if searched < 1.0:
        return (
            f"{told}; {_percent(searched)} of the search was done, and its evidence counts by that share: "
            "probabilities are evener and intervals wider than they would be"
        )
    if judging < 1.0:
        return f"{told}; the search was done, and {_percent(judging)} of the rigs that it is judged by"
    return told


def _percent(share: float) -> str:
    """Not all, where something is lacking."""
    return f"{min(round(100 * share), 99)} %"


def argument_lines(content: Mapping[str, Any]) -> list[str]:
    """A diagnosis as its file holds it, in a few lines for a terminal: what one would ask next."""
    told = []
    for each in content["effects"]:
        if each["name"] in content["selected"]:
            sizes = [
                f"{name} {estimate(one['value'])} ({_span(one)})"
                for name, one in each["parameters"].items()
                if "ci95" in one
            ]
            told.append(f"in the rig {each['name']} {probability(each['present'])}: {', '.join(sizes)}")
    for each in content["entered"]:
        told.append(
            f"[model]    {each['key']} may be wrong, {probability(each['probability'])}: "
            f"{estimate(each['value'], each['unit'])} ({_span(each)})"
        )
    for run in content["runs_alone"]:
        first = run["believed"][0]
        whose = " and ".join(first["effects"]) or "nothing missing"
        said = [f"{whose} {probability(first['share'])}"]
        if content["verdict"] != "none":
            said += [
                f"{one['parameter']} {estimate(one['value'])} ({_span(one)})" for one in run["parameters"]
            ]
        told.append(f"run {run['run'] + 1} alone {'; '.join(said)}")
    if content["contrasts"]:
        told.append(f"why not    {' and '.join(content['runner_up'])}: {_why_not(content['contrasts'])}")
    return told


def _why_not(contrasts: Sequence[Mapping[str, Any]]) -> str:
    """The figure that speaks most clearly against the next best; the most telling ones come first."""
    if contrasts[0]["apart"] < SAME:
        return "these runs cannot tell them apart"
    against = [one for one in contrasts if speaks_for_answer(one)]
    if not against:
        return f"of the {counted(len(contrasts), 'figure')} in which both differ most none speaks against it"
    one = against[0]
    measured, ours, other = (
        estimate(one[whose], one["unit"]) for whose in ("measured", "selected", "runner_up")
    )
    others = len(contrasts) - len(against)
    but = f"; {others} of {counted(len(contrasts), 'figure')} say otherwise" if others else ""
    figure = f"{one['channel']}, {one['what']}{_where(one)}"
    return f"{figure} is {measured}; the answer predicts {ours}, that {other}{but}"


def _where(one: Mapping[str, Any]) -> str:
    """In which part of a cycle or of a spectrum, in words."""
    if one["band_hz"]:
        return " at {:.0f} to {:.0f} Hz".format(*one["band_hz"])
    return " from {:.2f} to {:.2f} of the cycle".format(*one["phase"]) if one["phase"] else ""


def speaks_for_answer(one: Mapping[str, Any]) -> bool:
    """Whether what was measured lies nearer to what was selected than to the runner-up, of a contrast."""
    return bool(abs(one["measured"] - one["selected"]) < abs(one["measured"] - one["runner_up"]))


def _span(one: Mapping[str, Any]) -> str:
    low, high = one["ci95"]
    return span(low, high, "")
