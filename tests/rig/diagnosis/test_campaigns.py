"""Campaigns as labs record them: no run that others can stand in for has a campaign refused."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.block import SampleBlock, sample_time_ns
from daq.channel import Channel
from daq.errors import LogError
from daq.log.writer import LogWriter
from rig.diagnosis.recordings import RecordedCampaign, recorded, setting_of
from sim_twin.diagnosis.campaign import RunSetting
from sim_twin.diagnosis.fingerprint import Layout
from sim_twin.diagnosis.judging import halves
from sim_twin.sensors import Encoder
from tests.rig.diagnosis.measured_log import START_NS

Array = NDArray[np.float64]
RATE = 6_400.0
ACCELERATIONS = ("crank_frame.acceleration_y", "crank_frame.acceleration_x", "piston_frame.acceleration_y")


@dataclass(frozen=True, slots=True)
class CrankRun:
    """A run of a crank: what the scenario says, and what the motor and the instruments did.

    `slip` and `drift` are shares of the speed: by how much it is off, and what it gains over the run. `told`
    is what shows the angle. `slow` is the rate of one accelerometer.
    """

    rpm: float
    seconds: float
    slip: float = 0.0
    drift: float = 0.0
    told: str = "crank.angle"
    slow: float = RATE

    @property
    def whole_cycles(self) -> int:
        """Revolutions from the first dead centre in the record to the last, at the slowest."""
        return int(self.turns(np.array([self.seconds]))[0] - 1e-6 - self._begin) if self.seconds else 0

    _begin = 0.3

    def turns(self, times: Array) -> Array:
        hertz = self.rpm / 60 * (1 + self.slip)
        return np.asarray(-self._begin + hertz * (times + 0.5 * self.drift * times**2 / self.seconds))

    def write(self, path: Path) -> Path:
        """A log of it: the frame is knocked once a revolution, at a third of it."""
        rng = np.random.default_rng(round(1e3 * (self.rpm + self.seconds)))
        scenario = f"""
name = "crank"
rig = "planar_slider_crank"
[drive]
speed = "{self.rpm:g} rpm"
[acquisition]
sample_rate = "6.4 kHz"
settle = "0.5 s"
duration = "{self.seconds:g} s"
"""
        encoder = '{"mounting_rad": 0.7, "counts": 4096}'
        with LogWriter(path) as log:
            log.add_metadata("scenario", {"toml": scenario})
            log.add_metadata("run", {"chain.encoder.angle": encoder})
            channels: dict[str, tuple[str, float, Array]] = {}
            for k, name in enumerate(ACCELERATIONS):
                rate = self.slow if k == 0 else RATE
                channels[name] = "m/s2", rate, self.knocks(rate, rng)
            angle = 2 * np.pi * self.turns(self.times(RATE))
            if self.told == "crank.angle":
                channels["crank.angle"] = "rad", RATE, Encoder().shown(angle)
            if self.told == "crank.marker":
                channels["crank.marker"] = "V", RATE, np.where(np.mod(angle, 2 * np.pi) < 0.09, 5.0, 0.0)
            if self.told == "encoder.angle":
                own = 2 * np.pi * self.turns(self.times(1000.0))
                channels["encoder.angle"] = "rad", 1000.0, Encoder(zero=-0.7).sent(own)
            for name, (unit, _, _) in channels.items():
                log.declare("measured", Channel(name, unit))
            for name, (_, rate, values) in channels.items():
                time_ns = sample_time_ns(START_NS, 0, rate)
                kept = values if unit == "rad" or name.endswith("angle") else values.astype(np.float32)
                log.add_block("measured", SampleBlock(name, 0, time_ns, rate, kept), time_ns)
        return path

    def times(self, rate: float) -> Array:
        return np.arange(round(self.seconds * rate)) / rate

    def knocks(self, rate: float, rng: np.random.Generator) -> Array:
        turn = np.mod(self.turns(self.times(rate)) - 1 / 3, 1.0) * 60 / self.rpm
        values = np.exp(-turn / 0.01) * np.sin(2 * np.pi * 300 * turn)
        return np.asarray(20 * values + 0.05 * rng.standard_normal(len(values)))


def read(folder: Path, *runs: CrankRun) -> RecordedCampaign:
    folder.mkdir(exist_ok=True)
    return recorded([run.write(folder / f"run{k}.mcap") for k, run in enumerate(runs)])


def any_run(rng: np.random.Generator) -> CrankRun:
    """Slow, short, slipping, drifting, at two rates, without an encoder on the card: as likely as not."""

    def maybe(value: float, usual: float = 0.0) -> float:
        return value if rng.random() < 0.5 else usual

    rpm = round(float(rng.uniform(60, 250)))
    return CrankRun(
        rpm,
        round(float(rng.uniform(0.5, 11)) * 60 / rpm, 2),
        maybe(float(rng.uniform(-0.03, 0.03))),
        maybe(float(rng.uniform(-0.01, 0.01))),
        str(rng.choice(["crank.angle", "crank.marker", "encoder.angle"])),
        maybe(float(rng.choice([RATE / 2, 2 * RATE, 24_000.0])), RATE),
    )


def test_of_campaigns_with_three_whole_cycles_in_one_run_none_is_refused(tmp_path: Path) -> None:
    rng, refused, usable = np.random.default_rng(17), [], 0
    for number in range(24):
        runs = [any_run(rng) for _ in range(rng.integers(1, 4))]
        if max(run.whole_cycles for run in runs) < 3:
            continue
        usable += 1
        try:
            found = read(tmp_path / str(number), *runs)
        except LogError as error:
            refused.append(str(error))
            continue
        assert np.isfinite(found.measured).all()
        assert len(found.measured) > 1
    assert usable >= 15
    assert refused == []


def test_a_long_run_tells_more_than_a_short_one_and_no_cycle_is_on_both_sides(tmp_path: Path) -> None:
    found = read(tmp_path, CrankRun(100, 2.5), CrankRun(240, 12))
    short, long = found.campaign.runs
    assert (short.cycles, long.cycles) == (1, 8)
    parts = np.split(found.measured, [len(found.measured[0]) - _size(long)], axis=1)
    assert [len(np.unique(part, axis=0)) for part in parts] == [3, 5]
    assert found.told == pytest.approx((25 / 9, 5))
    for part in parts:
        fitted, judged = (np.unique(rows, axis=0) for rows in halves(part))
        assert not any((row == judged).all(axis=1).any() for row in fitted)


def _size(setting: RunSetting) -> int:
    return Layout(setting.columns.cells(0)).size


def test_what_is_weak_or_odd_in_a_run_is_said(tmp_path: Path) -> None:
    odd = CrankRun(180, 3, slip=-0.02, told="encoder.angle", slow=RATE / 4)
    found = read(tmp_path, odd, CrankRun(180, 0.5))
    assert found.remarks[0].startswith("run1.mcap is left out: too short: 1 sound cycles")
    for text in (
        "encoder.angle tells the cycles in place of crank.angle",
        "its mean speed is 2.00% below the scenario's; the twin runs as fast as the rig did",
        f"{ACCELERATIONS[0]} is not used: its rate is too far below that of the others",
    ):
        assert f"run0.mcap: {text}" in found.remarks


@pytest.mark.parametrize("told", ["crank.angle", "crank.marker", "encoder.angle"])
def test_cycles_are_cut_where_the_crank_stands_whatever_tells_it(tmp_path: Path, told: str) -> None:
    run = CrankRun(180, 6, slip=0.01, drift=0.02, told=told)
    found = read(tmp_path, run)
    starts = found.campaign.runs[0].cycles_in(found.records[0]).starts(len(found.sound[0]))
    at = run.turns(starts / RATE)
    # a hundredth of a turn; a drift of 2 % is 0.06 turns off a straight line, an encoder's zero 0.1
    assert np.abs(at - np.round(at)).max() < 0.01


@pytest.mark.parametrize(("told", "begins"), [("crank.angle", 0.0), ("crank.marker", 0.25)])
def test_parts_of_a_revolution_are_told_from_crank_angle_0_wherever_the_mark_is(
    tmp_path: Path, told: str, begins: float
) -> None:
    (run,) = read(tmp_path, CrankRun(180, 3, told=told)).campaign.runs
    twin = replace(run.twin, rig=replace(run.twin.rig, marker_angle=np.pi / 2))
    turned = setting_of(twin, run.columns.channels, RATE, 8, reference=told)
    phases = [cell.phase for cell in turned.columns.cells(0) if cell.what == "rms" and cell.phase]
    assert phases[0] == pytest.approx((begins, begins + 1 / 16))
    assert min(phases)[0] == 0.0
    assert max(phases)[1] == 1.0


def test_channels_at_two_rates_show_the_same_knocks(tmp_path: Path) -> None:
    plain = read(tmp_path / "plain", CrankRun(180, 3))
    other = read(tmp_path / "other", CrankRun(180, 3, slow=7_000.0))
    finer = read(tmp_path / "finer", CrankRun(180, 3, slow=2 * RATE))
    quiet = [each.campaign.runs[0].quiet[ACCELERATIONS[0]] for each in (plain, other, finer)]
    assert quiet == pytest.approx([1.0, np.sqrt(RATE / 7_000), np.sqrt(0.5)], rel=0.03)
    rows = [each.records[0][ACCELERATIONS[0]] for each in (plain, other, finer)]
    count = min(map(len, rows))
    for row in rows[1:]:
        # its own noise, 0.05 m/s2 in each; the knock has 20, and its beginning is a step
        assert np.sqrt(np.mean((row - rows[0][:count])[200 : count - 200] ** 2)) < 0.5
