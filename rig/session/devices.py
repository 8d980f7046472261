"""The instruments of a run, opened together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from daq.errors import InstrumentError
from drivers.protocols import AcquisitionCard, Actuator
from rig.session.drive import Motion


class InstrumentsMissing(InstrumentError):
    """Several instruments failed to open; all of them are named."""

    def __init__(self, errors: Sequence[InstrumentError]) -> None:
        self.errors = tuple(errors)
        Exception.__init__(self, "\n".join(str(error) for error in errors))


@dataclass(frozen=True, slots=True)
class Devices:
    """What a run drives and reads.

    `spare` makes another driver of the same actuator (picklable, for the supervisor). `motion(wait)` is what
    the actuator does in a run; `wait` waits that many seconds and may raise.
    """

    actuator: Actuator
    spare: Callable[[], Actuator]
    motion: Callable[[Callable[[float], None]], Motion]
    card: AcquisitionCard

    def open(self) -> None:
        """Open all; on failure close all again and raise what every one of them said."""
        errors: list[InstrumentError] = []
        for device in (self.actuator, self.card):
            try:
                device.open()
            except InstrumentError as error:
                errors.append(error)
        if errors:
            self.close()
            raise errors[0] if len(errors) == 1 else InstrumentsMissing(errors)

    def close(self) -> None:
        """Close all; never raises."""
        self.card.close()
        self.actuator.close()
