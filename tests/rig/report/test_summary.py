import math
from dataclasses import replace
from pathlib import Path

import pytest

from daq.errors import LogError
from daq.log.records import Event, Gap
from daq.log.recover import recover_log
from daq.log.writer import LogWriter
from rig.derived.settings import RECORD, STOPPED
from rig.pages.content import BigNumbers, Sentence, Table
from rig.report.record import Verdict, read_run
from rig.report.sections.summary import parts as summary_parts
from rig.report.summary import as_json, half_cycle_statistics
from rig.twin.logged import DWELLS
from tests.rig.synthetic_run import CHANNELS, PEAK_N, START_NS, blocks, damaged, write_log


def test_the_numbers_of_a_run_are_those_it_was_made_of(tmp_path: Path) -> None:
    run = read_run(write_log(tmp_path / "run.mcap"))
    assert (run.metadata["run"]["id"], run.facts.name) == ("run-7", "synthetic beam")
    assert run.facts.drive == "frequency 20 Hz, amplitude 9 N"
    assert run.duration_s == pytest.approx(1.0)
    assert list(run.channels) == [channel.name for channel in CHANNELS]
    measured, predicted = (run.tallies[origin, CHANNELS[0].name] for origin in ("measured", "predicted"))
    # A sine of amplitude A has the rms A / sqrt(2); noise of 0.02 N adds 5e-6 of it.
    assert measured.rms == pytest.approx(8.0 / math.sqrt(2), rel=1e-4)
    assert predicted.rms == pytest.approx(7.2 / math.sqrt(2), rel=1e-4)
    assert (run.missing, run.overloaded_blocks, run.gaps) == (0, 0, [])


def test_half_cycles_are_counted_on_both_sides(tmp_path: Path) -> None:
    run = read_run(write_log(tmp_path / "run.mcap"))
    measured, predicted = (half_cycle_statistics(run, origin) for origin in ("measured", "predicted"))
    assert measured is not None
    assert predicted is not None
    assert measured.count == 40  # 20 cycles of two half cycles in a second
    # Peaks sit on samples: a half sine of 51 samples is within 0.1 % of its top, noise is 0.02 N.
    assert measured.first_mean_n == pytest.approx(40.0, rel=2e-3)
    assert measured.max_mean_n == pytest.approx(40.0, rel=2e-3)
    assert predicted.first_mean_n == pytest.approx(36.0, rel=2e-3)
    assert measured.first_sd_n < 0.1


def test_a_prediction_is_counted_from_the_measured_level(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """40 N are measured: 15 % of them are 6 N, whatever the largest predicted force is."""
    counts = {}
    for peak in (5.0, 7.0):
        monkeypatch.setitem(PEAK_N, "predicted", peak)
        found = half_cycle_statistics(read_run(write_log(tmp_path / f"{peak}.mcap")), "predicted")
        counts[peak] = found.count if found else 0
    assert counts == {5.0: 0, 7.0: 40}


@pytest.mark.parametrize("stopped", [False, True])
def test_impacts_that_a_run_no_more_derived_are_found_when_it_is_read(stopped: bool, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with LogWriter(path) as log:
        for channel in CHANNELS:
            log.declare("measured", channel)
        log.add_metadata(RECORD, {})
        if stopped:
            log.add_event(Event(START_NS, "warning", "derived", STOPPED, "nothing more is derived"))
        for block in blocks(CHANNELS, "measured", 0.5):
            log.add_block("measured", block, block.time_ns)
    assert len(read_run(path).impacts) == (20 if stopped else 0)


def test_a_verdict_stands_in_what_another_program_reads(tmp_path: Path) -> None:
    run = read_run(write_log(tmp_path / "run.mcap"))
    assert as_json(run)["verdict"] is None
    judged = replace(run, verdict=Verdict(False, ("Not so.", "Most here.")))
    assert as_json(judged)["verdict"] == {"well": False, "sentences": ("Not so.", "Most here.")}


def test_faults_in_the_data_are_counted_and_do_not_spoil_the_rest(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    drive = CHANNELS[:1]
    with LogWriter(path) as log:
        log.declare("measured", drive[0])
        for index, block in enumerate(blocks(drive, "measured", 1.0)):
            if index == 3:
                continue
            log.add_block("measured", damaged(block) if index == 5 else block, block.time_ns)
    run = read_run(path)
    measured = run.tallies["measured", drive[0].name]
    assert (measured.missing, measured.samples - measured.finite, measured.overloaded_blocks) == (
        5120,
        100,
        1,
    )
    assert measured.rms == pytest.approx(8.0 / math.sqrt(2), rel=1e-2)
    assert half_cycle_statistics(run, "measured") is None
    assert [gap.count for gap in run.gaps] == [5120]


@pytest.mark.parametrize(("origin", "count"), [("measured", 1), ("", 1), ("predicted", 0)])
def test_a_gap_of_a_measured_channel_is_one_and_of_a_prediction_none(
    origin: str, count: int, tmp_path: Path
) -> None:
    """A log of before says not whose it is."""
    run = read_run(write_log(tmp_path / "run.mcap"))
    cut = replace(run, gaps=[Gap(0, CHANNELS[0].name, 10, 5, "stopped", origin)])
    assert cut.measured_gaps == count
    numbers = next(part for part in summary_parts(cut) if isinstance(part, BigNumbers))
    samples = next(each for each in numbers.numbers if each.label == "Samples")
    assert samples.text == ("cut short" if count else "complete")


def test_what_no_twin_predicts_is_named(tmp_path: Path) -> None:
    run = read_run(write_log(tmp_path / "run.mcap", 0.2))
    (table,) = (part for part in summary_parts(run) if isinstance(part, Table))
    assert "no twin predicts" not in table.caption
    free = ("yoke.force", "base.acceleration")
    twins = {key: each for key, each in run.tallies.items() if key[0] == "measured" or key[1] not in free}
    (table,) = (part for part in summary_parts(replace(run, tallies=twins)) if isinstance(part, Table))
    assert table.caption == "Channels; no twin predicts yoke.force and base.acceleration"
    alone = read_run(write_log(tmp_path / "alone.mcap", 0.2, origins=["measured"]))
    (table,) = (part for part in summary_parts(alone) if isinstance(part, Table))
    assert table.caption == "Channels"  # that there is no prediction at all is said above it


def test_a_log_without_a_sample_has_no_numbers(tmp_path: Path) -> None:
    run = read_run(write_log(tmp_path / "run.mcap", seconds=0.0))
    assert run.duration_s == 0.0
    assert run.measured == {}


def test_a_record_at_several_speeds_says_of_what_its_figures_are(tmp_path: Path) -> None:
    run = read_run(write_log(tmp_path / "run.mcap", bench={DWELLS: "40, 200 rpm, 3 s each"}))
    told = [part.text for part in summary_parts(run) if isinstance(part, Sentence)]
    assert any("several speeds (40, 200 rpm, 3 s each): figures are of all of it" in text for text in told)


def test_what_was_recovered_says_so(tmp_path: Path) -> None:
    path = write_log(tmp_path / "run.mcap")
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    recover_log(path, tmp_path / "recovered.mcap")
    told = [
        part.text
        for part in summary_parts(read_run(tmp_path / "recovered.mcap"))
        if isinstance(part, Sentence)
    ]
    assert any("a run whose log was damaged or cut: it ends in the middle" in text for text in told)


def test_what_is_no_log_is_refused(tmp_path: Path) -> None:
    (tmp_path / "run.mcap").write_bytes(b"no log at all")
    with pytest.raises(LogError, match="not a log"):
        read_run(tmp_path / "run.mcap")
