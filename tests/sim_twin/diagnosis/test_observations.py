"""What is observed of one motion: each set of sensors as if it were alone, at the cost of what differs."""

from __future__ import annotations

import numpy as np
import pytest

from rig.diagnosis.recordings import setting_of
from rig.files.scenario import parse_scenario
from rig.twin.scenario_twin import twin_of
from sim_twin.diagnosis.campaign import Campaign
from sim_twin.diagnosis.fingerprint import Columns
from sim_twin.diagnosis.subject import Draw, Named
from tests.rig.diagnosis.measured_log import BEAM, RATE

UPPER, DRIVE = "contact.force_upper", "drive.force"
GAIN: tuple[Named, ...] = (("sensor_gain", {"channel": UPPER, "gain": 1.3}),)
LATE: tuple[Named, ...] = (("time_skew", {"channel": DRIVE, "seconds": 1e-3}),)


def campaign() -> Campaign:
    twin = twin_of(parse_scenario(BEAM))
    return Campaign((setting_of(twin, twin.channels, RATE, 4),))


@pytest.fixture
def looked(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    names: list[str] = []
    look = Columns.look

    def counted(self: Columns, name: str, *rest: object) -> object:
        names.append(name)
        return look(self, name, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(Columns, "look", counted)
    return names


def test_observations_of_one_motion_are_those_of_as_many_and_look_at_what_differs(looked: list[str]) -> None:
    subject = campaign()
    channels = list(subject.runs[0].columns.channels)
    (together,) = subject.observe([Draw((), 5, (GAIN, (), LATE, GAIN + LATE))])
    # the drive tells the cycles: where it differs, everything does
    assert looked == [*channels, UPPER, *channels, *channels]
    for extra, found in zip((GAIN, (), LATE, GAIN + LATE), together, strict=True):
        ((alone,),) = subject.observe([Draw((), 5, (extra,))])
        assert alone is not None
        assert found is not None
        assert np.array_equal(alone, found)
    assert not np.array_equal(together[0], together[1])


def test_some_runs_of_a_draw_are_the_same_bits_as_with_all_others() -> None:
    run = campaign().runs[0]
    subject = Campaign((run, run))
    whole, first, second = subject.observe(
        [Draw((), 5, (GAIN, ())), Draw((), 5, (GAIN, ()), runs=(0,)), Draw((), 5, (GAIN, ()), runs=(1,))]
    )
    for together, one, other in zip(whole, first, second, strict=True):
        assert together is not None
        assert one is not None
        assert other is not None
        assert np.array_equal(together, np.concatenate([one, other], axis=1))
        assert not np.array_equal(one, other)
    part = subject.only((1,))
    for same in (part, part.only((0,))):
        ((found,),) = same.observe([Draw((), 5)])
        assert found is not None
        assert second[1] is not None
        assert np.array_equal(found, second[1])


def test_draws_of_one_and_of_two_blocks_are_observed_as_each_alone() -> None:
    subject, draws = campaign(), [Draw((), 5), Draw((), 6, blocks=2)]
    together = subject.observe(draws)
    for draw, (found,) in zip(draws, together, strict=True):
        ((alone,),) = subject.observe([draw])
        assert found is not None
        assert alone is not None
        assert len(found) == draw.blocks
        assert np.array_equal(found, alone)
