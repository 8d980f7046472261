"""What one can argue with: in units, in the file, on the page and in the terminal."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rig.diagnosis.argument import argument, argument_lines, in_unit, of_cut_short
from rig.diagnosis.report.arguments import run_by_run, typical_cycle, why_not
from rig.diagnosis.report.case import Case
from rig.pages.content import Figure, Sentence, Table
from sim_twin.diagnosis.findings import Alone, Contrast, Findings
from sim_twin.diagnosis.fingerprint import Cell
from sim_twin.diagnosis.posterior import Estimate
from sim_twin.diagnosis.typical_cycle import TypicalCycle
from tests.rig.diagnosis.test_report import BASE, GAP, LAYOUT, UPPER, findings, reported

UNITS = {UPPER: "N"}
PEAK = next(
    k for k, cell in enumerate(LAYOUT.cells) if (cell.run, cell.channel, cell.what) == (1, UPPER, "peak")
)
CYCLE = np.sin(np.linspace(0, 2 * np.pi, 5000))


def argued(sizes: tuple[float, float] = (431.0, 431.0)) -> Findings:
    """The peaks were measured as the base says; each run says by itself how soft the base is."""
    found = findings(0.01, 0.96, 0.03)
    contrast = Contrast(PEAK, np.log(200.0), np.log(210.0), np.log(400.0), 3.2)
    alone = tuple(
        Alone(run, (((BASE,), 0.9), ((), 0.1)), (BASE,), ((Estimate(size, size - 10, size + 10),),))
        for run, size in enumerate(sizes)
    )
    course = ((2.0, 2.1), (2.0, 4.0))
    return replace(
        found,
        runner_up=((GAP,), found.nominal + 0.2),
        contrasts=(contrast,),
        alone=alone,
        gap=replace(found.gap, course_before=course, course_after=((1.0, 1.1), (1.2, 1.0))),
    )


def content(found: Findings) -> dict[str, Any]:
    lines = {"measured": CYCLE, "nominal": 2 * CYCLE, "repaired": CYCLE}
    return argument(found, UNITS, [TypicalCycle(1, UPPER, lines)])


def case(found: Findings) -> Case:
    runs = range(2)
    course = [
        {"run": k, "before": found.gap.course_before[k], "after": found.gap.course_after[k]} for k in runs
    ]
    return replace(reported(found), diagnosis={**content(found), "gap": {"course": course}})


@pytest.mark.parametrize(
    ("what", "number", "shown"),
    [
        ("energy", np.log(20.0), (pytest.approx(3.0103), "dB")),
        ("rms", np.log(9.0), (pytest.approx(3.0), "N")),
        ("peak", np.log(9.0), (pytest.approx(9.0), "N")),
        ("crest", np.log(9.0), (pytest.approx(9.0), "")),
        ("mean", 9.0, (9.0, "N")),
        ("share of time", 0.09, (pytest.approx(9.0), "%")),
        ("contacts", 9.0, (9.0, "")),
    ],
)
def test_numbers_are_told_as_people_read_them(what: str, number: float, shown: tuple[float, str]) -> None:
    assert in_unit(Cell(0, UPPER, what), "N", number, np.log(10.0)) == shown
    # nothing is known of numbers of a channel without a unit
    assert in_unit(Cell(0, "own", what), "", number, np.log(10.0)) == (number, "")
    # nor does a name mean anything where a cell says its own
    assert in_unit(Cell(0, "own", what, unit="mm"), "N", number, np.log(10.0)) == (number, "mm")


def test_the_file_holds_both_predictions_and_what_was_measured() -> None:
    told = content(argued())
    assert told["runner_up"] == ["clearance"]
    (row,) = told["contrasts"]
    assert (row["run"], row["channel"], row["what"], row["unit"]) == (1, UPPER, "peak", "N")
    assert [row[whose] for whose in ("measured", "selected", "runner_up")] == pytest.approx([200, 210, 400])
    first, _ = told["runs_alone"]
    assert first["believed"] == [
        {"effects": ["base_flexibility"], "share": 0.9},
        {"effects": [], "share": 0.1},
    ]
    (size,) = first["parameters"]
    assert (size["effect"], size["parameter"], size["ci95"]) == (
        "base_flexibility",
        "frequency_hz",
        [421.0, 441.0],
    )


def test_a_cycle_in_the_file_is_small_and_keeps_its_peak() -> None:
    (cycle,) = content(argued())["typical_cycle"]
    assert len(cycle["measured"]["values"]) <= 600
    peak = int(np.argmax(cycle["measured"]["values"]))
    assert cycle["measured"]["values"][peak] == pytest.approx(1.0, abs=1e-5)
    assert cycle["measured"]["phase"][peak] == pytest.approx(0.25, abs=1e-3)


def test_the_page_says_why_not_the_next_best() -> None:
    sentence, table, _ = why_not(case(argued()))
    assert isinstance(sentence, Sentence)
    assert sentence.text == (
        "Next best is a twin with clearance. Where both differ most, 1 of 1 figure speak for the twin with "
        "base flexibility."
    )
    assert isinstance(table, Table)
    assert table.headings == [
        "figure",
        "run",
        "measured",
        "with base flexibility",
        "with clearance",
        "apart",
        "speaks for",
    ]
    assert table.rows == [[f"{UPPER}: peak", "run2.mcap", "200 N", "210 N", "400 N", "3.2", "answer"]]
    rival = replace(argued().contrasts[0], measured=np.log(390.0), apart=0.5)
    sentence, table, _ = why_not(case(replace(argued(), contrasts=(rival,))))
    assert isinstance(sentence, Sentence)
    assert isinstance(table, Table)
    assert "cannot tell them apart" in sentence.text
    assert table.rows[0][-1] == "next best"


def test_the_page_says_whether_runs_agree_and_where_the_gap_changes() -> None:
    parts = run_by_run(case(argued()))
    alone, course = (part for part in parts if isinstance(part, Table))
    assert list(alone.rows[0]) == [
        "run1.mcap", "base flexibility", "90 %", "nothing missing 10 %", "431 Hz (421 to 441 Hz)"
    ]  # fmt: skip
    assert [list(row) for row in course.rows] == [
        ["run1.mcap", "2.00 → 1.00", "2.10 → 1.10"], ["run2.mcap", "2.00 → 1.20", "4.00 → 1.00"]
    ]  # fmt: skip
    warned = [part.text for part in parts if isinstance(part, Sentence) and part.warning]
    assert len(warned) == 1
    assert warned[0].endswith("It changes in run2.mcap.")
    parts = run_by_run(case(argued((431.0, 700.0))))
    warned = [part.text for part in parts if isinstance(part, Sentence) and part.warning]
    assert "The runs contradict each other in base flexibility, frequency." in warned[0]


def test_the_page_draws_a_cycle_of_each() -> None:
    (figure,) = typical_cycle(case(argued()))
    assert isinstance(figure, Figure)
    assert [trace["name"] for trace in figure.traces] == ["measured", "nominal twin", "repaired twin"]


def test_an_answer_that_was_cut_short_says_what_that_cost() -> None:
    assert "62 % of the search was done" in of_cut_short(0.62, 0.0)
    assert "intervals wider" in of_cut_short(0.62, 0.0)
    assert "99 % of the search" in of_cut_short(0.999, 0.0)
    assert of_cut_short(1.0, 0.4).endswith("the search was done, and 40 % of the rigs that it is judged by")
    # what comes after the judging was
    assert of_cut_short(1.0, 1.0).endswith("another machine may answer differently")


@pytest.mark.parametrize(
    ("measured", "apart", "told"),
    [
        (
            [200.0, 390.0],
            3.2,
            f"{UPPER}, peak is 200 N; the answer predicts 210 N, that 400 N; 1 of 2 figures say otherwise",
        ),
        (
            [390.0, 200.0],
            3.2,
            f"{UPPER}, peak is 200 N; the answer predicts 210 N, that 400 N; 1 of 2 figures say otherwise",
        ),
        ([390.0], 3.2, "of the 1 figure in which both differ most none speaks against it"),
        ([200.0], 0.5, "these runs cannot tell them apart"),
    ],
)
def test_the_terminal_names_a_figure_that_speaks_against_the_next_best(
    measured: list[float], apart: float, told: str
) -> None:
    first = argued().contrasts[0]
    contrasts = tuple(replace(first, measured=np.log(each), apart=apart) for each in measured)
    document = content(replace(argued(), contrasts=contrasts))
    lines = argument_lines({"verdict": "effect", "effects": [], "selected": [], **document})
    assert lines[-1] == f"why not    clearance: {told}"


def test_the_terminal_says_it_in_a_few_lines() -> None:
    selected = {
        "name": "base_flexibility", "present": 0.97,
        "parameters": {"frequency_hz": {"value": 431.0, "ci95": [419.0, 444.0]}},
    }  # fmt: skip
    gap = {"shrink": 0.98, "shrink_ci95": [0.91, 0.99]}
    document = {
        "verdict": "effect",
        "effects": [selected],
        "selected": ["base_flexibility"],
        "gap": gap,
        **content(argued()),
    }
    assert argument_lines(document) == [
        "in the rig base_flexibility 97 %: frequency_hz 431 (419 to 444)",
        "run 1 alone base_flexibility 90 %; frequency_hz 431 (421 to 441)",
        "run 2 alone base_flexibility 90 %; frequency_hz 431 (421 to 441)",
        f"why not    clearance: {UPPER}, peak is 200 N; the answer predicts 210 N, that 400 N",
    ]
