"""Sweeps whose runs are made up: each writes a log at once, or fails as it is told to."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

from daq.block import NS_PER_S
from daq.clock import Clock, SystemClock
from daq.errors import RattleError
from daq.log.records import Event
from daq.log.writer import LogWriter
from rig.files.bench import Bench, embedded_bench
from rig.files.model_file import ModelFile
from rig.files.sweep import Sweep, parse_sweep
from rig.live.view import LiveView
from rig.session.progress import Screen
from rig.session.run import RunRequest
from rig.stream import Block
from rig.sweep.execute import Centre, Sweeping, SweepRequest, begun
from rig.sweep.state import SweepState
from tests.rig.session.fakes import silent_screen
from tests.rig.synthetic_run import CHANNELS, START_NS, blocks

SCENARIO = """\
[scenario]
rig = "impact_beam"
[scenario.drive]
frequency = "20 Hz"
amplitude = "9 N"
[scenario.acquisition]
sample_rate = "51.2 kHz"
duration = "1 s"
"""
AXES = '"model.clearance" = ["0.1 mm", "0.2 mm"]\n"drive.frequency" = ["19 Hz", "20 Hz"]'


def parsed(axes: str = AXES, settings: str = "", scenario: str = SCENARIO, more: str = "") -> Sweep:
    text = f'[sweep]\nname = "tried"\n{settings}\n{scenario}\n[axes]\n{axes}\n{more}'
    return parse_sweep(text, "sweep.toml", Path())


class Runs:
    """Stands for `run_scenario`: notes each request, and ends as `ends` says of the point's folder."""

    def __init__(self, ends: dict[int, RattleError | str | Callable[[], None]] | None = None) -> None:
        self.asked: list[RunRequest] = []
        self._ends = ends or {}

    @property
    def points(self) -> list[int]:
        return [int(each.folder.name.removeprefix("point-")) for each in self.asked]

    def __call__(self, request: RunRequest, screen: Screen, clock: Clock) -> Path:
        self.asked.append(request)
        end = self._ends.pop(self.points[-1], None)
        if isinstance(end, Exception):
            raise end
        if callable(end):
            end()
        request.folder.mkdir(parents=True, exist_ok=True)
        log = request.folder / f"run-{len(list(request.folder.iterdir()))}.mcap"
        write(log, end if isinstance(end, str) else "drive.frequency", request)
        return log


def write(log: Path, code: str, request: RunRequest) -> None:
    """A tenth of a second of a beam, with the event that tells of its frequency."""
    with LogWriter(log) as writer:
        for channel in CHANNELS:
            writer.declare("measured", channel)
        writer.add_metadata("scenario", {"toml": request.scenario.text})
        writer.add_event(Event(START_NS + NS_PER_S, "info", "rig", code, "drive as it was"))
        for block in blocks(CHANNELS, "measured", 0.1):
            writer.add_block("measured", block, block.time_ns)
            for consume in filter(None, (*request.consumers, request.counted)):
                consume(Block("measured", block))


@dataclasses.dataclass
class Trial:
    """A sweep in a folder, called again and again as a person would."""

    folder: Path
    sweep: Sweep = dataclasses.field(default_factory=parsed)
    bench: Bench = dataclasses.field(default_factory=embedded_bench)
    screen: Screen = dataclasses.field(default_factory=silent_screen)
    centre: Centre | None = None
    view: LiveView | None = None
    model: ModelFile | None = None

    def call(
        self, runs: Runs, again: set[int] | None = None, rehearsal: bool = True, anew: bool = False
    ) -> SweepState:
        repeated = frozenset(again or ())
        request = SweepRequest(
            self.sweep, self.bench, never, self.folder, repeated, anew, rehearsal, self.model
        )
        self.folder.mkdir(exist_ok=True)
        state, clock = begun(request), SystemClock()
        return Sweeping(request, state, self.screen, clock, runs, self.centre, self.view).all()

    @property
    def said(self) -> str:
        return self.screen.console.export_text(clear=True)


def never(*_: object) -> object:
    raise AssertionError("nothing is to be connected here")
