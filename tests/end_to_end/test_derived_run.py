"""What the run of the emulated bench logs as derived, its replay derives again."""

from __future__ import annotations

import signal
from pathlib import Path

import numpy as np
import pytest

from daq.log.reader import LogReader
from rig.derived.settings import RECORD
from tests.end_to_end.command import await_true, command
from tests.end_to_end.files import CHANNELS, write_scenario
from tests.rig.derived.test_live_and_replay import logged, replayed


@pytest.mark.long
def test_replay_of_a_run_derives_what_it_logged_to_the_bit(settled_log: Path) -> None:
    found = logged(settled_log)
    # 6 s at 20 Hz: an event in each half cycle and more on the yoke; 119 or 120 whole cycles.
    assert len(found) > 450
    assert replayed(settled_log) == found


def test_derived_channels_follow_from_the_samples_of_the_log(settled_log: Path) -> None:
    with LogReader(settled_log) as log:
        names = list(log.channels("derived"))
        force = log.series("measured", "contact.force_upper").values.astype(float)
        peaks = log.series("derived", "contact.force_upper.cycle_peak")
        impacts = [i for i in log.impacts() if (i.origin, i.channel) == ("measured", "contact.force_upper")]
        assert set(log.metadata[RECORD]) == {"rule", "measured", "predicted"}
    assert len(names) == 2 * 2 * len(CHANNELS)
    # A healthy rig's drive is within 0.1 % (five deviations) of the scenario's frequency.
    assert peaks.sample_rate == pytest.approx(20.0, rel=1e-3)
    assert len(peaks) in (119, 120)
    assert np.max(peaks.values) <= np.max(force)
    assert max(impact.peak for impact in impacts) == np.max(force)
    for impact in impacts:
        part = force[impact.first_sample : impact.end_sample]
        assert part.max() == impact.peak
        # Quick contacts are most of an event; what presses slowly between them, noise and ripple stay out.
        assert 0.85 < impact.impulse / (part.sum() / 51_200) < 1.05
        assert 0 < impact.contact_s <= len(part) / 51_200


def test_the_two_sides_are_hit_half_a_cycle_apart(settled_log: Path) -> None:
    with LogReader(settled_log) as log:
        found = [impact for impact in log.impacts() if impact.origin == "measured"]
    mean = {
        side: np.mean([np.exp(2j * np.pi * each.turns) for each in found if each.channel.endswith(side)])
        for side in ("upper", "lower")
    }
    # The rig is symmetric; its impacts scatter by under a tenth of a cycle, and there are 120 of each.
    assert np.angle(-mean["upper"] / mean["lower"]) / (2 * np.pi) == pytest.approx(0.0, abs=0.05)
    assert min(map(abs, mean.values())) > 0.5


@pytest.mark.long
def test_a_run_that_is_stopped_has_all_that_follows_from_what_it_recorded(tmp_path: Path) -> None:
    scenario = write_scenario(tmp_path / "scenario.toml", settle_s=1.0, duration_s=30.0)
    with command("run", scenario, "--out", tmp_path) as run:
        run.await_line("recording")
        (path,) = tmp_path.glob("*.mcap")
        await_true("two seconds in the log", lambda: path.stat().st_size > 2_500_000)
        run.signal(signal.SIGINT)
        assert run.end().code == 130
    found = logged(path)
    assert len(found) > 50
    assert replayed(path) == found
