"""The log of a centring: each offset with what it touched, and what was found."""

from __future__ import annotations

import dataclasses
import json
from contextlib import suppress
from types import TracebackType
from typing import Final

from daq.errors import RattleError, RecorderFailed
from rig.session.centring.probe import CentringPlan, Probe
from rig.session.centring.search import Middle
from rig.session.driven_rig import DrivenRig

RECORD: Final = "centring"
"""The metadata record with the offsets and the result, each JSON."""


class CentringRecord:
    """What the log of `rig` gets of a centring besides its samples.

    What is raised within stands in it as an event.
    """

    def __init__(self, rig: DrivenRig) -> None:
        self._rig = rig
        self._probes: list[dict[str, object]] = []

    def __enter__(self) -> CentringRecord:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None:
            return
        text = str(error) or "interrupted"
        if not isinstance(error, RattleError | KeyboardInterrupt):
            text = f"{type(error).__name__}: {error}"
        with suppress(RecorderFailed):  # what ended the search is raised, not that the log takes no more
            self._rig.logbook.tell("error", "centring.ended", text)
            self._rig.recorder.metadata(RECORD, {"offsets": json.dumps(self._probes)})

    def note(self, probe: Probe, first_sample: int, end_sample: int) -> None:
        """Note an offset; what it touched was read from these samples of the record."""
        where = {"first_sample": first_sample, "end_sample": end_sample}
        self._probes.append(dataclasses.asdict(probe) | where)
        text = f"{probe}, by samples {first_sample} to {end_sample}"
        self._rig.logbook.tell("info", "centring.offset", text)

    def found(self, middle: Middle, plan: CentringPlan) -> None:
        """Note the result."""
        result = dataclasses.asdict(middle) | {
            "rest_offset_m": plan.rest_offset(middle),
            "sine_hz": plan.frequency,
        }
        offsets = {"offsets": json.dumps(self._probes), "result": json.dumps(result)}
        self._rig.recorder.metadata(RECORD, offsets)
        text = f"the middle is at {middle.offset:+.4f} N +- {middle.uncertainty:.4f} N"
        self._rig.logbook.tell("info", "centring.found", text)
