"""What the samples themselves tell of a sensor: not finite, saturated, stuck, off zero."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.block import Flag
from drivers.ni_daq.channels import CardChannel
from drivers.ni_daq.sensors import AnalogSensor, sensor_of
from drivers.protocols.card import Finding

FULL_SCALE = 0.99999  # a 24-bit code at full scale reads a little below the range
NEAR_FULL_SCALE = 0.98  # an amplifier's stop lies as far from what its data sheet says
EQUAL_SAMPLES = 3  # in a row, at full scale
STUCK_S = 0.1  # noise of 24 bits never shows one code for so long
OFFSET_S = 1.0  # what a mean is taken over: longer than a period of what an AC-coupled chain passes
OFFSET = 0.1  # of the range


@dataclass(slots=True)
class _Row:
    """What is remembered of a channel between blocks."""

    value: float = np.nan
    equal: int = 0
    total: float = 0.0
    count: int = 0
    offset: bool = False


class QualityWatch:
    """Judges block after block of all channels, shape (channels, n), at `sample_rate` Hz."""

    def __init__(self, channels: Sequence[CardChannel], sample_rate: float) -> None:
        known = [(row, sensor_of(channel)) for row, channel in enumerate(channels)]
        analog = [(row, sensor) for row, sensor in known if isinstance(sensor, AnalogSensor)]
        self._channels, self._rate = tuple(channels), sample_rate
        self._limits = np.array([[channel.largest * FULL_SCALE] for channel in channels])
        self._analog = [row for row, sensor in analog if sensor.noisy]
        self._coupled = [row for row, sensor in analog if sensor.ac_coupled]
        self._rows = [_Row() for _ in channels]
        self._raised: set[tuple[str, str]] = set()

    def flags(self, values: NDArray[np.float64]) -> list[Flag]:
        """Return what the log's flags can say of a block, one entry a channel."""
        finite = np.all(np.isfinite(values), axis=1).tolist()
        # NaN is passed over: what is not finite has a flag of its own.
        highest, lowest = (
            each.reduce(values, axis=1, keepdims=True, initial=0.0) for each in (np.fmax, np.fmin)
        )
        largest = np.fmax(highest, -lowest)
        beyond = (largest >= self._limits).ravel().tolist()
        near = (largest >= self._limits * NEAR_FULL_SCALE).ravel().tolist()
        for row in (row for row in self._analog if near[row]):
            # near full scale, some samples in a row that are equal tell the same
            high = np.abs(values[row]) >= float(self._limits[row, 0]) * NEAR_FULL_SCALE
            if np.count_nonzero(high) >= EQUAL_SAMPLES:
                runs = (values[row, 1:] == values[row, :-1]) & high[1:]
                for _ in range(EQUAL_SAMPLES - 2):
                    runs = runs[1:] & runs[:-1]
                beyond[row] |= bool(runs.any())
        return [
            (Flag.OVERLOAD if over else Flag.GOOD) | (Flag.GOOD if sound else Flag.NOT_FINITE)
            for over, sound in zip(beyond, finite, strict=True)
        ]

    def findings(self, values: NDArray[np.float64], faults: Sequence[Finding] = ()) -> tuple[Finding, ...]:
        """Return what has come up since the block before, with `faults` that the device told of."""
        found = [*faults, *self._stuck(values), *self._off_zero(values)]
        new = tuple(finding for finding in found if (finding.channel, finding.code) not in self._raised)
        # One that lasts is told once; one that went away and came back, again.
        self._raised = {(finding.channel, finding.code) for finding in found}
        return new

    def _stuck(self, values: NDArray[np.float64]) -> list[Finding]:
        found = []
        ends = values[:, -2:].tolist()
        for row in self._analog:
            seen, block, end = self._rows[row], values[row], ends[row]
            if len(end) == 2 and end[0] != end[1]:  # as nearly always
                seen.equal, seen.value = 0 if math.isnan(end[1]) else 1, end[1]
            elif end:  # how many of the last samples were equal
                differing = np.flatnonzero(block != block[-1])
                before = seen.equal if seen.value == block[-1] else 0
                seen.equal = len(block) - 1 - int(differing[-1]) if len(differing) else len(block) + before
                seen.value = float(block[-1])
            if seen.equal >= STUCK_S * self._rate:
                channel = self._channels[row]
                text = f"the same value, {seen.value:g} {channel.unit}, for {STUCK_S:g} s and longer"
                found.append(
                    Finding(channel.name, "stuck", f"{text}: a stuck converter, or an amplifier in reset")
                )
        return found

    def _off_zero(self, values: NDArray[np.float64]) -> list[Finding]:
        found = []
        with np.errstate(invalid="ignore"):  # of infinities, which flags tell of
            totals = values.sum(axis=1).tolist() if self._coupled else []
        for row in self._coupled:
            seen, channel = self._rows[row], self._channels[row]
            # Over whole seconds, block by block: a slow period must not look like an offset.
            seen.total += totals[row]
            seen.count += values.shape[1]
            mean = seen.total / max(seen.count, 1)
            if seen.count >= OFFSET_S * self._rate:
                seen.offset = abs(mean) > OFFSET * channel.range
                seen.total, seen.count = 0.0, 0
            if seen.offset:
                text = f"off zero by more than {OFFSET:.0%} of its range, which its chain does not pass"
                found.append(Finding(channel.name, "offset", f"{text}: bias, cable or amplifier drift"))
        return found
