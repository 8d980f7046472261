"""What everything that moves the rig has in common."""

from __future__ import annotations

from typing import Protocol

from drivers.protocols.instrument import Instrument


class Actuator(Instrument, Protocol):
    """An instrument that moves the rig.

    Every method may raise `InstrumentRefused` (it said no, or a limit of ours forbids it), `InstrumentSilent`
    (no answer in time) and, once open, `DeviceLost`.
    """

    def open(self) -> None:
        """Connect and check the model; moves nothing. Raises `InstrumentAbsent` as well."""
        ...

    def close(self) -> None:
        """Hang up. Never raises."""
        ...

    def off(self) -> None:
        """Go to the safe state; no error where it is there or closed already."""
        ...


class ActuatorOutput(Protocol):
    """What an actuator puts out, as an emulated one tells it to a plant at every change."""

    @property
    def started_s(self) -> float:
        """Since when, in s of the monotonic clock (`SystemClock`), which all processes share."""
        ...
