"""The twin in a process of its own, fed with the measured drive, giving back predicted blocks.

No number is crunched in the acquisition process: alignment and simulation both happen here.
"""

from __future__ import annotations

import multiprocessing
import signal
import threading
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from daq.block import SampleBlock
from daq.errors import RattleError
from rig.twin.alignment import Alignment, align
from rig.twin.prediction import AlignedTwin
from sim_twin.rigs.impact_beam.twin import BeamStream, BeamTwin

_ALIGN_ON_S = 1.0
"""Seconds of drive to align on; shorter runs use what they have when they end."""
_START_S = 120.0
_FINISH_S = 600.0


class TwinFailed(RattleError, RuntimeError):
    """The twin's process ended before its prediction was complete."""


@dataclass(frozen=True, slots=True)
class Shape:
    """Deflection of the predicted beam (m) at `time_s` since sample 0."""

    time_s: float
    deflection: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class _Drive:
    first_sample: int
    force: NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class _Recorded:
    begin: int
    end_sample: int
    start_ns: int
    last: bool


@dataclass(frozen=True, slots=True)
class _Ready:
    pass


@dataclass(frozen=True, slots=True)
class _Done:
    error: str = ""


class TwinWorker:
    """Handle of the process; `deliver` gets SampleBlock, Shape and Alignment objects in a thread of ours."""

    def __init__(
        self, twin: BeamTwin, sample_rate: float, settle_s: float, deliver: Callable[[object], None]
    ) -> None:
        self._deliver = deliver
        context = multiprocessing.get_context("spawn")
        self._pipe, self._far_end = context.Pipe()
        self._process = context.Process(
            target=_work, args=(self._far_end, twin, sample_rate, settle_s), name="twin", daemon=True
        )
        self._thread = threading.Thread(target=self._receive, name="twin receiver", daemon=True)
        self._done = threading.Event()
        self._error = ""

    def __enter__(self) -> TwinWorker:
        self._process.start()
        self._far_end.close()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._thread.is_alive() and not self._done.is_set():
            self._process.terminate()
        self._process.join(1.0)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        if self._thread.is_alive():
            self._thread.join()
        self._pipe.close()

    def wait_ready(self) -> None:
        """Wait until the twin is compiled and warm; raises TwinFailed."""
        if not self._pipe.poll(_START_S) or not isinstance(self._pipe.recv(), _Ready):
            raise TwinFailed("the twin did not start within two minutes")
        self._thread.start()

    def drive(self, first_sample: int, force: NDArray[np.floating]) -> None:
        """Hand over measured drive from sample `first_sample` of the card on."""
        self._send(_Drive(first_sample, force.astype(np.float32)))

    def recorded(self, begin: int, end_sample: int, start_ns: int, last: bool = False) -> None:
        """Say up to which of its samples the record goes by now; the prediction follows it.

        `begin` is the card's sample at which the record begins, `start_ns` its time. `last`: it ends here.
        """
        self._send(_Recorded(begin, end_sample, start_ns, last))

    def finish(self) -> None:
        """Wait for the end of the prediction after `recorded(..., last=True)`; raises TwinFailed."""
        if not self._done.wait(_FINISH_S):
            raise TwinFailed("the twin did not finish its prediction")
        if self._error:
            raise TwinFailed(self._error)

    def _send(self, message: object) -> None:
        with suppress(OSError):  # what went wrong there is said by `finish`
            self._pipe.send(message)

    def _receive(self) -> None:
        try:
            while True:
                message = self._pipe.recv()
                if isinstance(message, _Done):
                    self._error = message.error
                    break
                self._deliver(message)
        except (EOFError, OSError):
            self._error = "the twin's process died"
        except RattleError as error:
            self._error = str(error)
        self._done.set()


def _work(pipe: Connection, twin: BeamTwin, sample_rate: float, settle_s: float) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        _warm_up(twin, sample_rate)
        pipe.send(_Ready())
        _Prediction(pipe, twin, sample_rate, settle_s).run()
        pipe.send(_Done())
    except (EOFError, BrokenPipeError):
        return
    except Exception:
        with suppress(OSError):
            pipe.send(_Done(traceback.format_exc(limit=3)))


def _warm_up(twin: BeamTwin, sample_rate: float) -> None:
    stream = BeamStream(twin, sample_rate)
    stream.drive(twin.drive)
    stream.advance(64)


class _Prediction:
    """The worker's side: collects drive until it can align, then follows the record."""

    def __init__(self, pipe: Connection, twin: BeamTwin, sample_rate: float, settle_s: float) -> None:
        self._pipe, self._twin, self._rate, self._settle_s = pipe, twin, sample_rate, settle_s
        self._drive: list[_Drive] = []
        self._aligned: AlignedTwin | None = None

    def run(self) -> None:
        while True:
            message = self._pipe.recv()
            if isinstance(message, _Drive):
                if self._aligned is None:
                    self._drive.append(message)
            else:
                self._follow(message)
                if message.last:
                    return

    def _follow(self, record: _Recorded) -> None:
        if self._aligned is None and (record.last or self._enough()):
            self._align(record.begin)
        if self._aligned is None:
            return
        for block in self._aligned.blocks(record.end_sample, record.start_ns):
            self._pipe.send(block)
        if record.end_sample:
            self._pipe.send(Shape(record.end_sample / self._rate, self._aligned.shape()))

    def _enough(self) -> bool:
        return sum(len(each.force) for each in self._drive) >= _ALIGN_ON_S * self._rate

    def _align(self, begin: int) -> None:
        force = np.concatenate([each.force for each in self._drive]) if self._drive else np.zeros(0)
        first = self._drive[0].first_sample - begin if self._drive else 0
        alignment: Alignment = align(force, self._rate, first, self._twin.drive)
        self._aligned = AlignedTwin(self._twin, alignment, self._rate, self._settle_s)
        self._drive.clear()
        self._pipe.send(alignment)


__all__ = ["Alignment", "SampleBlock", "Shape", "TwinFailed", "TwinWorker"]
