"""The model file: what calibration writes is read again, and every fault in a file is told."""

from __future__ import annotations

import numpy as np
import pytest

from daq.errors import ConfigurationError
from rig.files.model_file import load_model, model_text, parse_model
from sim_twin.diagnosis.discrepancy import Discrepancy
from sim_twin.healthy import Matched
from tests.rig.files.faulty import only_problem, problems_of

NAMES = ("beam.E", "contact_stiffness", "yoke.force.gain")
COVARIANCE = np.array([[0.64, 0.2, 0.0], [0.2, 0.25, -0.1], [0.0, -0.1, 1.0]])
FOUND = Matched(NAMES, np.array([0.31, -1.2, 0.05]), COVARIANCE)
NOMINALS = {"beam.E": 207e9, "contact_stiffness": 1.5e7, "yoke.force.gain": 1.0}
TEXT = model_text("impact_beam", ["a.mcap"], ['the "old" beam'], NOMINALS, FOUND, {"beam.E": "2.07e+11 Pa"})


def changed(old: str, new: str) -> str:
    assert old in TEXT
    return TEXT.replace(old, new, 1)


def test_what_was_written_is_read() -> None:
    model = parse_model(TEXT, "model", "impact_beam")
    assert (model.rig, model.runs, model.scenarios) == ("impact_beam", ("a.mcap",), ('the "old" beam',))
    assert model.nominals == NOMINALS
    assert model.matched.names == NAMES
    # Four digits of means and deviations, three of correlations are written.
    assert model.matched.mean == pytest.approx(FOUND.mean, abs=1e-4)
    assert model.matched.covariance == pytest.approx(COVARIANCE, abs=2e-3)


def test_the_specimen_that_it_is_of_is_read() -> None:
    text = model_text("impact_beam", ["a"], ["a"], NOMINALS, FOUND, {}, specimen='the "old" beam')
    assert parse_model(text, "model", "impact_beam").specimen == 'the "old" beam'
    assert parse_model(TEXT, "model", "impact_beam").specimen is None


def test_what_the_matched_twin_does_otherwise_is_read_too() -> None:
    wanted = (
        Discrepancy("contact.force_upper", "energy", 0.25, octave=9),
        Discrepancy("contact.force_upper", "coherence", 0.04, "yoke.force", 11),
        Discrepancy("yoke.force", "rms", 1e-3),
    )
    text = model_text("impact_beam", ["a"], ["a"], NOMINALS, FOUND, {}, discrepancies=wanted)
    assert parse_model(text, "model", "impact_beam").discrepancies == wanted
    odd = text.replace("octave = 9", "octave = 9.5").replace("deviation = 0.001", "deviation = -1")
    found = problems_of(lambda: parse_model(odd, "model", "impact_beam"))
    assert set(found) == {"discrepancies[1].octave", "discrepancies[3].deviation"}


def test_what_was_found_stands_beside_it_in_physical_terms() -> None:
    assert 'name = "beam.E"  # 2.07e+11 Pa' in TEXT


def test_a_model_of_another_rig_is_refused() -> None:
    problem = only_problem(lambda: parse_model(TEXT, "model", "planar_slider_crank"), "rig")
    assert "planar_slider_crank" in problem.allowed


@pytest.mark.parametrize(
    ("old", "new", "key", "allowed"),
    [
        ("mean = 0.3100", "mean = 17", "tolerances[1].mean", "-4 to 4"),
        ("deviation = 0.5000", "deviation = 1.5", "tolerances[2].deviation", "0 to 1"),
        ("deviation = 0.5000", "", "tolerances[2].deviation", "0 to 1"),
        ("nominal = 1.0", 'nominal = "big"', "tolerances[3].nominal", ""),
        ('name = "beam.E"', 'name = "contact_stiffness"', "tolerances[2].name", "once"),
        ("correlations = [0.500]", "correlations = [2.0]", "tolerances[2].correlations", "-1 to 1"),
        ("correlations = [0.500]", "correlations = []", "tolerances[2].correlations", "1 numbers"),
        ("correlations = [0.000, -0.200]", "correlations = [1.0, -1.0]", "tolerances", "at the same time"),
        ("runs =", "run =", "run", "did you mean runs"),
        ('runs = ["a.mcap"]', "runs = 3", "runs", "a list of texts"),
        ("runs =", "specimen = 3\nruns =", "specimen", "a text"),
    ],
)
def test_faults_are_told(old: str, new: str, key: str, allowed: str) -> None:
    problem = only_problem(lambda: parse_model(changed(old, new), "model", "impact_beam"), key)
    assert allowed in problem.allowed


def test_all_faults_are_told_at_once() -> None:
    text = changed("mean = 0.3100", "mean = true").replace("deviation = 1.0000", "deviation = -1")
    found = problems_of(lambda: parse_model(text, "model", "impact_beam"))
    assert set(found) == {"tolerances[1].mean", "tolerances[3].deviation"}


def test_a_file_without_tolerances_or_none_at_all_is_refused(tmp_path: object) -> None:
    only_problem(lambda: parse_model('rig = "impact_beam"', "model", "impact_beam"), "tolerances")
    with pytest.raises(ConfigurationError, match="a readable file"):
        load_model(f"{tmp_path}/absent.toml", "impact_beam")
