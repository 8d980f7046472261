"""The emulated card while it runs: samples made in real time, for the analog task and its counters."""

from __future__ import annotations

import sys
import threading
import traceback
from collections import deque
from collections.abc import Sequence
from typing import Any, Generic, TypeVar

import numpy as np
from nidaqmx.error_codes import DAQmxErrors
from numpy.typing import DTypeLike, NDArray

from daq.block import NS_PER_S
from daq.clock import Clock, wall_less_monotonic_ns
from drivers.emulator_truth import Truth
from drivers.ni_daq.emulator.converter import Converter, Measure
from drivers.ni_daq.emulator.spoilt import SpoiltPlant
from drivers.ni_daq.emulator.wiring import CardWiring, DaqmxError, Input
from drivers.protocols.card import Plant
from drivers.protocols.instrument import ActuatorOutput

Output = TypeVar("Output", bound=ActuatorOutput)
BLOCK_S = 0.025  # s of samples made at once
LAG_S = 0.025  # samples are made this much after their time; news of the drive travels faster
SHOWN = 101  # every so manyth sample is kept with its values in the truth
TRANSFER_S = 0.01  # and can be read so much later, however long it took to make them


class SampleBuffer:
    """Rows of samples, kept until they are read or overwritten; one thread puts, another reads."""

    def __init__(self, rows: int, size: int, dtype: DTypeLike = np.float64) -> None:
        # Written to now: where memory comes slowly, the first samples would wait for it.
        self._ring: NDArray[Any] = np.full((rows, size), 0, dtype=dtype)
        self._made = self._taken = 0  # samples a row since the start; never reset, so that an overrun shows
        self._fault: DaqmxError | None = None
        self._changed = threading.Condition()  # over ring, counts and fault

    @property
    def made(self) -> int:
        """Samples per channel so far."""
        return self._made

    @property
    def read_so_far(self) -> int:
        """Samples per channel that somebody has."""
        return self._taken

    @property
    def available(self) -> int:
        """Samples per channel that wait to be read."""
        return self._made - self._taken

    def put(self, values: NDArray[Any]) -> None:
        """Keep the next samples, shape (rows, n) with n up to the size."""
        count = values.shape[1]
        with self._changed:
            size = self._ring.shape[1]
            first = self._made % size
            head = min(count, size - first)
            self._ring[:, first : first + head] = values[:, :head]
            self._ring[:, : count - head] = values[:, head:]
            self._made += count
            self._changed.notify_all()

    def fail(self, fault: DaqmxError) -> None:
        """Let whoever waits for samples that will not come know why."""
        with self._changed:
            self._fault = self._fault or fault
            self._changed.notify_all()

    def read(self, count: int, timeout_s: float) -> NDArray[Any]:
        """Return the next `count` samples, shape (rows, count); waits for ever where `timeout_s` < 0."""
        with self._changed:
            self._changed.wait_for(
                lambda: self.available >= count or self._fault is not None,
                None if timeout_s < 0 else timeout_s,
            )
            # Overwritten while nobody read: DAQmx says so, and never hands out what is left.
            if self.available > self._ring.shape[1]:
                text = "samples were overwritten before they were read"
                raise DaqmxError(DAQmxErrors.SAMPLES_NO_LONGER_AVAILABLE, text)
            if self.available < count:
                text = f"{self.available} of {count} samples within {timeout_s:g} s"
                raise self._fault or DaqmxError(DAQmxErrors.SAMPLES_NOT_YET_AVAILABLE, text)
            rows, size = self._ring.shape
            first = self._taken % size
            head = min(count, size - first)
            values = np.empty((rows, count), self._ring.dtype)
            values[:, :head] = self._ring[:, first : first + head]
            values[:, head:] = self._ring[:, : count - head]
            self._taken += count
        return values


class DriveInbox(Generic[Output]):
    """What an actuator puts out on its way to the plant; any thread may put, the producer takes."""

    def __init__(self, initial: Output | None = None) -> None:
        self._waiting: deque[Output] = deque()  # appending and taking are atomic: no lock
        self._last = initial

    def put(self, output: Output) -> None:
        """Leave a change of the output for the plant."""
        self._waiting.append(output)

    def take(self) -> list[Output]:
        """Return the changes that came since the last call, oldest first."""
        taken = [self._waiting.popleft() for _ in range(len(self._waiting))]
        if taken:
            self._last = taken[-1]
        return taken

    def take_all(self) -> list[Output]:
        """Return the change before those as well, for a plant that has just begun."""
        last = self._last
        return ([] if last is None else [last]) + self.take()


class CounterRun:
    """A counter that has been started: it counts at the edges of the sample clock that it is attached to."""

    def __init__(self, measure: Measure, row: int | None, dtype: DTypeLike, buffer_size: int) -> None:
        self._measure, self._row = measure, row
        self.buffer = SampleBuffer(1, buffer_size, dtype)

    def take(self, plant: NDArray[np.float64]) -> NDArray[Any]:
        """Count what the plant shows in its next samples, shape (channels, n); nothing on a loose input."""
        seen = np.zeros(plant.shape[1]) if self._row is None else plant[self._row]
        counted = self._measure(seen)
        self.buffer.put(counted[None, :])
        return counted


class Acquisition:
    """A running analog task. Sample i is taken at `t0 + i / sample_rate`, t0 the monotonic time of `start`.

    Its sample clock is the plant's, and every counter's: one that is attached before `start` has the first
    edge as its first sample, a later one the next block's.
    """

    def __init__(
        self,
        plant: Plant[Any],
        wiring: CardWiring,
        inputs: Sequence[Input],
        sample_rate: float,
        buffer_size: int,
        inbox: DriveInbox[Any],
        clock: Clock,
    ) -> None:
        self._plant, self._inbox, self._clock = plant, inbox, clock
        plant.start(sample_rate)
        self._converter = Converter(wiring, plant.channels, inputs, sample_rate)
        self._names = tuple(item.physical for item in inputs)
        self._nominal = sample_rate
        self._rate = sample_rate * (1.0 + 1e-6 * wiring.clock_ppm)  # by the machine's clock
        self._block = max(round(BLOCK_S * sample_rate), 1)
        # a client may ask for less than is made at once
        self.buffer = SampleBuffer(len(inputs), max(buffer_size, 2 * self._block))
        self._clipped = np.zeros(len(inputs), dtype=bool)
        self._clipping = threading.Lock()  # the client asks while the next block is made
        self._counters: tuple[CounterRun, ...] = ()
        self._start_s = 0.0
        self._truth = Truth("daq_card")
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="emulated card", daemon=True)

    @property
    def started(self) -> bool:
        """Whether its sample clock runs, or ran."""
        return self._thread.ident is not None

    @property
    def open_inputs(self) -> tuple[str, ...]:
        """Inputs with an IEPE supply and nobody to take it."""
        return (*self._converter.open_inputs, *self._converter.fed_by(self._loose))

    @property
    def _loose(self) -> frozenset[str]:
        """Channels of the plant whose cables have come loose since the start."""
        return self._plant.loose if isinstance(self._plant, SpoiltPlant) else frozenset()

    @property
    def shorted_inputs(self) -> tuple[str, ...]:
        """Inputs whose IEPE supply runs into a short circuit."""
        return self._converter.shorted_inputs

    def attach(self, counter: CounterRun) -> None:
        """Let a counter follow the sample clock from its next block on."""
        # A new tuple: the acquisition's thread may be going through the old one.
        self._counters += (counter,)

    @property
    def started_ns(self) -> int:
        """When sample 0 was taken, Unix epoch, ns."""
        return round(self._start_s * NS_PER_S) + wall_less_monotonic_ns(self._clock)

    def start(self) -> None:
        """Start the sample clock; once."""
        self._start_s = self._clock.monotonic_s()
        self._truth.tell(started_ns=self.started_ns, rate=self._nominal, inputs=self._names)
        self._thread.start()

    def stop(self) -> None:
        """Stop the sample clock and wake whoever waits for samples."""
        self._stop.set()
        self.buffer.fail(DaqmxError(DAQmxErrors.SAMPLES_WILL_NEVER_BE_AVAILABLE, "the task was stopped"))
        if self.started:
            self._thread.join()
        self._truth.close()

    def clipped_inputs(self) -> tuple[str, ...]:
        """Return the inputs that clipped since the last call."""
        with self._clipping:
            names = tuple(name for name, clipped in zip(self._names, self._clipped, strict=True) if clipped)
            self._clipped[:] = False
        return names

    def _run(self) -> None:
        try:
            # What the drive did before this task began goes on, with its phase.
            self._pass_on(self._inbox.take_all())
            while not self._stop.wait(self._due_s() - self._clock.monotonic_s()):
                self._pass_on(self._inbox.take())
                plant = self._plant.advance(self._block)
                counted = [counter.take(plant) for counter in self._counters]
                values, clipped = self._converter.convert(plant, self._loose)
                # Constant from sample to read, so that the time of arrival tells what the machine adds.
                self._stop.wait(self._due_s() + TRANSFER_S - self._clock.monotonic_s())
                with self._clipping:
                    self._clipped |= clipped
                if self._truth.kept:
                    first, count = self.buffer.made, values.shape[1]
                    shown = range(-first % SHOWN, count, SHOWN)
                    self._truth.tell(
                        first=first,
                        count=count,
                        values={first + at: values[:, at].tobytes().hex() for at in shown},
                        counted={first + at: [each[at].item() for each in counted] for at in shown},
                        read=self.buffer.read_so_far,
                    )
                self.buffer.put(values)
        except Exception as error:  # the plant is not ours: whatever it raises ends the task, not the server
            fault = error if isinstance(error, DaqmxError) else None  # a rehearsed one
            if fault is None:
                traceback.print_exc(file=sys.stderr)
                fault = DaqmxError(DAQmxErrors.DEV_CANNOT_BE_ACCESSED, "the emulated plant failed")
            for buffer in (self.buffer, *(counter.buffer for counter in self._counters)):
                buffer.fail(fault)

    def _due_s(self) -> float:
        return self._start_s + (self.buffer.made + self._block) / self._rate + LAG_S

    def _pass_on(self, outputs: Sequence[ActuatorOutput]) -> None:
        for output in outputs:
            self._plant.drive(output, (output.started_s - self._start_s) * self._rate)
