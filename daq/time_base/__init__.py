"""One time base: the card's sample clock is the master, every other clock has a model against it."""

from daq.time_base.fit import ClockFit, fit_clock
from daq.time_base.model import Anchor, ClockModel, Step, polled_clock
from daq.time_base.run_clock import RunClock

__all__ = ["Anchor", "ClockFit", "ClockModel", "RunClock", "Step", "fit_clock", "polled_clock"]
