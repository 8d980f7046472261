"""What a twin is told of the record that it follows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np
import pytest

from daq.block import Flag
from drivers.protocols.card import CardReading
from rig.session.acquisition import Acquisition
from rig.session.twin_feed import TwinFeed
from rig.twin.alignment import Alignment
from rig.twin.worker import Drive, RecordedSpan
from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.rigs.planar_slider_crank.model import PlanarSliderCrank
from sim_twin.twin import Twin

BLOCK, TURNS = 100, 163.0


@dataclass
class Recording:
    """What an acquisition says of its record."""

    record_from: int | None = None
    record_until: int | None = None
    record_start_ns: int = 7
    turned_off: dict[str, float] = field(default_factory=dict)


class Followed:
    """A feed whose worker writes down what it is given."""

    def __init__(self, names: Sequence[str] = ("crank.angle",)) -> None:
        self.given: list[Drive | RecordedSpan] = []
        self.events: list[tuple[str, str, str]] = []
        self.unseen: list[str] = []
        self.record = Recording()
        self.feed = TwinFeed(
            Twin(PlanarSliderCrank(), SpeedDrive(20.0)), names, 1000.0, 0.0, lambda _: None, self._note,
            self.unseen.append, "its sensor on",
        )  # fmt: skip
        cast(Any, self.feed).worker = self
        self._read = 0

    def _note(self, *event: str) -> None:
        self.events.append(cast(tuple[str, str, str], event))

    def give(self, item: Drive | RecordedSpan) -> None:
        self.given.append(item)

    def read(self) -> None:
        values = np.zeros((1, BLOCK))
        reading = CardReading(self._read, values, (Flag.GOOD,), 0.0)
        self._read += BLOCK
        self.feed.take(reading, cast(Acquisition, self.record))

    @property
    def told(self) -> list[tuple[int, bool, float]]:
        return [
            (each.end_sample, each.last, each.turned_off)
            for each in self.given
            if isinstance(each, RecordedSpan)
        ]


def test_a_record_that_begins_with_the_next_reading_is_not_told_of_yet() -> None:
    """Set while a reading is passed on, it has left out no turns so far; and it is aligned to only once."""
    run = Followed()
    run.record.record_from, run.record.record_until = BLOCK, 4 * BLOCK
    run.read()
    assert run.told == []
    run.record.turned_off["crank.angle"] = TURNS
    run.read()
    run.read()
    run.read()
    assert run.told == [(2 * BLOCK, False, TURNS), (3 * BLOCK, True, TURNS)]  # two readings are a block


def test_a_drive_that_stops_ends_the_record_that_is_followed_before_the_next_reading() -> None:
    run = Followed()
    run.record.record_from, run.record.record_until = 0, 10 * BLOCK
    for _ in range(3):
        run.read()
    run.feed.end()
    run.read()
    run.read()
    assert run.told == [(2 * BLOCK, False, 0.0), (3 * BLOCK, True, 0.0)]


@pytest.mark.parametrize("named", [True, False])
def test_a_drive_that_is_not_seen_is_looked_for_and_one_that_nobody_measures_is_said_to_be(
    named: bool,
) -> None:
    run = Followed(["crank.angle"] if named else ["frame.acceleration"])
    cast(Any, run.feed)._deliver(Alignment(3.0, 0.0, trusted=False))
    [told], [(level, code, noted)] = run.unseen, run.events
    assert (level, code) == ("warning", "drive.not_seen")
    if named:
        assert told == "crank.angle shows no drive: is its sensor on?"
    else:
        assert told == noted
        assert told.startswith("no channel is crank.angle or crank.marker, so nothing tells")
