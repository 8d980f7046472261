"""The log of a centring: all that the card gave, each offset with what it touched, and what was found."""

from __future__ import annotations

import dataclasses
import json
from contextlib import ExitStack, suppress
from pathlib import Path
from types import TracebackType
from typing import Final

from daq.clock import Clock
from daq.errors import RattleError, RecorderFailed
from daq.log.records import Event
from daq.log.writer import LogWriter
from daq.recorder import Recorder
from rig.files.bench import Bench
from rig.files.scenario import Scenario
from rig.session.centring.probe import CentringPlan, Probe
from rig.session.centring.search import Middle
from rig.session.devices import Devices
from rig.session.provenance import new_run, run_record

RECORD: Final = "centring"
"""The metadata record with the offsets and the result, each JSON."""


class CentringRecord:
    """Writes a log of one centring into `folder`, for as long as its context lasts; `path` then names it.

    What is raised within stands in it as an event.
    """

    def __init__(
        self,
        folder: Path,
        scenario: Scenario,
        bench: Bench,
        devices: Devices,
        notes: dict[str, str],
        clock: Clock,
    ) -> None:
        run = new_run(folder, f"{scenario.name} centring", clock)
        self.path, self._clock = run.log, clock
        self.recorder = Recorder(LogWriter(run.log), clock)
        self._scenario = scenario
        self._run = run_record(bench, devices, notes, run.id, clock)
        self._channels = devices.card.channels
        self._probes: list[dict[str, object]] = []

    def __enter__(self) -> CentringRecord:
        with ExitStack() as opening:
            opening.enter_context(self.recorder)
            self.recorder.metadata("scenario", {"toml": self._scenario.text})
            self.recorder.metadata("run", self._run)
            for channel in self._channels:
                self.recorder.declare("measured", channel)
            self._closing = opening.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if error is not None:
                self._ended(error)
        finally:
            self._closing.close()

    def note(self, probe: Probe, first_sample: int, end_sample: int) -> None:
        """Note an offset; what it touched was read from these samples of the record."""
        where = {"first_sample": first_sample, "end_sample": end_sample}
        self._probes.append(dataclasses.asdict(probe) | where)
        self._tell("info", "centring.offset", f"{probe}, by samples {first_sample} to {end_sample}")

    def found(self, middle: Middle, plan: CentringPlan) -> None:
        """Note the result."""
        result = dataclasses.asdict(middle) | {
            "rest_offset_m": plan.rest_offset(middle),
            "sine_hz": plan.frequency,
        }
        self.recorder.metadata(RECORD, {"offsets": json.dumps(self._probes), "result": json.dumps(result)})
        text = f"the middle is at {middle.offset:+.4f} N +- {middle.uncertainty:.4f} N"
        self._tell("info", "centring.found", text)

    def _ended(self, error: BaseException) -> None:
        text = str(error) or "interrupted"
        if not isinstance(error, RattleError | KeyboardInterrupt):
            text = f"{type(error).__name__}: {error}"
        with suppress(RecorderFailed):  # what ended the search is raised, not that the log takes no more
            self._tell("error", "centring.ended", text)
            self.recorder.metadata(RECORD, {"offsets": json.dumps(self._probes)})

    def _tell(self, level: str, code: str, text: str) -> None:
        self.recorder.event(Event(self._clock.unix_ns(), level, "rig", code, text))
