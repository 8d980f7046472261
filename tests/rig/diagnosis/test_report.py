"""The report of a diagnosis says what the findings say."""

from __future__ import annotations

import html as markup
import json
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig.diagnosis.argument import argument
from rig.diagnosis.diagnose_runs import SECTIONS, write_report
from rig.diagnosis.document import _finite
from rig.diagnosis.report import verdict as verdicts
from rig.diagnosis.report.arguments import what_does_not_fit
from rig.diagnosis.report.before_and_after import latent_force
from rig.diagnosis.report.before_and_after import parts as before_and_after
from rig.diagnosis.report.case import Case, RunFacts, identified
from rig.diagnosis.report.causes import basis, parameters, ranking
from rig.diagnosis.report.gap_map import parts as gap_map
from rig.pages.content import BarTable, Figure, Sentence, Table
from sim_twin.diagnosis.belief import Unexplained
from sim_twin.diagnosis.cause import Cause
from sim_twin.diagnosis.discrepancy import Discrepancy
from sim_twin.diagnosis.findings import Entered, Findings, Gap, Judged
from sim_twin.diagnosis.fingerprint import Columns, Layout
from sim_twin.diagnosis.gap import FARTHEST
from sim_twin.diagnosis.latent_force import DISPLACEMENT, TIME, VELOCITY, Curve, LatentForce
from sim_twin.diagnosis.posterior import Estimate
from sim_twin.effects import Parameter
from tests.rig.browser import browser_page, faults_of_report, needs_chromium

UPPER, LOWER = "contact.force_upper", "contact.force_lower"
COLUMNS = Columns((UPPER, LOWER, "drive.force"), (UPPER, LOWER), 20.0, 25_600.0)
LAYOUT = Layout((*COLUMNS.cells(0), *COLUMNS.cells(1)))
UNIT_BEFORE, UNIT_AFTER = 1.2, 1.6
FLOOR = np.full(len(LAYOUT.cells), 0.1)
RUNS = [RunFacts(f"run{k}.mcap", "impact_beam, 20 Hz, 9 N", {UPPER: "N", LOWER: "N"}) for k in (1, 2)]
SCENARIO = 'name = "slower"\nrig = "impact_beam"\n[drive]\nfrequency = "7 Hz"\n'
DIAGNOSIS: Mapping[str, Any] = {
    "horizon_s": 0.41,
    "next_experiment": {"scenario": SCENARIO, "separates": ["clearance"], "expected_probability": 0.93},
    "cost": {"simulations": 5200, "seconds": 140.0},
}

BASE = Cause("base_flexibility", "base", (Parameter("frequency_hz", "Hz", ((150.0, 1500.0),)),))
GAP = Cause("clearance", "contact joint", (Parameter("scale", "", ((0.5, 0.9), (1.1, 2.0))),))
SKEW = Cause("time_skew", "clock", (Parameter("seconds", "s", ((5e-5, 2e-3),)),), channel=UPPER, sensing=True)


def judged(cause: Cause, probability: float, found: Estimate, alike: tuple[str, ...] = ()) -> Judged:
    name = cause.parameters[0].name
    best = (cause.name, {name: found.value})
    return Judged(cause, probability, {name: found}, best, 1.3, 0.95, alike, present=probability + 0.02)


def gap(before: float, after: float, shrink: float | None) -> Gap:
    """Floors of a gap that is largest in the upper contact force of the second run, at 400 Hz."""
    cells = np.ones(len(LAYOUT.cells))
    for k, cell in enumerate(LAYOUT.cells):
        if cell.channel == UPPER and cell.run == 1:
            cells[k] = 3.0 if cell.band is None or not cell.band[0] <= 400.0 < cell.band[1] else 30.0
    interval = None if shrink is None else (0.91, 0.99)
    return Gap(before, after, shrink, interval, cells, np.ones_like(cells), UNIT_BEFORE, UNIT_AFTER, 0.9)


def findings(none: float, effect: float, unknown: float, selected: tuple[Cause, ...] = (BASE,)) -> Findings:
    """Findings whose judgements add up to `effect`, the base first."""
    rng = np.random.default_rng(1)
    nominal = rng.normal(size=LAYOUT.size)
    return Findings(
        layout=LAYOUT,
        none=none,
        effect=effect,
        unknown=unknown,
        judged=(
            judged(GAP, 0.2 * effect, Estimate(1.31, 1.22, 1.44)),
            judged(BASE, 0.7 * effect, Estimate(431.0, 419.0, 444.0)),
            judged(SKEW, 0.1 * effect, Estimate(62e-6, 55e-6, 71e-6)),
        ),
        selected=selected,
        effects=tuple((cause.name, {cause.parameters[0].name: 430.0}) for cause in selected),
        gap=gap(7.4, 1.1 if selected else 7.4, 0.98 if selected else 0.0),
        by_location={"base": 0.81, "contact joint": 0.19},
        separability={("base_flexibility", "clearance"): 0.99, ("clearance", "base_flexibility"): 0.62},
        measured=nominal + 0.4,
        nominal=nominal,
        repaired=nominal + 0.39 if selected else nominal,
        floor=FLOOR,
        held_out=True,
        simulations=5200,
        left=Unexplained(1.04, 0.9, 1.1),
    )


def reported(found: Findings, remarks: tuple[str, ...] = ()) -> Case:
    return Case(found, DIAGNOSIS, RUNS, remarks)


def nothing_missing() -> Findings:
    return findings(none=0.96, effect=0.03, unknown=0.01, selected=())


def outside_the_catalogue() -> Findings:
    return findings(none=0.0, effect=0.2, unknown=0.8, selected=())


def test_the_verdict_names_effect_place_probability_parameter_and_shrink() -> None:
    what, far = verdicts.sentences(reported(findings(none=0.01, effect=0.96, unknown=0.03)))
    assert what == (
        "The gap probably comes from base flexibility at the base (probability 67 %): "
        "frequency 431 Hz, 95 % interval 419 to 444 Hz."
    )
    assert "falls from 7.40 to 1.10" in far
    assert "98 % of it is gone, 95 % interval 91 to 99 %" in far


def test_the_verdict_is_worded_by_how_sure_it_is() -> None:
    wording = {}
    for share in (0.95, 0.7, 0.5):
        found = findings(none=0.0, effect=0.96, unknown=0.04)
        one = judged(BASE, share, Estimate(431.0, 419.0, 444.0))
        wording[share] = verdicts.sentences(reported(replace(found, judged=(one,))))[0]
    assert wording[0.95].startswith("The gap comes from base flexibility")
    assert wording[0.7].startswith("The gap probably comes from")
    assert wording[0.5].startswith("The gap may come from")


def test_effects_that_look_alike_are_named_together() -> None:
    found = findings(none=0.01, effect=0.96, unknown=0.03)
    alike = replace(found.judged[1], indistinguishable_from=("time_skew",))
    what, _ = verdicts.sentences(reported(replace(found, judged=(alike, found.judged[0], found.judged[2]))))
    assert "base flexibility at the base (probability 67 %) or from time skew in the clock of" in what
    assert what.endswith(f"{UPPER} (10 %), which these sensors and settings cannot tell apart.")


def test_a_gap_that_stays_open_is_said_with_what_its_parameters_are_worth() -> None:
    found = findings(0.01, 0.96, 0.03)
    far = [verdicts.sentences(reported(replace(found, gap=gap(9.0, left, 0.8))))[1] for left in (1.4, 1.6)]
    assert "nearest twin that was found" not in far[0]
    assert "nearest twin that was found" in far[1]


def test_an_interval_without_width_is_not_told() -> None:
    shown = gap(9.0, 1.1, 0.99)
    assert verdicts.interval(shown) == "95 % interval 91 to 99 %"
    assert verdicts.interval(replace(shown, shrink_ci95=(0.998, 1.0))) == ""


def test_a_pair_names_both_and_the_larger() -> None:
    what, far = verdicts.sentences(reported(findings(0.01, 0.96, 0.03, selected=(GAP, BASE))))
    assert "base flexibility at the base and clearance at the contact joint together" in what
    assert "together, in the rig with a probability of 69 % and 21 %;" in what
    assert "base flexibility is the larger (probability 67 %)" in what
    assert far.startswith("With both in the twin")


def test_nothing_missing_tells_what_could_still_hide() -> None:
    what, hidden = verdicts.sentences(reported(nothing_missing()))
    assert what.startswith("Nothing is missing: the twin explains the runs (probability 96 %)")
    assert "3 effects, base flexibility at the base is the hardest to rule out (2 %)" in hidden
    assert "it could hide with frequency from 419 to 444 Hz" in hidden


def test_unknown_tells_the_nearest_effect_and_where_the_rest_lies() -> None:
    what, where = verdicts.sentences(reported(outside_the_catalogue()))
    assert what.startswith(
        "Something that no effect of the catalogue explains is in the rig (probability 80 %)"
    )
    assert "the nearest, base flexibility at the base, has 14 %" in what
    assert f"largest in {UPPER}" in where
    assert where.endswith("most at 400 to 500 Hz.")


def test_a_repaired_twin_that_nobody_had_time_for_is_not_shown() -> None:
    found = replace(findings(0.01, 0.96, 0.03), repaired=None)
    _, far = verdicts.sentences(reported(found))
    assert "no time to simulate the repaired twin" in far
    assert "repaired twin" not in json.dumps([part.traces for part in figures(reported(found))])


def figures(of: Case) -> list[Figure]:
    return [part for section in SECTIONS for part in section.parts(of) if isinstance(part, Figure)]


@pytest.mark.parametrize(
    "found",
    [findings(0.01, 0.96, 0.03), nothing_missing(), outside_the_catalogue()],
    ids=["effect", "none", "unknown"],
)
def test_no_view_is_empty(found: Findings) -> None:
    for section in SECTIONS:
        parts = section.parts(reported(found))
        # no force is asked for where nothing unknown acts; cycles and single runs are other findings'
        optional = {"Latent force", "A typical cycle", "Run by run", "What does not fit"}
        assert parts or section.heading in optional, section.heading
        assert all(part.rows for part in parts if isinstance(part, Table | BarTable)), section.heading
    assert len(figures(reported(found))) == 1 + len(RUNS)
    assert all(figure.traces for figure in figures(reported(found)))


def test_probabilities_in_the_ranking_add_up_and_are_those_of_the_findings() -> None:
    found = findings(0.01, 0.96, 0.03)
    table = next(part for part in ranking(reported(found)) if isinstance(part, BarTable))
    shares = {row.label: row.share for row in table.rows}
    expected = {"base flexibility": 0.672, "clearance": 0.192, "time skew": 0.096}
    assert shares == pytest.approx({**expected, "nothing missing": 0.01, "unknown to the catalogue": 0.03})
    assert [row.share for row in table.rows] == sorted(shares.values(), reverse=True)


def test_a_partner_that_is_hardly_the_largest_stands_beside_the_other() -> None:
    found = findings(0.01, 0.96, 0.03)
    weak = replace(found.judged[2], probability=0.0, present=0.9)
    table = ranking(reported(replace(found, judged=(*found.judged[:2], weak))))[0]
    assert isinstance(table, BarTable)
    assert [row.label for row in table.rows][:2] == ["time skew", "base flexibility"]
    assert table.rows[0].more[1] == "90\N{NO-BREAK SPACE}%"


def test_effects_that_are_rejected_without_a_twin_of_their_own_share_a_row() -> None:
    found = findings(0.01, 0.96, 0.03)
    names = ("weak", "faint", "slight")
    others = [
        replace(
            judged(replace(GAP, name=name), 0.001, Estimate(1.3, 1.2, 1.4)),
            present=0.002,
            after=None,
            shrink=None,
        )
        for name in names
    ]
    case = reported(replace(found, judged=(*found.judged, *others)))
    table = next(part for part in ranking(case) if isinstance(part, BarTable))
    (row,) = (row for row in table.rows if row.label == "3 others")
    assert row.more[:2] == ("weak, faint and slight", "<\N{NO-BREAK SPACE}1\N{NO-BREAK SPACE}%")
    assert row.share == pytest.approx(0.003)
    assert not {row.label for row in table.rows} & {*names}


def test_a_parameter_whose_interval_is_as_wide_as_its_range_is_not_called_found() -> None:
    found = findings(0.01, 0.96, 0.03)
    wide = judged(BASE, 0.95, Estimate(500.0, 155.0, 900.0))
    what, _ = verdicts.sentences(reported(replace(found, judged=(wide,))))
    assert "frequency is not identified, anything from 155 to 900 Hz of 150 to 1500 Hz fits as well" in what
    table = next(
        part for part in parameters(reported(replace(found, judged=(wide,)))) if isinstance(part, Table)
    )
    assert table.rows[0][4] == "155 to 900 Hz (not identified)"
    narrow = next(part for part in parameters(reported(found)) if isinstance(part, Table))
    assert narrow.rows[0][4] == "419 to 444 Hz"


def test_a_sensor_the_wrong_way_round_is_found_whatever_is_left_of_its_narrow_range() -> None:
    factor = Parameter("factor", "", ((-1.05, -0.95), (9.5, 10.5)))
    assert identified(factor, Estimate(-1.0, -1.04, -0.96))
    assert not identified(Parameter("scale", "", ((0.5, 0.9), (1.1, 2.0))), Estimate(1.5, 1.1, 2.0))


def test_the_largest_gaps_are_of_as_many_quantities_and_say_where_the_measure_ends() -> None:
    found = findings(0.01, 0.96, 0.03)
    cells = np.where(found.gap.cells_before > 10.0, FARTHEST, found.gap.cells_before)
    case = reported(replace(found, gap=replace(found.gap, cells_before=cells)))
    table = [part for part in gap_map(case) if isinstance(part, Table)][-1]
    kinds = {(str(cell).partition(",")[0], run) for cell, run, *_ in table.rows}
    assert len(kinds) == len(table.rows)
    assert list(table.headings) == ["cell", "run", "measured", "nominal twin", "before", "after"]
    assert table.rows[0][4] == f"≥ {FARTHEST / UNIT_BEFORE:.2f}"
    assert not str(table.rows[-1][4]).startswith("≥")


OTHER_LENGTHS = Parameter("beam_length", "mm", ((200.0, 270.0), (290.0, 360.0)))
LENGTH = Cause("model.beam_length", "beam", (OTHER_LENGTHS,), entered=True)


def test_a_value_that_may_be_wrong_is_named_in_the_unit_of_the_scenario() -> None:
    wrong = replace(outside_the_catalogue(), entered=(Entered(LENGTH, 0.8, Estimate(262.0, 258.0, 267.0)),))
    what, _ = verdicts.sentences(reported(wrong))
    assert what.endswith(
        "It may be that beam_length of [model] is wrong (probability 80 %): 262 mm fits, "
        "95 % interval 258 to 267 mm."
    )
    [told] = argument(wrong, {}, [])["entered"]
    assert told["key"] == "beam_length"
    assert (told["value"], told["unit"], told["ci95"]) == (262.0, "mm", [258.0, 267.0])
    unlikely = replace(wrong, entered=(replace(wrong.entered[0], probability=0.1),))
    assert "beam_length" not in verdicts.sentences(reported(unlikely))[0]


def test_an_effect_beside_a_wrong_value_shrinks_the_gap_with_it() -> None:
    found = findings(none=0.0, effect=0.97, unknown=0.03, selected=(BASE, LENGTH))
    assert found.names == ("base_flexibility",)
    _, far = verdicts.sentences(reported(found))
    assert far.startswith("With it, and with beam_length of [model] as it fits, in the twin the gap falls")
    told = [part.text for part in basis(reported(found)) if isinstance(part, Sentence)]
    assert any(text.startswith("Correct beam_length of [model] first") for text in told)


def test_figures_that_do_not_fit_are_told_where_something_unknown_may_be_there() -> None:
    off = (
        (Discrepancy(UPPER, "energy", 0.8, octave=9), 5.26),
        (Discrepancy(UPPER, "coherence", 0.2, partner=LOWER, octave=7), 3.0),
        (Discrepancy(LOWER, "peak", 0.2), 2.3),
    )

    def told(found: Findings) -> list[Any]:
        found = replace(found, not_fitting=off)
        content = json.loads(json.dumps(_finite(argument(found, {}, []))))
        return what_does_not_fit(replace(reported(found), diagnosis=content))

    _, table = told(outside_the_catalogue())
    assert [list(row) for row in table.rows] == [
        [f"{UPPER}: energy, about 512 Hz", "5.3"],
        [f"{UPPER} with {LOWER}: coherence, about 128 Hz", "3.0"],
        [f"{LOWER}: peak", "2.3"],
    ]
    assert told(nothing_missing()) == []


def test_the_runner_up_is_drawn_where_it_fails() -> None:
    found = findings(0.01, 0.96, 0.03)
    beside = reported(replace(found, runner_up=((GAP,), found.nominal + 0.2)))
    figure = next(part for part in before_and_after(beside) if isinstance(part, Figure))
    assert "with clearance instead" in {trace["name"] for trace in figure.traces}
    alone = next(part for part in before_and_after(reported(found)) if isinstance(part, Figure))
    assert not any("instead" in trace["name"] for trace in alone.traces)


def test_the_map_shows_each_cell_in_units_of_a_healthy_rigs_gap() -> None:
    maps = [part for part in gap_map(reported(findings(0.01, 0.96, 0.03))) if isinstance(part, Figure)]
    spectra = maps[1].traces[0]
    row = spectra["y"].index(UPPER)
    column = next(k for k, low in enumerate(spectra["x"]) if low == 400.0)
    assert spectra["customdata"][row][column] == pytest.approx(30.0 / UNIT_BEFORE)
    lower = spectra["customdata"][spectra["y"].index(LOWER)]
    assert lower[column] == pytest.approx(1.0 / UNIT_BEFORE, abs=1e-3)
    assert len(spectra["x"]) == len(spectra["customdata"][row]) + 1


def test_channels_gaps_are_root_mean_squares_of_their_cells() -> None:
    found = findings(0.01, 0.96, 0.03)
    table = next(part for part in gap_map(reported(found)) if isinstance(part, Table))
    cells = found.gap.cells_before[[cell.channel == UPPER for cell in LAYOUT.cells]]
    shown = {row[0]: float(row[1]) for row in table.rows}
    # Two decimals are shown.
    assert shown[UPPER] == pytest.approx(np.sqrt(np.mean(cells**2)) / UNIT_BEFORE, abs=0.005)


def test_the_page_says_which_channel_alone_is_off_and_where_nothing_is_known() -> None:
    found = replace(outside_the_catalogue(), by_location={"sensor": 0.2, "not known": 0.8})
    bars = next(part for part in gap_map(reported(found)) if isinstance(part, BarTable))
    assert [(row.label, row.apart) for row in bars.rows] == [("not known", True), ("sensor", False)]
    said = [
        part.text for part in gap_map(reported(replace(found, alone_off=LOWER))) if isinstance(part, Sentence)
    ]
    assert f"{LOWER} alone does not fit: look at its sensor, its cable, and what it sits on." in said
    assert not any(LOWER in part.text for part in gap_map(reported(found)) if isinstance(part, Sentence))


def test_what_is_left_is_in_units_of_a_healthy_rigs_gap_to_the_repaired_twin() -> None:
    parts = gap_map(reported(findings(0.01, 0.96, 0.03)))
    maps = [part for part in parts if isinstance(part, Figure)]
    channels, largest = (part for part in parts if isinstance(part, Table))
    # the second state below the first, in the same views
    after = [trace["customdata"] for trace in maps[1].traces[len(maps[1].traces) // 2 :]]
    drawn = np.concatenate([np.ravel(np.array(rows, float)) for rows in after])
    # a cell is left white where a channel has no such view; the page has three digits
    assert np.unique(drawn[np.isfinite(drawn)]) == pytest.approx([1.0 / UNIT_AFTER], abs=1e-3)
    assert {row[-1] for row in (*channels.rows, *largest.rows)} == {f"{1.0 / UNIT_AFTER:.2f}"}
    assert largest.rows[0][-2] == f"{30.0 / UNIT_BEFORE:.2f}"


def text_of(path: Path) -> str:
    page = path.read_text(encoding="utf-8").split("<script>")[0]
    bare = re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)
    return " ".join(markup.unescape(re.sub(r"<[^>]*>", " ", bare)).split())


def test_the_page_holds_parameters_lookalikes_remarks_and_the_next_scenario(tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    remark = "run1.mcap: no yoke.force: what only it shows cannot be found"
    write_report(path, Case(findings(0.01, 0.96, 0.03), DIAGNOSIS, RUNS, [remark], folder=path.parent))
    text = text_of(path)
    assert remark in text
    assert "base flexibility 69 % frequency 431 Hz 419 to 444 Hz 150 to 1500 Hz 430 Hz" in text
    assert "62 µs 55 to 71 µs 50 µs to 2 ms" in text
    assert "cannot tell base flexibility from clearance: right in 62 % of cases" in text
    assert 'frequency = "7 Hz"' in text
    assert "expected to be 93 %" in text
    assert "5200 simulated recordings in 140 s" in text


def test_markup_in_names_stays_text(tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    write_report(path, Case(nothing_missing(), DIAGNOSIS, [RunFacts("<b>x</b>", "<i>")], ["<img src=x>"]))
    page = path.read_text(encoding="utf-8")
    assert "<img src=x>" not in page
    assert "&lt;img src=x&gt;" in page


@pytest.mark.browser
@needs_chromium
def test_every_plot_is_drawn_and_nothing_is_fetched(tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    write_report(path, Case(findings(0.01, 0.96, 0.03), DIAGNOSIS, RUNS, [], folder=path.parent))
    complaints: list[str] = []
    fetched: list[str] = []
    with browser_page() as page:
        page.set_viewport_size({"width": 1200, "height": 900})
        page.on("console", lambda message: complaints.append(message.text))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("request", lambda request: fetched.append(request.url))
        page.goto(path.as_uri())
        page.wait_for_function("[...document.querySelectorAll('.plot')].every(plot => plot.calcdata)")
        drawn = page.evaluate("[...document.querySelectorAll('.plot')].map(plot => plot.calcdata.length)")
        wide = page.evaluate("document.documentElement.scrollWidth")
    # Nine plots with a band's two lines and three lines each; maps of two states with four views each.
    assert drawn == [8, 8, 9 * 5]
    assert wide <= 1200
    assert complaints == []
    assert fetched == [path.as_uri()]


@pytest.mark.long
@pytest.mark.browser
@needs_chromium
def test_no_text_of_a_diagnosis_is_cut_or_lies_on_another(tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    write_report(path, Case(findings(0.01, 0.96, 0.03), DIAGNOSIS, RUNS, [], folder=path.parent))
    assert faults_of_report(path) == []


def test_a_latent_force_is_told_and_drawn_where_it_is_largest() -> None:
    edges = np.linspace(-0.15, 0.15, 7)
    middles = (edges[:-1] + edges[1:]) / 2
    twin, scatter = np.zeros(6), np.full(6, 20.0)
    spring = Curve(DISPLACEMENT, edges, -2400 * middles, twin, scatter)
    flat = [Curve(axis, edges, twin, twin, scatter) for axis in (VELOCITY, TIME)]
    quiet = LatentForce(0, "piston guide", "guide", (replace(spring, measured=twin), *flat))
    forces = [LatentForce(1, "crank bearing", "joint 1", (spring, *flat)), quiet]
    sentence, figure = latent_force(replace(reported(outside_the_catalogue()), forces=forces))
    assert isinstance(sentence, Sentence)
    # the outermost bin: 2400 N/m times 0.125 m, over 20 N
    assert "crank bearing in run2.mcap: 300 N more at a displacement of -125 mm, 15.0 times" in sentence.text
    assert isinstance(figure, Figure)
    assert {trace["name"] for trace in figure.traces} == {
        "healthy",
        "healthy rig",
        "measured",
        "nominal twin",
    }
