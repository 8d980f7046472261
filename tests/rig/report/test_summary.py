import math
from pathlib import Path

import pytest

from daq.errors import LogError
from daq.log.writer import LogWriter
from rig.report.summary import summarise
from tests.rig.synthetic_run import CHANNELS, blocks, damaged, write_log


def test_the_numbers_of_a_run_are_those_it_was_made_of(tmp_path: Path) -> None:
    summary = summarise(write_log(tmp_path / "run.mcap"))
    assert (summary.run_id, summary.scenario) == ("run-7", "synthetic beam")
    assert summary.drive == "frequency 20 Hz, amplitude 9 N"
    assert summary.duration_s == pytest.approx(1.0)
    assert [channel.name for channel in summary.channels] == [channel.name for channel in CHANNELS]
    drive = summary.channels[0]
    assert drive.measured is not None
    assert drive.predicted is not None
    # A sine of amplitude A has the rms A / sqrt(2); noise of 0.02 N adds 5e-6 of it.
    assert drive.measured.rms == pytest.approx(8.0 / math.sqrt(2), rel=1e-4)
    assert drive.predicted.rms == pytest.approx(7.2 / math.sqrt(2), rel=1e-4)
    assert (summary.missing, summary.overloaded_blocks, summary.gaps) == (0, 0, ())


def test_half_cycles_are_counted_on_both_sides(tmp_path: Path) -> None:
    summary = summarise(write_log(tmp_path / "run.mcap"))
    assert summary.measured_peaks is not None
    assert summary.predicted_peaks is not None
    assert summary.measured_peaks.count == 40  # 20 cycles of two half cycles in a second
    # Peaks sit on samples: a half sine of 51 samples is within 0.1 % of its top, noise is 0.02 N.
    assert summary.measured_peaks.first_mean_n == pytest.approx(40.0, rel=2e-3)
    assert summary.measured_peaks.max_mean_n == pytest.approx(40.0, rel=2e-3)
    assert summary.predicted_peaks.first_mean_n == pytest.approx(36.0, rel=2e-3)
    assert summary.measured_peaks.first_sd_n < 0.1


def test_faults_in_the_data_are_counted_and_do_not_spoil_the_rest(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    drive = CHANNELS[:1]
    with LogWriter(path) as log:
        log.declare("measured", drive[0])
        for index, block in enumerate(blocks(drive, "measured", 1.0)):
            if index == 3:
                continue
            log.add_block("measured", damaged(block) if index == 5 else block, block.time_ns)
    summary = summarise(path)
    measured = summary.channels[0].measured
    assert measured is not None
    assert (measured.missing, measured.not_finite, measured.overloaded_blocks) == (5120, 100, 1)
    assert measured.rms == pytest.approx(8.0 / math.sqrt(2), rel=1e-2)
    assert summary.measured_peaks is None
    assert [gap.count for gap in summary.gaps] == [5120]


def test_a_log_without_a_sample_has_no_numbers(tmp_path: Path) -> None:
    summary = summarise(write_log(tmp_path / "run.mcap", seconds=0.0))
    assert summary.duration_s == 0.0
    assert summary.channels[0].measured is None


def test_what_is_no_log_is_refused(tmp_path: Path) -> None:
    (tmp_path / "run.mcap").write_bytes(b"no log at all")
    with pytest.raises(LogError, match="not a log"):
        summarise(tmp_path / "run.mcap")
