"""Centring believes no sensor that is open or overloaded: it would look as if no stop were touched."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from daq.block import Flag
from daq.channel import Channel
from daq.clock import SystemClock
from rig.files.scenario import parse_scenario
from rig.session.centring.rig import FORCES, _RigBeam
from rig.session.centring.search import NoCentre
from rig.session.devices import Devices
from rig.session.drive import Shaker
from rig.session.hub import Hub
from rig.session.signals import StopRequest
from tests.rig.session.fakes import ListSink, RecordingGenerator, SteppedCard

SCENARIO = """\
name = "centred"
rig = "impact_beam"
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


def test_a_sensor_that_shows_nothing_ends_the_search() -> None:
    generator, shown = RecordingGenerator(), [Flag.GOOD]
    card = SteppedCard(tuple(Channel(name, "N") for name in FORCES), flags=lambda block: shown[0])
    scenario = parse_scenario(SCENARIO, "centred")
    devices = Devices(
        generator, RecordingGenerator, lambda wait, _: Shaker(generator, scenario.drive, 3.6, wait), card
    )
    sink = ListSink()
    beam = _RigBeam(scenario, devices, StopRequest(), Hub([sink]), SystemClock())
    with coming(card), beam.acquiring():
        upper, lower = beam.forces(0.2)
        assert len(upper) == len(lower) == round(0.2 * card.sample_rate)
        # row 0 holds the card's sample numbers; what was judged can be found in the record again
        first, end = beam.listened
        recorded = np.concatenate([block.values for block in sink.blocks(FORCES[0])])
        assert recorded[first:end] == pytest.approx(upper)
        for shown[0] in (Flag.OPEN_SENSOR, Flag.OVERLOAD, Flag.NOT_FINITE):
            with pytest.raises(NoCentre, match="overloaded, open or not finite"):
                beam.forces(0.2)
