"""Where an encoder is on which bus, what it must be, and how fast it sends."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Literal

from daq.errors import Problem
from daq.quantity import Key, Quantity, Text, Whole, Words
from drivers.canopen_cia406 import objects
from drivers.canopen_cia406.objects import Entry

_WORD32 = Whole(0, 2**32 - 1)  # an object of 32 bits
_COUNTS = Whole(1, 2**32 - 1)  # 0 counts would make no turn


@dataclass(frozen=True, slots=True)
class EncoderIdentity:
    """What the encoder must say of itself; None is taken as it says."""

    counts_per_revolution: Annotated[int | None, _COUNTS] = None
    total_range: Annotated[int | None, _COUNTS] = None
    operating_parameters: Annotated[int | None, Whole(0, 0xFFFF)] = None
    vendor: Annotated[int | None, _WORD32] = None
    product: Annotated[int | None, _WORD32] = None
    revision: Annotated[int | None, _WORD32] = None
    serial: Annotated[int | None, _WORD32] = None


@dataclass(frozen=True, slots=True)
class EncoderSettings:
    """The table [encoder] of a bench: a CANopen encoder behind any interface of python-can.

    `options` are that interface's own keys. `period_s` is the time between positions in s, whole
    milliseconds. Positions that nobody reads are kept for `buffer_s`. An answer, or a position beyond its
    time, is awaited for `timeout_s`. It shows `mounting` (rad) at the mark, None where nobody knows, and goes
    `backwards` while the crank turns forwards.
    """

    node: Annotated[int, Whole(1, 127)]
    interface: Annotated[str, Text('an interface of python-can, such as "socketcand"', r"[a-z0-9_]+")]
    driver: Annotated[Literal["canopen_cia406"], Key()] = "canopen_cia406"
    period_s: Annotated[float, Quantity("ms", 1, 65535, key="period")] = 1e-3
    mounting: Annotated[float | None, Quantity("deg", -360, 360)] = None
    backwards: Annotated[bool, Words({"forwards": False, "backwards": True}, key="direction")] = False
    emulated: Annotated[bool, Key()] = False
    identity: Annotated[EncoderIdentity, Key()] = EncoderIdentity()
    options: Mapping[str, str | int | float | bool] = field(default_factory=dict)
    buffer_s: float = 4.0  # s; a reader may stall so long with nothing lost
    timeout_s: float = 0.5  # s
    name: str = "encoder"

    @staticmethod
    def place(address: str) -> Mapping[str, Any]:
        """What the table says of one that is at `address`, host:port."""
        host, _, port = address.rpartition(":")
        return {"host": host, "port": int(port)}

    def at(self, address: str) -> EncoderSettings:
        return replace(self, options={**self.options, **self.place(address)})

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
        wanted = {
            objects.VENDOR: self.identity.vendor,
            objects.PRODUCT: self.identity.product,
            objects.REVISION: self.identity.revision,
            objects.SERIAL: self.identity.serial,
            objects.OPERATING_PARAMETERS: self.identity.operating_parameters,
        }
        return {entry: value for entry, value in wanted.items() if value is not None}


def problems(settings: EncoderSettings) -> list[Problem]:
    """Return everything that is wrong with the settings themselves."""
    ms = settings.period_s * 1e3
    whole_ms = 0.5 < ms < 65535.5 and abs(ms - round(ms)) < 1e-6  # object 6200h: 16 bits, in ms
    rules = (
        ("interface", settings.interface, bool(settings.interface), "an interface of python-can"),
        ("node", settings.node, 1 <= settings.node <= 127, "1 to 127"),
        ("period", f"{settings.period_s} s", whole_ms, "1 ms to 65535 ms in whole ms"),
        ("buffer", f"{settings.buffer_s} s", 0.1 <= settings.buffer_s <= 600.0, "0.1 s to 600 s"),
        ("timeout", f"{settings.timeout_s} s", 0.0 < settings.timeout_s <= 10.0, "up to 10 s"),
    )
    return [Problem(f"encoder.{key}", str(value), allowed) for key, value, good, allowed in rules if not good]
