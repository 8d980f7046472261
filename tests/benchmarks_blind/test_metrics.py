"""Every metric of the blind check on answers whose score is known by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.blind import metrics
from benchmarks.blind.baselines import BASELINES, REPEATS
from benchmarks.blind.cases import Estimate, Gaps, Ranked, answer_of, shrink
from benchmarks.blind.figure import Bar
from benchmarks.blind.intervals import bootstrap, wilson
from tests.benchmarks_blind.stories import CLEARANCE, DAMPING, GAIN, OUTSIDER, answer, case

RIGHT = answer({"clearance": 0.8, "contact_damping": 0.1, "none": 0.1})
WRONG = answer({"contact_damping": 0.7, "shaker_mass": 0.2, "clearance": 0.1})
SAYS_NONE = answer({"none": 0.6, "clearance": 0.4})


def test_first_answer_counts_one_where_it_is_the_truth() -> None:
    assert metrics.first_right(case("single", RIGHT, CLEARANCE)) == 1
    assert metrics.first_right(case("single", WRONG, CLEARANCE)) == 0
    assert metrics.first_right(case("none", SAYS_NONE)) == 1


def test_none_stands_before_a_less_probable_effect() -> None:
    hidden = case("single", SAYS_NONE, CLEARANCE)
    assert metrics.first_right(hidden) == 0
    assert metrics.first_effect_right(hidden) == 1
    assert metrics.location_right(hidden) == 0


def test_a_named_set_of_n_counts_one_nth() -> None:
    likely = {"contact_damping": 0.7, "none": 0.1, "unknown": 0.1, "pivot_friction": 0.1}
    named = answer(likely, alike=("clearance", "shaker_mass"))
    assert metrics.first_right(case("single", named, CLEARANCE)) == pytest.approx(1 / 3)
    assert metrics.first_right(case("single", named, DAMPING)) == pytest.approx(1 / 3)
    assert metrics.three_right(case("single", named, CLEARANCE)) == pytest.approx(1 / 3)
    assert metrics.three_right(case("single", named, DAMPING)) == 1
    assert metrics.three_right_by_set(case("single", named, DAMPING)) == pytest.approx(1 / 3)
    assert metrics.first_right(case("single", named, GAIN)) == 0


def test_either_of_a_pair_is_right() -> None:
    assert metrics.first_right(case("pair", WRONG, CLEARANCE, DAMPING)) == 1
    assert metrics.truth_probability(case("pair", WRONG, CLEARANCE, DAMPING)) == pytest.approx(0.8)


def test_a_failed_diagnosis_is_wrong_everywhere() -> None:
    failed = case("single", None, CLEARANCE, gaps=Gaps(5.0, 1.0))
    assert metrics.first_right(failed) == metrics.three_right(failed) == metrics.location_right(failed) == 0
    assert metrics.truth_probability(failed) == 0
    assert metrics.relative_shrink(failed) == 0
    assert metrics.parameter_error(failed) == math.inf
    assert metrics.parameter_covered(failed) == 0
    assert metrics.selected_f1([failed]) == 0
    assert metrics.failed(failed) == 1
    assert metrics.confidence(failed) == (1.0, 0.0)
    assert metrics.place_right(case("strong", None, OUTSIDER)) == metrics.unknown_first(failed) == 0
    assert metrics.false_alarm(case("none", None)) == 1
    assert metrics.auroc([case("strong", None, OUTSIDER), case("none", RIGHT)]) == 0


def test_probability_and_brier_score_of_the_truth() -> None:
    assert metrics.truth_probability(case("single", RIGHT, CLEARANCE)) == pytest.approx(0.8)
    assert metrics.brier(case("single", RIGHT, CLEARANCE)) == pytest.approx(0.2**2 + 0.1**2 + 0.1**2)
    assert metrics.truth_probability(case("mild", answer({"unknown": 0.7, "none": 0.3}), OUTSIDER)) == 0.7


def test_calibration_error_is_the_distance_between_said_and_found() -> None:
    ten = [case("single", RIGHT, CLEARANCE)] * 8 + [case("single", RIGHT, DAMPING)] * 2
    # 0.8 is said of all: of ten, each is a bin of its own; of a hundred, each bin holds eight in ten.
    assert metrics.calibration_error(ten) == pytest.approx((8 * 0.2 + 2 * 0.8) / 10)
    assert metrics.calibration_error(ten * 10) == pytest.approx(0)


def test_bins_of_calibration_have_equal_numbers() -> None:
    sure = answer({"clearance": 1.0})
    unsure = answer({"clearance": 0.6, "none": 0.4})
    cases = [case("single", sure, CLEARANCE)] * 50
    cases += [case("single", unsure, CLEARANCE), case("single", unsure, DAMPING)] * 25
    # Half of what is given 0.6 is right (bins of 10), all of what is given 1.
    assert metrics.calibration_error(cases) == pytest.approx(0.05)


def test_a_failed_diagnosis_was_sure_and_wrong_for_the_calibration_too() -> None:
    found = [case("single", RIGHT, CLEARANCE)] * 8 + [case("single", RIGHT, DAMPING)] * 2
    failed = [case("none", None)] * 100
    assert metrics.calibration_error(failed) == 1
    # of 200, 100 are off by 1, the others as often right as they say
    assert metrics.calibration_error([*found * 10, *failed]) == pytest.approx(0.5)
    # nobody who is calibrated is sure and wrong: of 200, 100 add nothing to what small bins make
    alone, both = metrics.calibrated_error(found * 10), metrics.calibrated_error([*found * 10, *failed])
    assert both < alone


def test_small_bins_make_an_error_even_of_the_perfectly_calibrated() -> None:
    cases = [case("single", RIGHT, CLEARANCE)] * 120
    # Twelve in a bin: a binomial share lies 0.0945 from 0.8 on average; 300 plays know it to 2 %.
    assert metrics.calibrated_error(cases) == pytest.approx(0.0945, rel=0.05)


def test_none_is_right_too_where_the_runs_cannot_show_the_effect() -> None:
    assert metrics.confidence(case("single", SAYS_NONE, CLEARANCE, gaps=Gaps(1.0, 1.0))) == (0.6, 1.0)
    assert metrics.confidence(case("single", SAYS_NONE, CLEARANCE, gaps=Gaps(5.0, 1.0))) == (0.6, 0.0)


def test_an_alarm_needs_more_than_a_half() -> None:
    assert metrics.false_alarm(case("none", RIGHT)) == 1
    assert metrics.false_alarm(case("none", SAYS_NONE)) == 0
    mostly = answer({"clearance": 0.4, "none": 0.35, "unknown": 0.25})
    assert metrics.false_alarm(case("none", mostly)) == 0
    assert metrics.not_none(case("none", mostly)) == 1
    split = answer({"clearance": 0.3, "shaker_mass": 0.3, "none": 0.4})
    assert metrics.false_alarm(case("none", split)) == 1


def test_location_of_the_first_answer_is_what_counts() -> None:
    assert metrics.location_right(case("single", WRONG, CLEARANCE)) == 1  # both at the contact joint
    assert metrics.location_right(case("single", WRONG, GAIN)) == 0


def test_where_something_unknown_sits_is_right_told_wrong_or_not_told() -> None:
    hidden = case("strong", RIGHT, OUTSIDER)
    hidden = replace(hidden, campaign=replace(hidden.campaign, places=("sensor", "clock")))
    for place, right, told in (("clock", 1, 1), ("drive", 0, 1), ("not known", 0, 0)):
        said = replace(hidden, answer=replace(RIGHT, place=place))
        assert (metrics.place_right(said), metrics.place_told(said)) == (right, told)
    assert metrics.place_right(BASELINES["oracle"]([hidden])[0]) == 1


def test_the_place_of_an_answer_is_where_most_of_the_gap_comes_from() -> None:
    diagnosis = {
        "verdict_probability": {"none": 0.1, "unknown": 0.9},
        "effects": [],
        "selected": [],
        "gap": {"by_location": {"drive": 0.3, "not known": 0.7}, "after": 2.5},
    }
    said = answer_of(diagnosis)
    assert (said.place, said.left) == ("not known", 2.5)


def test_several_are_judged_like_pairs() -> None:
    two = answer({"clearance": 1.0}, selected=("clearance", "contact_damping"))
    assert metrics.selected_f1([case("triple", two, CLEARANCE, DAMPING, GAIN)]) == pytest.approx(4 / 5)


def test_error_and_coverage_of_the_main_parameter() -> None:
    said = answer({"clearance": 0.9, "none": 0.1}, parameters={"scale": Estimate(1.65, (1.4, 1.7))})
    hidden = case("single", said, CLEARANCE)
    assert metrics.parameter_error(hidden) == pytest.approx(0.1)
    assert metrics.parameter_covered(hidden) == 1
    assert metrics.channel_right(hidden) is None
    named_wrongly = case("single", WRONG, CLEARANCE)
    assert metrics.parameter_error(named_wrongly) == math.inf
    assert metrics.parameter_covered(named_wrongly) == 0


def test_the_wrong_channel_makes_the_parameter_wrong() -> None:
    parameters = {"channel": Estimate("drive.force"), "gain": Estimate(1.2, (1.1, 1.3))}
    hidden = case("single", answer({"sensor_gain": 1.0}, parameters=parameters), GAIN)
    assert metrics.channel_right(hidden) == 0
    assert metrics.parameter_error(hidden) == math.inf
    assert metrics.parameter_covered(hidden) == 0


def test_the_larger_harmonic_is_the_main_one() -> None:
    distortion = {"name": "drive_distortion", "parameters": {"second": 0.02, "third": 0.1}}
    parameters = {"second": Estimate(0.04), "third": Estimate(0.09, (0.08, 0.11))}
    hidden = case("single", answer({"drive_distortion": 1.0}, parameters=parameters), dict(distortion))
    assert metrics.parameter_error(hidden) == pytest.approx(0.1)


def test_f1_counts_over_all_pairs_together() -> None:
    both = answer({"clearance": 1.0}, selected=("clearance", "contact_damping"))
    one = answer({"clearance": 1.0}, selected=("clearance", "shaker_mass", "structural_damping"))
    none = answer({"none": 1.0})
    cases = [case("pair", said, CLEARANCE, DAMPING) for said in (both, one, none)]
    assert metrics.selected_f1(cases) == pytest.approx(2 * 3 / (5 + 6))
    assert [metrics.exact_set(each) for each in cases] == [1, 0, 0]


def test_auroc_is_the_share_of_pairs_in_the_right_order() -> None:
    outside = [case("strong", answer({"unknown": p, "none": 1 - p}), OUTSIDER) for p in (0.9, 0.3)]
    others = [case("none", answer({"unknown": p, "none": 1 - p})) for p in (0.1, 0.3, 0.5)]
    # 0.9 is above all three; 0.3 above one, level with one.
    assert metrics.auroc([*outside, *others]) == pytest.approx((3 + 1 + 0.5) / 6)


def test_shrink_is_what_the_interface_says() -> None:
    assert shrink(7.4, 1.0) == 1
    assert shrink(7.4, 0.8) == 1
    assert shrink(7.0, 4.0) == pytest.approx(0.5)
    assert shrink(0.9, 0.8) == 0


def test_relative_shrink_is_bounded_and_zero_without_an_answer() -> None:
    assert Gaps(6.0, 2.0, 4.0).relative_shrink == pytest.approx(0.5)
    assert Gaps(6.0, 2.0, 1.0).relative_shrink == 1
    assert Gaps(6.0, 2.0, 60.0).relative_shrink == -1
    assert Gaps(6.0, 2.0).relative_shrink == 0


def test_settings_show_an_effect_where_there_is_a_gap_that_it_closes() -> None:
    assert Gaps(2.0, 1.0).visible
    assert not Gaps(1.05, 1.0).visible
    assert not Gaps(2.0, 1.95).visible


def test_settings_show_something_unknown_where_there_is_a_gap() -> None:
    # no twin has it: the true effects close nothing
    assert case("mild", SAYS_NONE, OUTSIDER, gaps=Gaps(1.3, 1.3)).visible
    hidden = case("mild", SAYS_NONE, OUTSIDER, gaps=Gaps(1.0, 1.0))
    assert not hidden.visible
    assert metrics.confidence(hidden) == (0.6, 1.0)


def test_wilson_interval_of_a_published_example() -> None:
    # Newcombe 1998 (10.1002/(SICI)1097-0258(19980430)17:8<857), table I, method 3: 81 of 263, 0 of 20.
    assert wilson(81, 263) == pytest.approx((0.2553, 0.3662), abs=5e-5)
    assert wilson(0, 20) == pytest.approx((0.0, 0.1611), abs=5e-5)


def test_bootstrap_interval_of_a_mean_is_that_of_the_normal_law() -> None:
    values = list(np.random.default_rng(3).standard_normal(400))
    low, high = bootstrap(lambda chosen: float(np.mean(chosen)), values)
    # 1.96 / sqrt(400) each side; 1 000 resamples know an end to 6 %, the sample its deviation to 4 %.
    assert (high - low) / 2 == pytest.approx(0.098, rel=0.15)
    assert bootstrap(lambda chosen: float(np.mean(chosen)), values) == (low, high)


def test_the_oracle_is_right_and_chance_is_chance() -> None:
    gaps = Gaps(5.0, 1.0, 3.0)
    cases = [
        case("single", WRONG, CLEARANCE, gaps=gaps),
        case("none", RIGHT),
        case("strong", RIGHT, OUTSIDER),
    ]
    oracle = BASELINES["oracle"](cases)
    assert [metrics.first_right(each) for each in oracle] == [1, 1, 1]
    assert metrics.relative_shrink(oracle[0]) == 1
    assert metrics.parameter_error(oracle[0]) == 0
    assert metrics.auroc(oracle) == 1
    chance = BASELINES["random"](cases)
    assert len(chance) == 3 * REPEATS
    # One of 17 answers; 300 plays know the share to a standard error of 0.014.
    assert np.mean([metrics.first_right(each) for each in chance]) == pytest.approx(1 / 17, abs=0.045)


def test_majority_gives_the_shares_of_the_truths() -> None:
    cases = [
        case("none", WRONG),
        case("none", WRONG),
        case("single", WRONG, CLEARANCE),
        case("single", WRONG, GAIN),
    ]
    played = BASELINES["majority"](cases)
    assert [metrics.truth_probability(each) for each in played] == [0.5, 0.5, 0.25, 0.25]
    assert [metrics.first_right(each) for each in played] == [1, 1, 0, 0]


def test_best_residual_takes_the_largest_shrink_or_none() -> None:
    said = answer({"clearance": 1.0}, shrinks={"clearance": 0.5, "contact_damping": 0.6})
    low = answer({"clearance": 1.0}, shrinks={"clearance": 0.05})
    first, second = BASELINES["best residual"]([case("single", said, DAMPING), case("none", low)])
    assert metrics.first_right(first) == metrics.first_right(second) == 1
    wired = Ranked("sensor_factor", "sensor", 0.0, 0.9)
    (third,) = BASELINES["best residual"](
        [case("single", replace(said, effects=(*said.effects, wired)), DAMPING)]
    )
    assert metrics.first_right(third) == 1


def test_a_diagnosis_whose_probabilities_do_not_add_up_is_refused() -> None:
    effects = [{"name": "clearance", "location": "contact joint", "probability": 0.5}]
    diagnosis = {"verdict_probability": {"none": 0.4, "unknown": 0.3}, "effects": effects, "selected": []}
    with pytest.raises(ValueError, match=r"add up to 1\.2"):
        answer_of(diagnosis)


def test_bars_say_what_they_ask() -> None:
    assert [str(bar) for bar in (Bar(low=0.85), Bar(high=0.05), Bar(0.85, 0.99))] == [
        ">= 0.85",
        "<= 0.05",
        "0.85 to 0.99",
    ]
    assert Bar(0.85, 0.99).met(0.9)
    assert not Bar(0.85, 0.99).met(1.0)
