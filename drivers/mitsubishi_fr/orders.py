"""What an inverter was told to do, and for how long an order may still be given."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.mitsubishi_fr import registers as fr

TOLERANCE = 0.01
SMALLEST_TOLERANCE_HZ = 0.1


class OvertakenOrder(Exception):
    """A stop came, or too much time passed, before the order was complete: the rest of it is not sent."""


@dataclass(slots=True)
class Orders:
    """The last set frequency in Hz, whether to run, and by when the output has to be there.

    `taken`: network operation was chosen, so the motor may turn because of us.
    """

    target_hz: float = 0.0
    run: bool = False
    taken: bool = False
    obey_by_s: float = 0.0
    under_way: int = 0
    given: int = 0
    stops: int = 0

    @property
    def may_turn(self) -> bool:
        """Whether the motor may turn because of us, now or by an order that is still under way."""
        return self.taken or self.under_way > 0

    @property
    def due_hz(self) -> float:
        """Where the output has to be."""
        return self.target_hz if self.run else 0.0

    def kept(self, set_hz: float) -> bool:
        """Whether the drive's set value is ours."""
        return abs(set_hz - self.target_hz) < 0.5 * fr.RUNNING_FREQUENCY.scale

    def obeyed(self, output_hz: float, at_s: float) -> bool:
        """Whether the output is where it has to be at `at_s`, or may still be on its way."""
        off_hz = abs(output_hz - self.due_hz)
        return at_s <= self.obey_by_s or off_hz <= max(TOLERANCE * self.due_hz, SMALLEST_TOLERANCE_HZ)


class Errand:
    """An order while it is given: meanwhile, what the drive does is not yet what it was told.

    `still_wanted` is asked before each message; a stop does not ask.
    """

    def __init__(self, orders: Orders, is_stop: bool = False) -> None:
        self._orders = orders
        orders.stops += is_stop
        self._stops = orders.stops

    def __enter__(self) -> Errand:
        self._orders.under_way += 1
        return self

    def __exit__(self, *exception: object) -> None:
        self._orders.under_way -= 1
        self._orders.given += 1

    def still_wanted(self, now_s: float, expires_s: float) -> None:
        """Raise `OvertakenOrder` after a stop, or late."""
        if self._orders.stops != self._stops:
            raise OvertakenOrder("a stop overtook it")
        if now_s > expires_s:
            raise OvertakenOrder("it came too late")
