"""Centring believes no sensor that is open or overloaded: it would look as if no stop were touched."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
import pytest

from daq.block import Flag
from daq.channel import Channel
from daq.clock import SystemClock
from daq.time_base.run_clock import RunClock
from rig.files.bench import embedded_bench
from rig.files.scenario import parse_scenario
from rig.session.centring import NoCentre, plan_of
from rig.session.centring_run import FORCES, RigBeam
from rig.session.devices import Devices
from rig.session.drive import Shaker
from rig.session.driven_rig import DrivenRig
from rig.session.signals import StopRequest
from rig.stream import Consumer
from tests.rig.session.fakes import Kept, RecordingGenerator, SteppedCard, silent_screen

SCENARIO = """\
name = "centred"
rig = "impact_beam"
[model]
shaker_stiffness = "3 kN/m"
[drive]
frequency = "20 Hz"
[acquisition]
sample_rate = "51.2 kHz"
settle = "1 s"
duration = "1 s"
"""


@contextmanager
def coming(card: SteppedCard) -> Iterator[None]:
    """Let blocks come for as long as the context lasts."""
    done = threading.Event()

    def let() -> None:
        while not done.wait(0.002):
            card.let()

    thread = threading.Thread(target=let)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()


@contextmanager
def rig_to_centre(
    folder: Path, card: SteppedCard, *consumers: Consumer
) -> Iterator[tuple[DrivenRig, RigBeam]]:
    """A beam that is about to be centred, with its log open; nobody supervises it."""
    generator, scenario = RecordingGenerator(), parse_scenario(SCENARIO, "centred")
    devices = Devices(
        generator, RecordingGenerator, lambda wait, _: Shaker(generator, scenario.drive, 3.6, wait), card
    )
    bench = embedded_bench()
    rig = DrivenRig(bench, devices, StopRequest(), silent_screen(), RunClock(SystemClock()))
    with ExitStack() as stack:
        beam = RigBeam(rig, scenario, plan_of(scenario, bench))
        rig.open_log(stack, folder, scenario.name)
        rig.stream += consumers
        rig.record((), None, [beam.take])
        rig.declare("centred", scenario.text, {})
        rig.watch.checks[:] = [rig.acquisition.check]
        yield rig, beam


def test_a_sensor_that_shows_nothing_ends_the_search(tmp_path: Path) -> None:
    shown, kept = [Flag.GOOD], Kept()
    card = SteppedCard(tuple(Channel(name, "N") for name in FORCES), flags=lambda block: shown[0])
    with rig_to_centre(tmp_path, card, kept) as (rig, beam), coming(card), rig.acquisition:
        began = rig.start_record(10**9)
        upper, lower = beam.forces(0.2)
        assert len(upper) == len(lower) == round(0.2 * card.sample_rate)
        # row 0 holds the card's sample numbers; what was judged can be found in the record again
        first, end = (each - began for each in beam.listened)
        recorded = np.concatenate([block.values for block in kept.blocks(FORCES[0])])
        assert recorded[first:end] == pytest.approx(upper[: len(recorded) - first])  # the last may be held
        for shown[0] in (Flag.OPEN_SENSOR, Flag.OVERLOAD, Flag.NOT_FINITE):
            with pytest.raises(NoCentre, match="overloaded, open or not finite"):
                beam.forces(0.2)
