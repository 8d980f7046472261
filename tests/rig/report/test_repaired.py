"""Measured, nominal and repaired twin together, from a run whose three origins differ in size alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rig.pages.content import BigNumbers, Figure, Sentence, Table
from rig.report.page import render
from rig.report.record import RunRecord, Trace, read_run
from rig.report.sections.impacts import peaks
from rig.report.sections.overlays import Cycle, cycle_of, mean_cycle
from rig.report.sections.overlays import parts as overlays
from rig.report.sections.summary import parts as summary
from rig.report.summary import closeness
from tests.rig.synthetic_run import DRIVE_HZ, PEAK_N, write_log

THREE = ("measured", "nominal", "repaired")
FORCES = ("drive.force", "contact.force_upper", "contact.force_lower", "yoke.force")


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("repaired") / "run.mcap"
    return write_log(path, seconds=2.0, origins=("measured", "predicted", "nominal"))


@pytest.fixture(scope="module")
def run(log: Path) -> RunRecord:
    record = {"cycle_hz": f"{DRIVE_HZ}", "cycle_phase_rad": "0.0", "from_rest": "false"}
    return replace(read_run(log), metadata={"twin": record})


def test_closeness_is_the_ratio_of_sizes_in_decibels(run: RunRecord) -> None:
    found = {each.channel: each for each in closeness(run)}
    for name in FORCES:
        # the noise of 0.02 N lies more than 30 dB under what counts and changes its level by 0.2 dB at most
        assert found[name].nominal_db == pytest.approx(20 * np.log10(40 / 20), abs=0.2)
        assert found[name].repaired_db == pytest.approx(20 * np.log10(40 / 36), abs=0.2)
        assert found[name].halves_db < 0.2


def test_a_run_without_nominal_twin_has_no_closeness_and_no_repaired_twin(tmp_path: Path) -> None:
    plain = write_log(tmp_path / "run.mcap", 0.2)
    assert closeness(read_run(plain)) == []
    page = render(read_run(plain))
    assert "epaired" not in page.partition("<main>")[2].partition("</main>")[0]


def test_the_page_says_it_in_its_first_line_and_draws_all_three(run: RunRecord) -> None:
    first, bars, *_, table = summary(run)
    assert isinstance(first, BigNumbers)
    assert [number.label.split()[0] for number in first.numbers] == ["Nominal", "Repaired", "The"]
    assert isinstance(bars, Figure)
    assert tuple(bars.key) == THREE
    assert isinstance(table, Table)
    drive = dict(zip(table.headings[2:5], table.rows[0][2:5], strict=True))
    # 20 N and 36 N against 40 N
    assert drive["nominal"].endswith("(−50.0\N{NARROW NO-BREAK SPACE}%)")
    assert drive["repaired"].endswith("(−10.0\N{NARROW NO-BREAK SPACE}%)")


def test_what_is_farther_off_with_the_effects_in_is_said(run: RunRecord) -> None:
    assert not [part for part in summary(run) if isinstance(part, Sentence) and part.warning]
    other = {"nominal": "predicted", "predicted": "nominal"}
    turned = replace(
        run,
        traces={(other.get(whose, whose), name): each for (whose, name), each in run.traces.items()},  # type: ignore[misc]
        impacts=[replace(each, origin=other.get(each.origin, each.origin)) for each in run.impacts],
    )
    (told,) = [part.text for part in summary(turned) if isinstance(part, Sentence) and part.warning]
    assert "spectrum of yoke.force (0.9 dB off without them, 6.0 with)" in told
    assert "peak force, first (−10.0 % without them, −50.0 % with)" in told


def test_peaks_of_both_twins_stand_against_the_measured_ones(run: RunRecord) -> None:
    table = next(part for part in peaks(run) if isinstance(part, Table))
    rows = {row[0]: row for row in table.rows}
    assert list(rows)[:3] == [f"first, {whose}" for whose in THREE]
    # the mean of peaks that sit on samples, with noise, is within 0.3 %
    assert float(rows["first, nominal"][-1].split()[0].replace("−", "-")) == pytest.approx(-50.0, abs=0.3)
    assert float(rows["first, repaired"][-1].split()[0].replace("−", "-")) == pytest.approx(-10.0, abs=0.3)


def test_waves_are_drawn_over_one_cycle_and_as_their_mean(run: RunRecord) -> None:
    *_, figure = overlays(run)
    assert isinstance(figure, Figure)
    assert tuple(name for name in figure.key if name != "scatter") == THREE
    titles = [each["text"] for each in figure.layout["annotations"][:2]]
    assert "one drive cycle" in titles[0]
    assert "mean of all cycles" in titles[1]
    assert run.metadata["twin"]["from_rest"] == "false"


def test_only_a_run_from_rest_shows_its_first_impacts_beside_two_twins(run: RunRecord) -> None:
    started = replace(run, metadata={"twin": {**run.metadata["twin"], "from_rest": "true"}})
    *_, figure = overlays(started)
    assert isinstance(figure, Figure)
    assert "first impacts" in figure.layout["annotations"][0]["text"]


def test_the_mean_of_all_cycles_of_a_sine_is_the_sine(run: RunRecord) -> None:
    cycle = cycle_of(run)
    assert cycle == Cycle(DRIVE_HZ, 0.0, False)
    assert cycle is not None
    share, mean, deviation = mean_cycle(run.traces["measured", "drive.force"], cycle)
    expected = 0.2 * PEAK_N["measured"] * np.sin(2 * np.pi * share)
    # 256 samples in each of 400 places: 0.02 N / 16, five sigma; half a sample beside the place's middle
    assert mean == pytest.approx(expected, abs=5 * 0.02 / 16 + 8.0 * 2 * np.pi * 0.5 / 2560)
    # noise of 0.02 N, and the sine within a place
    assert deviation.max() == pytest.approx(0.02, abs=8.0 * 2 * np.pi / 400)


def test_missing_samples_are_left_out_of_the_mean() -> None:
    values = np.full(100, 3.0, dtype=np.float32)
    values[::3] = np.nan
    share, mean, deviation = mean_cycle(Trace(values, 10.0), Cycle(1.0, 0.0, False))
    assert len(share) == 10
    assert np.array_equal(mean, np.full(10, 3.0))
    assert not deviation.any()


@pytest.mark.parametrize(
    "told", [{}, {"cycle_hz": "x", "cycle_phase_rad": "0"}, {"cycle_hz": "0", "cycle_phase_rad": "0"}]
)
def test_a_cycle_that_makes_no_sense_is_none(run: RunRecord, told: dict[str, str]) -> None:
    assert cycle_of(replace(run, metadata={"twin": told})) is None
