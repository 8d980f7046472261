"""One time base: the card's sample clock is the master; how every other clock of a run lies against it."""

from __future__ import annotations

import threading
from collections.abc import Callable
from copy import deepcopy

import numpy as np
from numpy.typing import ArrayLike, NDArray

from daq.block import NS_PER_S
from daq.clock import Clock
from daq.log.records import ClockRecord, Event
from daq.time_base.fit import ClockFit
from daq.time_base.model import ClockModel, polled_clock

Array = NDArray[np.float64]

_FIRST_FIT_S, _FIT_AGAIN = 1.0, 1.3
"""When a model is fitted first, and again whenever its pairs span so much more: a fit takes 30 to 70 ms."""

_CRYSTAL = 50e-6
"""Standard deviation of one clock's rate from another's, before anything is known of them."""
_SLEWED = 500e-6
"""By what a time service slews a host's clock at most (adjtimex(2)): more than crystals differ by."""
_STAMP_S = 100e-6
"""95 % half width of a card's stamp of its start in this host's time: assumed, for no maker states it."""
_STEP_S = 1e-3
"""What of a step is worth telling: less than any crank angle here could show."""


class _Fitted:
    """A clock fit and its latest model; pairs come from one thread, the model may be asked for by others."""

    def __init__(self) -> None:
        self._fit = ClockFit()
        self._lock = threading.Lock()
        self._due_s = _FIRST_FIT_S
        self.last = (0.0, 0.0)  # the latest pair: the device's time and its arrival, s
        self.model: ClockModel | None = None

    def add(self, device_s: ArrayLike, arrival_s: ArrayLike) -> None:
        with self._lock:
            self._fit.add(device_s, arrival_s)
            self.last = float(np.ravel(device_s)[-1]), float(np.ravel(arrival_s)[-1])

    def refit(self, at_last: bool = False) -> bool:
        """Fit anew where that is due, or `at_last` anyway; whether there is a new model."""
        with self._lock:
            if not at_last and self.last[1] < self._due_s:
                return False
            self._due_s = max(_FIT_AGAIN * self.last[1], self._due_s + _FIRST_FIT_S)  # thirty fits in an hour
            pairs = deepcopy(self._fit)
        try:  # without the lock: pairs that come meanwhile do not wait, or a limit would be seen so late
            model = pairs.model()
        except Exception:
            self.model = None  # what is older may be wrong by now
            raise
        self.model = model or self.model
        return model is not None


class CardClock:
    """The run's time base: card sample i lies at `start_ns` + i / rate, whatever the host's clock does.

    The host's clock is joined to it where the card starts: by the card's own stamp of its sample 0 where it
    has one; else that was taken while `start` was being answered, in the middle of it for all that is known.
    From there on the host's clock goes by the rate that the arrivals of blocks show. Their delay is no part
    of it: a card that is read over a network hands on its blocks tens of milliseconds late. Until arrivals
    say it better the two clocks are taken to agree as crystals do.
    """

    def __init__(self, clock: Clock, sample_rate: float) -> None:
        self._clock, self._rate = clock, sample_rate
        self._fitted = _Fitted()
        self.start_ns, self._start_s, self._start_uncertainty_s = 0, 0.0, 0.0

    def start(self, start: Callable[[], None], started_s: Callable[[], float | None] = lambda: None) -> str:
        """Call what starts the card, which takes its sample 0 before it returns, and ask when that was.

        Says what is wrong with the answer, for which it is left out; nothing, mostly.
        """
        # Between these two looks sample 0 is taken: their middle is off by half of the distance at most.
        before_s = self._clock.monotonic_s()
        start()
        after_s, after_ns = self._clock.monotonic_s(), self._clock.unix_ns()
        self._start_s, self._start_uncertainty_s = (before_s + after_s) / 2, (after_s - before_s) / 2
        stamp_s, doubt = started_s(), ""
        if stamp_s is not None:
            if before_s - _STAMP_S <= stamp_s <= after_s + _STAMP_S:
                self._start_s, self._start_uncertainty_s = stamp_s, _STAMP_S
            else:
                away_s = stamp_s - self._start_s
                doubt = f"says that it started {away_s:+.6f} s from when it was told to: no time of this host"
        self.start_ns = after_ns - round((after_s - self._start_s) * NS_PER_S)
        return doubt

    def arrived(self, end_sample: int, arrived_s: float) -> None:
        """A block that ends before `end_sample` was there at `arrived_s` of the monotonic clock."""
        self._fitted.add(end_sample / self._rate, arrived_s - self._start_s)

    def now_s(self) -> float:
        """Seconds since the card's start by the host's clock."""
        return self._clock.monotonic_s() - self._start_s

    def host_s(self, monotonic_s: ArrayLike) -> Array:
        """Host times as seconds since the card's start by the host's clock."""
        return np.asarray(monotonic_s, np.float64) - self._start_s

    def card_s(self, host_s: ArrayLike) -> Array:
        """Where host times since the start lie on the time base, in s since sample 0; shape as given."""
        return np.asarray(host_s, np.float64) / (1.0 + self._host_rate()[0])

    def uncertainty_s(self, card_s: float) -> float:
        """95 % half width of where a host time lies on the time base."""
        return float(np.hypot(self._start_uncertainty_s, 2.0 * self._host_rate()[1] * card_s))

    def age_s(self, card_s: float) -> float:
        """How long ago the card took what lies there.

        Whoever reads it ever later sees another rate of its arrivals: only what clocks may differ by counts.
        """
        return self.now_s() / (1.0 + float(np.clip(self._host_rate()[0], -_SLEWED, _SLEWED))) - card_s

    @property
    def rate_ppm(self) -> float:
        """Host's clock against the card's, less one."""
        return self._host_rate()[0] * 1e6

    def unix_ns(self, card_s: float) -> int:
        return self.start_ns + round(card_s * NS_PER_S)

    def refit(self, at_last: bool = False) -> list[ClockRecord]:
        """How the host's clock lies, where there is news of it."""
        if not self._fitted.refit(at_last):
            return []
        card_s, rate = self._fitted.last[0], self._host_rate()[0]
        against_ppm = -rate / (1.0 + rate) * 1e6
        uncertainty_s = self.uncertainty_s(card_s)
        return [ClockRecord(self.unix_ns(card_s), "host", -rate * card_s, against_ppm, uncertainty_s)]

    def polled(self, device: str, request_s: ArrayLike, reply_s: ArrayLike) -> ClockRecord:
        """How the replies of a polled device lie; times of the monotonic clock, shape (n,), n at least 1."""
        request, reply = (self.card_s(self.host_s(each)) for each in (request_s, reply_s))
        return polled_clock(device, request, reply, self.unix_ns(float(reply[-1])))

    def _host_rate(self) -> tuple[float, float]:
        """Host's clock against the card's, less one, and its standard deviation: arrivals and crystals."""
        model = self._fitted.model
        if model is None:
            return 0.0, _CRYSTAL
        seen = model.rate_uncertainty_ppm * 0.5e-6  # 95 % half width to a deviation
        weight = _CRYSTAL**2 / (_CRYSTAL**2 + seen**2)
        return model.line.slope * weight, _CRYSTAL * seen / float(np.hypot(_CRYSTAL, seen))


class DeviceClock:
    """A device that stamps its samples by a clock of its own, seen through the host's.

    A stamp becomes a time of the host by the device's model, and that one of the card by the host's. Nothing
    of it moves a sample: it says where a block begins.
    """

    def __init__(self, device: str, base: CardClock) -> None:
        self._device, self._base = device, base
        self._fitted = _Fitted()
        self._origin_s: float | None = None  # its first stamp: floats near 0 resolve most
        self._told_until_s = -np.inf

    def note(self, stamp_s: Array, arrival_s: Array) -> None:
        """Stamps by the device's clock and their arrivals by the monotonic one, shape (n,), n at least 1."""
        if self._origin_s is None:
            self._origin_s = float(stamp_s[0])
        self._fitted.add(stamp_s - self._origin_s, self._base.host_s(arrival_s))

    @property
    def locked(self) -> bool:
        """Whether stamps can be placed by a model of the clock that made them."""
        model = self._fitted.model
        return model is not None and model.locked

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
        model = self._fitted.model
        if model is None or self._origin_s is None:
            return [], []
        device_s = self._fitted.last[0]
        card_s = float(self._base.card_s(model.time_s([device_s]))[0])
        origin_s = self._base.start_ns / NS_PER_S - self._origin_s
        # Both rates are against the host's clock, which drops out here.
        rate = (1.0 + model.rate_ppm * 1e-6) / (1.0 + self._base.rate_ppm * 1e-6) - 1.0
        uncertainty = np.hypot(model.uncertainty_s([device_s])[0], self._base.uncertainty_s(card_s))
        record = ClockRecord(
            self._base.unix_ns(card_s),
            self._device,
            origin_s + card_s - device_s,
            rate * 1e6,
            float(uncertainty),
        )
        # steps that were not told yet; a fit finds some that are less than what it knows
        least_s, told = max(_STEP_S, 2 * record.uncertainty_s), list[Event]()
        for step in model.steps:
            if step.device_s[1] > self._told_until_s and abs(step.size_s) > least_s:
                self._told_until_s = step.device_s[1]
                at_s = float(self._base.card_s([step.arrival_s[1]])[0])
                told.append(step.event(self._device, self._base.unix_ns(at_s)))
        return [record], told
