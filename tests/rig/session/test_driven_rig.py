"""The way to rest that every recording of a moving rig takes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from daq.channel import Channel
from daq.clock import SystemClock
from daq.errors import InstrumentRefused, RecorderFailed
from daq.log.records import Event
from daq.time_base.run_clock import RunClock
from rig.files.bench import embedded_bench
from rig.files.scenario import parse_scenario
from rig.session.devices import Devices
from rig.session.drive import Shaker
from rig.session.driven_rig import DrivenRig
from rig.session.signals import StopRequest
from rig.stream import Record
from rig.twin.scenario_twin import twin_of
from sim_twin.rigs.impact_beam.model import SineDrive
from tests.rig.session.fakes import Kept, RecordingGenerator, SteppedCard, silent_screen

SCENARIO = """\
rig = "impact_beam"
[drive]
frequency = "20 Hz"
amplitude = "9 N"
[acquisition]
sample_rate = "51.2 kHz"
duration = "1 s"
"""


class FullLog(Kept):
    """Takes nothing more."""

    def __call__(self, record: Record) -> None:
        if isinstance(record, Event):
            raise RecorderFailed("disk full")


@contextmanager
def recorded(folder: Path, generator: RecordingGenerator, kept: Kept) -> Iterator[DrivenRig]:
    """A beam that is about to be recorded into `kept`."""
    scenario = parse_scenario(SCENARIO, "stopped")
    devices = Devices(
        generator,
        RecordingGenerator,
        lambda wait, _: Shaker(generator, scenario.drive, 3.6, wait),
        SteppedCard((Channel("drive.force", "N"),)),
    )
    clock = RunClock(SystemClock())
    rig = DrivenRig(embedded_bench(), devices, StopRequest(), silent_screen(), clock)
    with ExitStack() as stack:
        rig.open_log(stack, folder, scenario.name)
        rig.stream[:] = [kept]
        rig.record((), None)
        yield rig


def test_a_stop_before_its_time_is_told_to_whoever_follows_and_to_the_log(tmp_path: Path) -> None:
    generator, kept, heard = RecordingGenerator(), Kept(), list[str]()
    with recorded(tmp_path, generator, kept) as rig:
        rig.on_stopping = lambda: heard.append("stopping")
        rig.off()
    assert heard == ["stopping"]
    assert kept.codes() == ["drive.stopping"]
    assert generator.told[-1] == ("off",)


def test_what_was_seen_to_be_wrong_may_have_been_so_since_it_was_seen_to_be_right(tmp_path: Path) -> None:
    kept = Kept()
    with recorded(tmp_path, RecordingGenerator(), kept) as rig:
        error = InstrumentRefused("generator", "here", "OUTP is 0, which it was not told")
        error.right_s = rig.clock.monotonic_s() - 0.4
        try:
            raise error
        except InstrumentRefused:
            rig.off()
        (stopping,) = kept.events
        assert rig.clock.unix_ns() - stopping.time_ns == pytest.approx(0.4e9, abs=0.1e9)


def test_a_log_that_takes_nothing_more_keeps_no_drive_on(tmp_path: Path) -> None:
    generator = RecordingGenerator()
    with recorded(tmp_path, generator, FullLog()) as rig:
        rig.off()
    assert generator.told[-1] == ("off",)


def test_nothing_that_fails_on_the_way_keeps_the_drive_on(tmp_path: Path) -> None:
    generator = RecordingGenerator()
    with recorded(tmp_path, generator, Kept(fails_on=Event)) as rig, pytest.raises(ZeroDivisionError):
        rig.off()
    assert generator.told[-1] == ("off",)


def test_what_has_come_to_rest_in_time_is_not_told_of_again(tmp_path: Path) -> None:
    generator, kept = RecordingGenerator(), Kept()
    with recorded(tmp_path, generator, kept) as rig:
        rig.on_stopping = lambda: pytest.fail("it rests")
        rig.watch.checks.clear()  # nobody supervises here
        rig.ramp_down()
        rig.off()
    assert kept.codes() == ["drive.off"]


def test_a_push_is_forgotten_before_the_sine_is_held_again(tmp_path: Path) -> None:
    """On its way to another mean, a sensor with a corner shows what passes for a sine."""
    with recorded(tmp_path, RecordingGenerator(), Kept()) as rig:
        rig.hold_force("drive.force", 20.0, twin_of(parse_scenario(SCENARIO, "stopped")))
        assert isinstance(rig.motion, Shaker)
        assert rig._force is not None
        from_samples: list[float] = []
        rig._force.hold = lambda amplitude, sample: from_samples.append(sample)  # type: ignore[method-assign]
        with rig.acquisition:
            for offset in (0.0, 1.0, 1.0):
                rig.motion.hold(SineDrive(frequency=20.0, amplitude=9.0, offset=offset))
            rig.devices.card.let(2)  # type: ignore[attr-defined]
    first, pushed, later = (each / rig.sample_rate for each in from_samples)
    assert 1.9 < pushed - first < 2.5
    assert abs(later - first) < 0.5
