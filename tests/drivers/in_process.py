"""The emulated card in the test's own process, on a clock that does not wait: seconds of samples at once."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from drivers.ni_daq import card, session
from drivers.ni_daq.card import NiDaqCard
from drivers.ni_daq.channels import CardChannel, CardSettings
from drivers.ni_daq.emulator.acquisition import DriveInbox
from drivers.ni_daq.emulator.servicer import CardServer, CardServicer
from drivers.ni_daq.emulator.wiring import CardWiring
from drivers.protocols.card import Plant
from drivers.protocols.generator import DriveSettings

BUFFER_S = 20.0
PATIENCE_S = 60.0
"""In place of the driver's deadlines, which are tested elsewhere: a busy machine is no fault of a counter."""


@dataclass
class RunningClock:
    """Each look at it finds it 50 ms later, until `until_s`."""

    until_s: float
    now_s: float = 0.0

    def unix_ns(self) -> int:
        return 0

    def monotonic_s(self) -> float:
        self.now_s = min(self.now_s + 0.05, self.until_s)
        return self.now_s

    def sleep(self, seconds: float) -> None:
        raise NotImplementedError


@dataclass
class RowsPlant:
    """Shows the given rows, sample by sample, and the last sample for ever after."""

    rows: dict[str, NDArray[np.float64]]
    _next: int = 0
    rates: list[float] = field(default_factory=list)

    @property
    def channels(self) -> tuple[str, ...]:
        return tuple(self.rows)

    def start(self, sample_rate: float) -> None:
        self._next = 0
        self.rates.append(sample_rate)

    def drive(self, settings: DriveSettings, at_sample: float) -> None:
        pass

    def advance(self, count: int) -> NDArray[np.float64]:
        samples = np.arange(self._next, self._next + count)
        self._next += count
        return np.stack([row[np.minimum(samples, len(row) - 1)] for row in self.rows.values()])


@contextmanager
def served(
    plant: Plant,
    wiring: CardWiring,
    *channels: CardChannel,
    rate: float = 25600.0,
    seconds: float = 1.0,
    servicer: type[CardServicer] = CardServicer,
) -> Iterator[NiDaqCard]:
    """A card, not opened yet, on an emulator that has the first `seconds` ready as soon as it starts."""
    server = CardServer(servicer(plant, wiring, DriveInbox(), RunningClock(seconds + 1.0)))
    driver = NiDaqCard(
        CardSettings(grpc=server.open(), sample_rate_hz=rate, buffer_s=BUFFER_S, channels=channels)
    )
    with (
        patch.multiple(session, CALL_DEADLINE_S=PATIENCE_S, ANSWER_MARGIN_S=PATIENCE_S),
        patch.object(card, "WAIT_MARGIN_S", PATIENCE_S),
    ):
        try:
            yield driver
        finally:
            driver.close()
            server.close()


@contextmanager
def opened(plant: Plant, wiring: CardWiring, *channels: CardChannel, **options: float) -> Iterator[NiDaqCard]:
    """The same, opened and started."""
    with served(plant, wiring, *channels, **options) as driver:  # type: ignore[arg-type]
        driver.open()
        driver.start()
        yield driver
