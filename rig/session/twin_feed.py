"""Between a run and the process of its twin: the measured drive goes there, predictions come back."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from daq.block import SampleBlock, as_logged
from drivers.protocols.card import CardReading
from rig.session.acquisition import Acquisition
from rig.session.hub import Hub
from rig.twin.alignment import Alignment
from rig.twin.reference import reference_among
from rig.twin.worker import Drive, Predict, Recorded, Shape
from rig.worker_process import WorkerFailed, WorkerProcess
from sim_twin.twin import AnyTwin

_FINISH_S = 600.0


class TwinFeed:
    """Feeds a twin from `feed_from` on, until it is in step, and passes on what it predicts of `names`.

    `unseen` hears what a person should look at where the measurement shows no drive. `worker` is a context of
    its own; `hub` and `tell(level, code, text)`, which notes an event, are set before anything is fed.
    """

    def __init__(
        self,
        twin: AnyTwin,
        names: Sequence[str],
        sample_rate: float,
        settle_s: float,
        unseen: Callable[[str], None],
    ) -> None:
        self._names, self._unseen = names, unseen
        self._reference = reference_among(twin.model.channels, names).channel
        self._last = self._ends = False
        task = Predict(twin, self._reference, sample_rate, settle_s)
        self.worker = WorkerProcess("twin", task, self._deliver)
        self.hub = Hub(())
        self.tell: Callable[[str, str, str], None] = lambda level, code, text: None
        self.feed_from: int | None = None

    def take(self, reading: CardReading, acquisition: Acquisition) -> None:
        """In the acquisition thread: hand over the reference, and say how far the record is."""
        feed_from = self.feed_from
        if self._last:
            return
        if feed_from is not None and reading.first_sample >= feed_from and self._reference in self._names:
            row = reading.values[self._names.index(self._reference)]
            self.worker.give(Drive(reading.first_sample, as_logged(self._reference, row)))
        begin, until = acquisition.record_from, acquisition.record_until
        if begin is not None and until is not None:
            if self._ends:
                until = max(reading.first_sample, begin)
            end = min(reading.first_sample + reading.values.shape[1], until)
            self._last = end == until
            if end == begin and not self._last:
                return  # it begins with the next reading: until then nobody knows what turns it leaves out
            turned_off = acquisition.turned_off.get(self._reference, 0.0)
            start_ns = acquisition.record_start_ns
            self.worker.give(Recorded(begin, end - begin, start_ns, self._last, turned_off))

    def end(self) -> None:
        """Predict no further than what has been recorded by now: the drive leaves what the twin follows."""
        self._ends = True

    def finish(self, check: Callable[[], None]) -> None:
        """Wait for the end of the prediction; raises WorkerFailed, and what `check` raises meanwhile."""
        try:
            self.worker.finish(_FINISH_S, check)
        except WorkerFailed as error:
            self.tell("error", "twin.failed", str(error))
            raise WorkerFailed(
                f"{error}; all that was measured is in the log, rattle overlay adds a prediction"
            ) from error

    def _deliver(self, message: object) -> None:
        """In the twin's thread: pass on what it predicts, for the channels that are measured."""
        if isinstance(message, SampleBlock):
            if message.channel in self._names:
                self.hub.block("predicted", message)
        elif isinstance(message, Shape):
            self.hub.shape(message.time_s, message.points)
        elif isinstance(message, Alignment):
            self._note_alignment(message)

    def _note_alignment(self, alignment: Alignment) -> None:
        self.feed_from = None
        degrees = np.degrees(alignment.phase) % 360.0
        if alignment.trusted:
            text = f"drive at {alignment.frequency:.5g} Hz, phase {degrees:.1f} degrees"
            self.tell("info", "twin.aligned", text)
        else:
            unseen = f"{self._reference} shows no drive"
            self.tell("warning", "drive.not_seen", f"{unseen}; the twin follows the scenario")
            self._unseen(unseen)
