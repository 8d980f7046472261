"""What one run leaves behind: a sound log of every channel measured and predicted, a report, a path."""

from __future__ import annotations

import datetime
import tomllib
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from mcap.records import Chunk
from mcap.stream_reader import StreamReader

from daq.block import NS_PER_S, SampleBlock, sample_time_ns
from daq.log.reader import LogReader, Origin
from daq.log.recover import verify_log
from rig.report.record import read_run
from rig.report.summary import half_cycle_statistics
from rig.session.progress import FIRST_START
from tests.end_to_end.command import Ended
from tests.end_to_end.files import CHANNELS

ORIGINS: tuple[Origin, Origin] = ("measured", "predicted")
SAMPLES = round(6.0 * 51_200)


def blocks_of(log: LogReader) -> dict[tuple[Origin, str], list[SampleBlock]]:
    found: dict[tuple[Origin, str], list[SampleBlock]] = {}
    for origin, block in log.blocks(ORIGINS):
        found.setdefault((origin, block.channel), []).append(block)
    return found


def test_last_line_names_the_log_and_the_report_lies_beside_it(settled_run: Ended) -> None:
    assert settled_run.out.rstrip().splitlines()[-1].startswith("log ")
    assert settled_run.log.is_file()
    assert settled_run.log.with_suffix(".html").stat().st_size > 100_000


def test_how_long_a_first_start_takes_is_told_once_and_where_it_takes_so_long(settled_run: Ended) -> None:
    (told,) = (line for line in settled_run.out.splitlines() if FIRST_START in line)
    assert told.startswith("starting the emulated instruments")


def test_log_is_sound_and_its_ledger_empty(settled_log: Path) -> None:
    report = verify_log(settled_log)
    assert report.sound
    assert report.ledger_missing == 0
    assert all(topic.sequence_breaks == 0 for topic in report.topics)


def test_every_channel_is_measured_and_predicted_gap_free_over_the_same_samples(settled_log: Path) -> None:
    with LogReader(settled_log) as log:
        assert {origin: tuple(log.channels(origin)) for origin in ORIGINS} == dict.fromkeys(ORIGINS, CHANNELS)
        found = blocks_of(log)
    assert set(found) == {(origin, name) for origin in ORIGINS for name in CHANNELS}
    for blocks in found.values():
        assert blocks[0].first_sample == 0
        assert all(before.end_sample == after.first_sample for before, after in pairwise(blocks))
        assert blocks[-1].end_sample == SAMPLES
        assert all(np.isfinite(block.values).all() for block in blocks)


def test_all_timestamps_lie_on_one_base(settled_log: Path) -> None:
    with LogReader(settled_log) as log:
        blocks = [block for _, block in log.blocks(ORIGINS)]
        published = {message.publish_ns for message in log.messages({"/measured/drive.force"})}
    start_ns = {block.time_ns for block in blocks if block.first_sample == 0}
    assert len(start_ns) == 1
    (base_ns,) = start_ns
    # Samples are dated from the start of the card's task: a nanosecond of rounding on either side.
    assert all(
        abs(block.time_ns - sample_time_ns(base_ns, block.first_sample, block.sample_rate)) <= 1
        for block in blocks
    )
    assert published == {block.time_ns for block in blocks if block.channel == "drive.force"} & published


def test_the_host_has_a_block_after_its_last_sample(settled_log: Path) -> None:
    with LogReader(settled_log) as log:
        for message in log.messages({"/measured/drive.force"}):
            assert message.log_ns > message.publish_ns


def test_chunks_are_zstd_and_at_most_a_quarter_of_a_second_long(settled_log: Path) -> None:
    with settled_log.open("rb") as file:
        chunks = [r for r in StreamReader(file, emit_chunks=True).records if isinstance(r, Chunk)]
    assert {chunk.compression for chunk in chunks} == {"zstd"}
    longest = max(chunk.message_end_time - chunk.message_start_time for chunk in chunks)
    assert longest <= 0.25 * NS_PER_S


def test_metadata_says_what_ran_where_and_when(settled_log: Path) -> None:
    with LogReader(settled_log) as log:
        metadata, library = log.metadata, log.library
        units = {name: channel.unit for name, channel in log.channels("measured").items()}
        start_ns = log.series("measured", "drive.force", end_s=0.1).time_ns
    assert library.startswith("rattle")
    assert tomllib.loads(metadata["scenario"]["toml"])["drive"] == {"frequency": "20 Hz", "amplitude": "9 N"}
    run = metadata["run"]
    assert run["id"] == settled_log.stem
    started = datetime.datetime.fromisoformat(run["started"])
    assert started.utcoffset() == datetime.timedelta(0)
    # Named when its log is made; the record begins after starting the card and settling, within the run.
    assert 0 < start_ns / NS_PER_S - started.timestamp() < 60
    assert run["actuator"].startswith("Agilent Technologies,33220A")
    assert int(run["emulation_seed"]) >= 0
    assert units == dict(zip(CHANNELS, ("N", "N", "N", "N", "m/s2"), strict=True))


def test_events_tell_the_course_of_the_run(settled_log: Path) -> None:
    with LogReader(settled_log) as log:
        codes = [event.code for event in sorted(log.events(), key=lambda event: event.time_ns)]
        clocks = log.clocks()
    story = [code for code in codes if code in {"drive.on", "record.start", "record.end", "drive.off"}]
    assert story == ["drive.on", "record.start", "record.end", "drive.off"]
    assert "twin.aligned" in codes
    assert {clock.device for clock in clocks} == {"host"}
    # The emulated card goes by the same clock, and the run lasts eight seconds; crystals are off by 50 ppm.
    assert abs(clocks[-1].offset_s) <= 2 * clocks[-1].uncertainty_s < 0.5


def test_settled_peaks_agree_within_sampling_error(settled_log: Path) -> None:
    run = read_run(settled_log)
    measured, predicted = (half_cycle_statistics(run, origin) for origin in ("measured", "predicted"))
    assert measured is not None
    assert predicted is not None
    # 6 s at 20 Hz are 240 half cycles; the cut ones at both ends may count as one more each.
    assert 238 <= measured.count <= 243
    assert 238 <= predicted.count <= 243
    for mean, sd in (("first_mean_n", "first_sd_n"), ("max_mean_n", "max_sd_n")):
        error = np.hypot(*(getattr(peaks, sd) / np.sqrt(peaks.count) for peaks in (measured, predicted)))
        # Neighbouring half cycles are correlated (their means scatter twice as much as those of independent
        # ones), and a healthy rig may itself be off by 3 % (drive amplitude, clearance, gain). Beyond three
        # deviations one sound rig in 200 lies by chance, beyond four 1 in 8,000; four of 6 s are 2.3 of 2 s.
        allowed = 4 * 2 * error + 0.03 * getattr(predicted, mean)
        assert getattr(measured, mean) == pytest.approx(getattr(predicted, mean), abs=allowed)


def test_emulated_rig_never_gives_the_twins_own_numbers(settled_log: Path) -> None:
    with LogReader(settled_log) as log:
        measured, predicted = log.table("measured"), log.table("predicted")
    for name in CHANNELS:
        # Equal values come by chance alone, where a force is near zero and quantised: of the base, which is
        # predicted to stand, one in 1300 by the card's steps and its noise.
        by_chance = 2e-3 if name == "base.acceleration" else 1e-3
        assert np.mean(measured[name].values == predicted[name].values) < by_chance, name
