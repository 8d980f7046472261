"""One time base: the card's sample clock is the master; how every other clock of a run lies against it."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from daq.block import NS_PER_S
from daq.clock import Clock
from daq.log.records import ClockRecord, Event
from daq.time_base import ClockFit, ClockModel, polled_clock

Array = NDArray[np.float64]

_FIRST_FIT_S, _FIT_AGAIN = 1.0, 1.3
"""When a model is fitted first, and again whenever its pairs span so much more: a fit takes 30 to 70 ms."""


_STEP_S = 1e-3
"""What of a step is worth telling: less than any crank angle here could show."""


class _Fitted:
    """A clock fit and its latest model; pairs come from one thread, the model may be asked for by others."""

    def __init__(self) -> None:
        self._fit = ClockFit()
        self._lock = threading.Lock()
        self._due_s = _FIRST_FIT_S
        self._last = (0.0, 0.0)
        self.model: ClockModel | None = None

    def add(self, device_s: ArrayLike, arrival_s: ArrayLike) -> None:
        with self._lock:
            self._fit.add(device_s, arrival_s)
            self._last = float(np.ravel(device_s)[-1]), float(np.ravel(arrival_s)[-1])

    @property
    def last(self) -> tuple[float, float]:
        """The latest pair: device and arrival, s."""
        return self._last

    def refit(self, at_last: bool = False) -> bool:
        """Fit anew where that is due, or `at_last` anyway; whether there is a new model."""
        with self._lock:
            if not at_last and self._last[1] < self._due_s:
                return False
            self._due_s = max(_FIT_AGAIN * self._last[1], self._due_s + _FIRST_FIT_S)
            model = self._fit.model()
            self.model = model or self.model
            return model is not None


class CardClock:
    """The run's time base: card sample i lies at `start_ns` + i / rate, whatever the host's clock does.

    Arrivals of blocks tell how the host's clock lies against it; the offset holds the shortest way of a block
    to this program, which no arrival can tell from it.
    """

    def __init__(self, clock: Clock, sample_rate: float) -> None:
        self._clock, self._rate = clock, sample_rate
        self._fitted = _Fitted()
        self.start_ns, self._start_s = 0, 0.0

    def start(self) -> None:
        """The card's sample 0 is taken now."""
        self.start_ns, self._start_s = self._clock.unix_ns(), self._clock.monotonic_s()

    def arrived(self, end_sample: int) -> None:
        """A block that ends before `end_sample` is there."""
        self._fitted.add(end_sample / self._rate, self._clock.monotonic_s() - self._start_s)

    @property
    def model(self) -> ClockModel | None:
        """The host's clock at card times, so far."""
        return self._fitted.model

    def host_s(self, monotonic_s: ArrayLike) -> Array:
        """Host times as seconds since the card's start by the host's clock."""
        return np.asarray(monotonic_s, np.float64) - self._start_s

    def card_s(self, host_s: ArrayLike) -> Array:
        """Where host times since the start lie on the time base, in s since sample 0; shape as given."""
        at = np.asarray(host_s, np.float64)
        return at if self.model is None else self.model.device_s(np.ravel(at)).reshape(at.shape)

    def unix_ns(self, card_s: float) -> int:
        """A time on the time base as the log has it."""
        return self.start_ns + round(card_s * NS_PER_S)

    def refit(self, at_last: bool = False) -> list[ClockRecord]:
        """How the host's clock lies, where there is news of it."""
        if not self._fitted.refit(at_last) or self.model is None:
            return []
        device_s, _ = self._fitted.last
        offset, rate = -float(self.model.offset_s([device_s])[0]), self.model.rate_ppm
        uncertainty = float(self.model.uncertainty_s([device_s])[0])
        against = -rate / (1.0 + rate * 1e-6)
        return [ClockRecord(self.unix_ns(device_s), "host", offset, against, uncertainty)]

    def polled(self, device: str, request_s: ArrayLike, reply_s: ArrayLike) -> ClockRecord:
        """How the replies of a polled device lie; times of the monotonic clock, shape (n,), n at least 1."""
        request, reply = (self.card_s(self.host_s(each)) for each in (request_s, reply_s))
        return polled_clock(device, request, reply, self.unix_ns(float(reply[-1])))


class DeviceClock:
    """A device that stamps its samples by a clock of its own, seen through the host's.

    A stamp becomes a time of the host by the device's model, and that one of the card by the host's. Nothing
    of it moves a sample: it says where a block begins.
    """

    def __init__(self, device: str, base: CardClock) -> None:
        self._device, self._base = device, base
        self._fitted = _Fitted()
        self._origin_s: float | None = None
        self._told_until_s = -np.inf

    def note(self, stamp_s: Array, arrival_s: Array) -> None:
        """Stamps by the device's clock and their arrivals by the monotonic one, shape (n,), n at least 1."""
        if self._origin_s is None:
            self._origin_s = float(stamp_s[0])
        self._fitted.add(stamp_s - self._origin_s, self._base.host_s(arrival_s))

    @property
    def locked(self) -> bool:
        """Whether stamps can be placed by models of both clocks."""
        model = self._fitted.model
        return model is not None and model.locked and self._base.model is not None

    def card_s(self, stamp_s: Array, arrival_s: Array) -> Array:
        """Where stamps lie on the time base, s since the card's sample 0; by arrival without a model."""
        model = self._fitted.model
        if model is None or self._origin_s is None:
            return self._base.card_s(self._base.host_s(arrival_s))
        return self._base.card_s(model.time_s(stamp_s - self._origin_s))

    def refit(self, at_last: bool = False) -> tuple[list[ClockRecord], list[Event]]:
        """How the clock lies, where there is news of it, and steps that it made since."""
        if not self._fitted.refit(at_last):
            return [], []
        model, host = self._fitted.model, self._base.model
        if model is None or host is None or self._origin_s is None:
            return [], []
        device_s = self._fitted.last[0]
        card_s = float(self._base.card_s(model.time_s([device_s]))[0])
        origin_s = self._base.start_ns / NS_PER_S - self._origin_s
        rate = (1.0 + model.rate_ppm * 1e-6) / (1.0 + host.rate_ppm * 1e-6) - 1.0
        uncertainty = np.hypot(model.uncertainty_s([device_s])[0], host.uncertainty_s([card_s])[0])
        record = ClockRecord(
            self._base.unix_ns(card_s),
            self._device,
            origin_s + card_s - device_s,
            rate * 1e6,
            float(uncertainty),
        )
        return [record], [*self._news(model, record.uncertainty_s)]

    def _news(self, model: ClockModel, uncertainty_s: float) -> Iterator[Event]:
        """Steps that were not told yet; a fit finds some that are less than what it knows."""
        for step in model.steps:
            if step.device_s[1] > self._told_until_s and abs(step.size_s) > max(_STEP_S, 2 * uncertainty_s):
                self._told_until_s = step.device_s[1]
                at_s = float(self._base.card_s([step.arrival_s[1]])[0])
                yield step.event(self._device, self._base.unix_ns(at_s))
