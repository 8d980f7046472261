"""The twin in a process of its own, fed with the measured drive, giving back predicted blocks.

No number is crunched in the acquisition process: alignment and simulation both happen here.
"""

from __future__ import annotations

import multiprocessing
import queue
import signal
import threading
import time
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from daq.block import SampleBlock, as_logged
from daq.errors import RattleError
from rig.twin.alignment import Alignment
from rig.twin.prediction import AlignedTwin
from rig.twin.rigs import kind_of
from sim_twin.rigs.catalogue import model_of
from sim_twin.twin import AnyTwin

_ALIGN_ON_S = 1.0
"""Seconds of drive to align on; shorter runs use what they have when they end."""
_KEEP_S = 5.0
_OF_THE_TERMINAL = {signal.SIGINT, signal.SIGHUP, signal.SIGQUIT}
_START_S = 120.0
_FINISH_S = 600.0
_POLL_S = 0.1


class TwinFailed(RattleError, RuntimeError):
    """The twin's process ended before its prediction was complete."""


@dataclass(frozen=True, slots=True)
class Shape:
    """Where the twin's rig is at `time_s` since sample 0: points in m, as `Truth.shape` gives them."""

    time_s: float
    points: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class _Drive:
    first_sample: int
    values: NDArray[np.floating]


@dataclass(frozen=True, slots=True)
class _Recorded:
    begin: int
    end_sample: int
    start_ns: int
    last: bool
    turned_off: float


@dataclass(frozen=True, slots=True)
class _Ready:
    pass


@dataclass(frozen=True, slots=True)
class _Done:
    error: str = ""


class TwinWorker:
    """Handle of the process; `deliver` gets SampleBlock, Shape and Alignment objects in a thread of ours.

    The twin keeps step with the best reference among the `measured` channels.
    """

    def __init__(
        self,
        twin: AnyTwin,
        measured: Sequence[str],
        sample_rate: float,
        settle_s: float,
        deliver: Callable[[object], None],
    ) -> None:
        self._deliver, self._reference = deliver, kind_of(twin).reference(measured).channel
        context = multiprocessing.get_context("spawn")
        self._pipe, self._far_end = context.Pipe()
        self._process = context.Process(
            target=_work,
            args=(self._far_end, twin, self._reference, sample_rate, settle_s),
            name="twin",
            daemon=True,
        )
        self._thread = threading.Thread(target=self._receive, name="twin receiver", daemon=True)
        self._outbox: queue.SimpleQueue[object] = queue.SimpleQueue()
        self._sender = threading.Thread(target=self._send_all, name="twin sender", daemon=True)
        self._done = threading.Event()
        self._error = ""

    def __enter__(self) -> TwinWorker:
        # The child inherits the blocked signals: what the terminal sends to the run is not for it.
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, _OF_THE_TERMINAL)
        try:
            self._process.start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
            self._far_end.close()
        self._sender.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if not self._done.is_set():
            self._process.terminate()
        self._process.join(1.0)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._outbox.put(None)
        self._sender.join()
        if self._thread.is_alive():
            self._thread.join()
        self._pipe.close()

    def wait_ready(self, check: Callable[[], None] = lambda: None) -> None:
        """Wait until the twin is compiled and warm; raises TwinFailed, and what `check` raises meanwhile."""
        deadline = time.monotonic() + _START_S
        while not self._pipe.poll(_POLL_S):
            check()
            if time.monotonic() > deadline:
                raise TwinFailed(f"the twin did not start within {_START_S:g} s")
        try:
            answer = self._pipe.recv()
        except (EOFError, OSError) as error:
            raise TwinFailed("the twin's process died while it started") from error
        if isinstance(answer, _Done):
            raise TwinFailed(f"the twin did not start: {answer.error}")
        self._thread.start()

    def drive(self, first_sample: int, values: NDArray[np.floating]) -> None:
        """Hand over the measured reference from sample `first_sample` of the card on."""
        self._outbox.put(_Drive(first_sample, as_logged(self._reference, values)))

    def recorded(
        self, begin: int, end_sample: int, start_ns: int, last: bool = False, turned_off: float = 0.0
    ) -> None:
        """Say up to which of its samples the record goes by now; the prediction follows it.

        `begin` is the card's sample at which the record begins, `start_ns` its time. `last`: it ends here.
        `turned_off`: whole turns (rad) that the record leaves out of a reference that is an angle.
        """
        self._outbox.put(_Recorded(begin, end_sample, start_ns, last, turned_off))

    def finish(self, check: Callable[[], None] = lambda: None) -> None:
        """Wait for the end of the prediction after `recorded(..., last=True)`.

        Raises TwinFailed, and what `check` raises meanwhile.
        """
        deadline = time.monotonic() + _FINISH_S
        while not self._done.wait(_POLL_S):
            check()
            if time.monotonic() > deadline:
                raise TwinFailed("the twin did not finish its prediction")
        if self._error:
            raise TwinFailed(self._error)

    def _send_all(self) -> None:
        """A thread of its own: a twin that reads slowly must not hold up the acquisition."""
        with suppress(OSError):  # what went wrong there is said by `finish`
            while (message := self._outbox.get()) is not None:
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
        except Exception as error:  # top of a thread: whoever waits for the end is to hear of it
            self._error = str(error) if isinstance(error, RattleError) else f"{type(error).__name__}: {error}"
        self._done.set()


def _work(pipe: Connection, twin: AnyTwin, reference: str, sample_rate: float, settle_s: float) -> None:
    try:
        _warm_up(twin, sample_rate)
        pipe.send(_Ready())
        _Prediction(pipe, twin, reference, sample_rate, settle_s).run()
        pipe.send(_Done())
    except (EOFError, BrokenPipeError):
        return
    except Exception:
        with suppress(OSError):
            pipe.send(_Done(traceback.format_exc(limit=3)))


def _warm_up(twin: AnyTwin, sample_rate: float) -> None:
    stream = model_of(twin).stream(twin, sample_rate)
    stream.drive(twin.drive)
    stream.advance(64)


class _Prediction:
    """The worker's side: collects drive until it can align, then follows the record."""

    def __init__(
        self, pipe: Connection, twin: AnyTwin, reference: str, sample_rate: float, settle_s: float
    ) -> None:
        self._pipe, self._twin, self._rate, self._settle_s = pipe, twin, sample_rate, settle_s
        self._reference = kind_of(twin).reference((reference,))
        cycle_s = 1.0 / kind_of(twin).untouched(twin.drive).frequency
        self._enough_s = max(_ALIGN_ON_S, self._reference.cycles * cycle_s)
        self._drive: list[_Drive] = []
        self._aligned: AlignedTwin | None = None

    def run(self) -> None:
        while True:
            message = self._pipe.recv()
            if isinstance(message, _Drive):
                if self._aligned is None:
                    self._drive.append(message)
                    self._forget_old()
            else:
                self._follow(message)
                if message.last:
                    return

    def _follow(self, record: _Recorded) -> None:
        if self._aligned is None and (record.last or self._enough()):
            self._align(record)
        if self._aligned is None:
            return
        for block in self._aligned.blocks(record.end_sample, record.start_ns):
            self._pipe.send(block)
        if record.end_sample:
            self._pipe.send(Shape(record.end_sample / self._rate, self._aligned.shape()))

    def _enough(self) -> bool:
        return sum(len(each.values) for each in self._drive) >= self._enough_s * self._rate

    def _forget_old(self) -> None:
        """Keep the newest seconds of a long settling time; the rest adds nothing to the alignment."""
        while sum(len(each.values) for each in self._drive[1:]) > max(_KEEP_S, self._enough_s) * self._rate:
            del self._drive[0]

    def _align(self, record: _Recorded) -> None:
        seen = np.concatenate([each.values for each in self._drive]) if self._drive else np.zeros(0)
        if record.turned_off:
            seen = seen - record.turned_off
        first = self._drive[0].first_sample - record.begin if self._drive else 0
        alignment: Alignment = self._reference.align(seen, self._rate, first, self._twin.drive)
        self._aligned = AlignedTwin(self._twin, alignment, self._rate, self._settle_s)
        self._drive.clear()
        self._pipe.send(alignment)


__all__ = ["Alignment", "SampleBlock", "Shape", "TwinFailed", "TwinWorker"]
