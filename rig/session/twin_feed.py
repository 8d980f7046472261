"""Between a run and the process of its twin: the measured drive goes there, predictions come back."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from daq.block import as_logged
from drivers.protocols.card import CardReading
from rig.session.acquisition import READINGS, Acquisition
from rig.stream import Block, Consumer, Shape
from rig.twin.alignment import Alignment, nothing_tells, reference_among
from rig.twin.worker import Drive, Predict, RecordedSpan
from rig.worker_process import Crew, WorkerFailed, WorkerProcess
from sim_twin.twin import AnyTwin

_FINISH_S = 600.0


class TwinFeed:
    """Feeds a twin from `feed_from` on, until it is in step, and passes on what it predicts of `names`.

    `publish` gets the prediction, `tell(level, code, text)` notes an event, and `unseen` hears what a person
    should know where the measurement shows no drive, or has none; at what to look is `look_at`. `worker` is a
    context of its own.
    """

    def __init__(
        self,
        twin: AnyTwin,
        names: Sequence[str],
        sample_rate: float,
        settle_s: float,
        publish: Consumer,
        tell: Callable[[str, str, str], None],
        unseen: Callable[[str], None],
        look_at: str,
        crew: Crew | None = None,
    ) -> None:
        self._names, self._publish, self._tell, self._unseen = names, publish, tell, unseen
        self._look_at, self._channels = look_at, twin.model.channels
        self._reference = reference_among(self._channels, names).channel
        self._last = self._ends = False
        self._told = 0  # samples of the record that the twin has been told of
        task = Predict(twin, self._reference, sample_rate, settle_s)
        self.worker = WorkerProcess("twin", task, self._deliver, crew=crew)
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
            if end - begin < self._told + READINGS * reading.values.shape[1] and not self._last:
                return  # what it predicts comes in blocks as long as what is measured
            self._told = end - begin
            turned_off = acquisition.turned_off.get(self._reference, 0.0)
            start_ns = acquisition.record_start_ns
            self.worker.give(RecordedSpan(begin, end - begin, start_ns, self._last, turned_off))

    def end(self) -> None:
        """Predict no further than what has been recorded by now: the drive leaves what the twin follows."""
        self._ends = True

    def finish(self, check: Callable[[], None]) -> None:
        """Wait for the end of the prediction; raises WorkerFailed, and what `check` raises meanwhile."""
        try:
            self.worker.finish(_FINISH_S, check)
        except WorkerFailed as error:
            self._tell("error", "twin.failed", str(error))
            raise WorkerFailed(
                f"{error}; all that was measured is in the log, rattle overlay adds a prediction"
            ) from error

    def _deliver(self, message: object) -> None:
        """In the twin's thread: pass on what it predicts, for the channels that are measured."""
        match message:
            case Block(_, samples) if samples.channel in self._names:
                self._publish(message)
            case Shape():
                self._publish(message)
            case Alignment():
                self.feed_from = None
                degrees = np.degrees(message.phase) % 360.0
                if message.trusted:
                    text = f"drive at {message.frequency:.5g} Hz, phase {degrees:.1f} degrees"
                    self._tell("info", "twin.aligned", text)
                elif missing := nothing_tells(self._channels, self._names):
                    self._tell("warning", "drive.not_seen", missing)
                    self._unseen(missing)
                else:
                    unseen = f"{self._reference} shows no drive"
                    self._tell("warning", "drive.not_seen", f"{unseen}; the twin follows the scenario")
                    self._unseen(f"{unseen}: is {self._look_at}?")
