"""Where an encoder is on which bus, what it must be, and how fast it sends."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from daq.errors import Problem
from drivers.canopen_cia406 import objects
from drivers.canopen_cia406.objects import Entry


@dataclass(frozen=True, slots=True)
class EncoderSettings:
    """A CANopen encoder behind any interface of python-can; `options` are that interface's own keys.

    `period_s` is the time between positions in s, whole milliseconds. What is None is taken as the encoder
    says; what is not must agree with it. Positions that nobody reads are kept for `buffer_s`. An answer, or a
    position beyond its time, is awaited for `timeout_s`.
    """

    interface: str
    options: Mapping[str, str | int | float | bool]
    node: int
    period_s: float = 1e-3
    counts_per_revolution: int | None = None
    total_range: int | None = None
    operating_parameters: int | None = None
    vendor: int | None = None
    product: int | None = None
    revision: int | None = None
    serial: int | None = None
    buffer_s: float = 4.0
    timeout_s: float = 0.5
    name: str = "encoder"

    @property
    def period_ms(self) -> int:
        """The value of the cyclic timer."""
        return round(self.period_s * 1e3)

    @property
    def address(self) -> str:
        """Where it is, for people."""
        where = ", ".join(f"{key} {value}" for key, value in sorted(self.options.items()))
        return f"node {self.node} on {self.interface} ({where})"

    def expected(self) -> dict[Entry, int]:
        """Return the entries whose value is prescribed."""
        wanted = {
            objects.VENDOR: self.vendor,
            objects.PRODUCT: self.product,
            objects.REVISION: self.revision,
            objects.SERIAL: self.serial,
            objects.OPERATING_PARAMETERS: self.operating_parameters,
        }
        return {entry: value for entry, value in wanted.items() if value is not None}


def problems(settings: EncoderSettings) -> list[Problem]:
    """Return everything that is wrong with the settings themselves."""
    rules = (
        ("interface", settings.interface, bool(settings.interface), "an interface of python-can"),
        ("node", settings.node, 1 <= settings.node <= 127, "1 to 127"),
        ("period", f"{settings.period_s} s", _whole_ms(settings.period_s), "1 ms to 65535 ms in whole ms"),
        ("buffer", f"{settings.buffer_s} s", 0.1 <= settings.buffer_s <= 600.0, "0.1 s to 600 s"),
        ("timeout", f"{settings.timeout_s} s", 0.0 < settings.timeout_s <= 10.0, "up to 10 s"),
    )
    return [Problem(f"encoder.{key}", str(value), allowed) for key, value, good, allowed in rules if not good]


def _whole_ms(period_s: float) -> bool:
    return 0.5e-3 < period_s < 65.5355 and abs(period_s * 1e3 - round(period_s * 1e3)) < 1e-6
