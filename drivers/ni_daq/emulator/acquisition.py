"""The emulated card while it runs: samples made in real time, kept until they are read or overwritten."""

from __future__ import annotations

import math
import sys
import threading
import traceback
from collections import deque
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from nidaqmx.error_codes import DAQmxErrors
from numpy.typing import NDArray

from daq import Clock
from drivers.ni_daq.emulator.converter import Converter
from drivers.ni_daq.emulator.wiring import CardWiring, DaqmxError, Input
from drivers.protocols import DriveSettings, Plant

BLOCK_S = 0.025
LAG_S = 0.025  # samples are made this much after their time; news of the drive travels faster


class DriveInbox:
    """Drive settings on their way to the plant; any thread may put, the producer takes."""

    def __init__(self, initial: DriveSettings | None = None) -> None:
        self._waiting: deque[DriveSettings] = deque()
        self._last = initial

    def put(self, settings: DriveSettings) -> None:
        """Leave settings for the plant."""
        self._waiting.append(settings)

    def take(self) -> list[DriveSettings]:
        """Return the settings that came since the last call, oldest first."""
        taken = [self._waiting.popleft() for _ in range(len(self._waiting))]
        if taken:
            self._last = taken[-1]
        return taken

    def take_all(self) -> list[DriveSettings]:
        """Return what the output does now as well, for a plant that has just begun."""
        last = self._last
        return ([] if last is None else [last]) + self.take()


class Acquisition:
    """A running task. Sample i is taken at `t0 + i / sample_rate`, t0 being the monotonic time of `start`."""

    def __init__(
        self,
        plant: Plant,
        wiring: CardWiring,
        inputs: Sequence[Input],
        sample_rate: float,
        buffer_size: int,
        inbox: DriveInbox,
        clock: Clock,
    ) -> None:
        self._plant, self._inbox, self._clock = plant, inbox, clock
        self._converter = Converter(wiring, plant.channels, inputs)
        self._names = tuple(item.physical for item in inputs)
        self._rate = sample_rate
        self._block = max(round(BLOCK_S * sample_rate), 1)
        self._ring = np.zeros((len(inputs), max(buffer_size, 2 * self._block)))
        self._made = self._taken = 0
        self._clipped = np.zeros(len(inputs), dtype=bool)
        self._fault: DaqmxError | None = None
        self._start_s = 0.0
        self._changed = threading.Condition()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="emulated card", daemon=True)

    @property
    def made(self) -> int:
        """Samples per channel so far."""
        return self._made

    @property
    def available(self) -> int:
        """Samples per channel that wait to be read."""
        return self._made - self._taken

    @property
    def open_inputs(self) -> tuple[str, ...]:
        """Inputs with an IEPE supply and nobody to take it."""
        return self._converter.open_inputs

    def start(self) -> None:
        """Start the sample clock."""
        self._plant.start(self._rate)
        self._start_s = self._clock.monotonic_s()
        self._pass_on(self._inbox.take_all())
        self._thread.start()

    def stop(self) -> None:
        """Stop the sample clock and wake whoever waits for samples."""
        self._stop.set()
        self._fail(DaqmxError(DAQmxErrors.SAMPLES_WILL_NEVER_BE_AVAILABLE, "the task was stopped"))
        self._thread.join()

    def clipped_inputs(self) -> tuple[str, ...]:
        """Return the inputs that clipped since the last call."""
        with self._changed:
            names = tuple(name for name, clipped in zip(self._names, self._clipped, strict=True) if clipped)
            self._clipped[:] = False
        return names

    def read(self, count: int, timeout_s: float) -> NDArray[np.float64]:
        """Return the next `count` samples, shape (inputs, count); waits for ever where `timeout_s` < 0."""
        with self._changed:
            self._changed.wait_for(
                lambda: self.available >= count or self._fault is not None,
                None if timeout_s < 0 else timeout_s,
            )
            if self.available > self._ring.shape[1]:
                text = "samples were overwritten before they were read"
                raise DaqmxError(DAQmxErrors.SAMPLES_NO_LONGER_AVAILABLE, text)
            if self.available < count:
                text = f"{self.available} of {count} samples within {timeout_s:g} s"
                raise self._fault or DaqmxError(DAQmxErrors.SAMPLES_NOT_YET_AVAILABLE, text)
            values = self._ring.take(range(self._taken, self._taken + count), axis=1, mode="wrap")
            self._taken += count
        return values

    def _run(self) -> None:
        try:
            while not self._stop.wait(self._due_s() - self._clock.monotonic_s()):
                self._make_block()
        except Exception:  # the plant is not ours: whatever it raises ends the task, not the server
            traceback.print_exc(file=sys.stderr)
            self._fail(DaqmxError(DAQmxErrors.DEV_CANNOT_BE_ACCESSED, "the emulated plant failed"))

    def _due_s(self) -> float:
        return self._start_s + (self._made + self._block) / self._rate + LAG_S

    def _make_block(self) -> None:
        self._pass_on(self._inbox.take())
        values, clipped = self._converter.convert(self._plant.advance(self._block))
        with self._changed:
            size = self._ring.shape[1]
            first = self._made % size
            head = min(self._block, size - first)
            self._ring[:, first : first + head] = values[:, :head]
            self._ring[:, : self._block - head] = values[:, head:]
            self._made += self._block
            self._clipped |= clipped
            self._changed.notify_all()

    def _pass_on(self, drive: Sequence[DriveSettings]) -> None:
        for settings in drive:
            at_sample = (settings.started_s - self._start_s) * self._rate
            if at_sample < self._made:
                settings = _seen_at(settings, self._start_s + self._made / self._rate)
                at_sample = float(self._made)
            self._plant.drive(settings, at_sample)

    def _fail(self, fault: DaqmxError) -> None:
        with self._changed:
            self._fault = self._fault or fault
            self._changed.notify_all()


def _seen_at(settings: DriveSettings, time_s: float) -> DriveSettings:
    # A sine that began before the samples that are made next is under way by then.
    phase = settings.phase_rad + math.tau * settings.frequency_hz * (time_s - settings.started_s)
    return replace(settings, started_s=time_s, phase_rad=phase % math.tau)
