"""What an encoder must be before it is used: read over SDO, compared as a whole."""

from __future__ import annotations

from dataclasses import dataclass

from daq.errors import InstrumentAbsent, InstrumentRefused, InstrumentSilent
from drivers.canopen_cia406 import frames, objects
from drivers.canopen_cia406.link import CanLink
from drivers.canopen_cia406.objects import Entry, PositionLayout
from drivers.canopen_cia406.settings import EncoderSettings

_ALWAYS = (
    objects.DEVICE_TYPE,
    objects.VENDOR,
    objects.OPERATING_PARAMETERS,
    objects.CYCLIC_TIMER,
    objects.TPDO1_ID,
    objects.TPDO1_TYPE,
    objects.TPDO1_LENGTH,
)
_NAMING = (objects.PRODUCT, objects.REVISION, objects.SERIAL)  # optional in object 1018h
_SCALED = (objects.COUNTS_PER_REVOLUTION, objects.TOTAL_RANGE)  # what counts where scaling is on
_UNSCALED = (objects.SINGLE_TURN_RESOLUTION, objects.REVOLUTIONS)  # where it is off; they multiply
_MOST_MAPPED = 8  # a frame has 8 bytes


@dataclass(frozen=True, slots=True)
class Found:
    """What an encoder said: values, and what is wrong with those that it did not give."""

    values: dict[Entry, int]
    refusals: tuple[str, ...]

    @property
    def scaled(self) -> bool:
        """Whether its scaling function is on."""
        return bool(self.values.get(objects.OPERATING_PARAMETERS, 0) & objects.SCALING)

    @property
    def counts_per_revolution(self) -> int | None:
        """Counts of a turn, by the pair of objects that is in force."""
        return self.values.get(objects.COUNTS_PER_REVOLUTION if self.scaled else _UNSCALED[0])

    @property
    def total_range(self) -> int | None:
        """Counts until the position starts again at 0."""
        if self.scaled:
            return self.values.get(objects.TOTAL_RANGE)
        if any(entry not in self.values for entry in _UNSCALED):
            return None
        return self.values[_UNSCALED[0]] * self.values[_UNSCALED[1]]

    @property
    def mapped(self) -> tuple[int, ...]:
        """The objects in TPDO 1."""
        count = self.values.get(objects.TPDO1_LENGTH, 0)
        entries = [objects.tpdo1_object(number) for number in range(1, min(count, _MOST_MAPPED) + 1)]
        return tuple(self.values[entry] for entry in entries if entry in self.values)

    def identity(self) -> str:
        """Return kind, vendor, product, revision and serial number."""
        kind = objects.ROTARY.get(self.values.get(objects.DEVICE_TYPE, 0), "unknown device")
        parts = [f"{entry.name} {self.values[entry]:X}h" for entry in (objects.VENDOR, *_NAMING[:2])
                 if entry in self.values]  # fmt: skip
        serial = self.values.get(objects.SERIAL)
        return ", ".join([kind, *parts] + ([] if serial is None else [f"serial number {serial}"]))


def read(link: CanLink, settings: EncoderSettings) -> Found:
    """Read all that matters. Raises `InstrumentAbsent` where no node answers at all."""
    reader = _Reader(link)
    # The first question alone tells an absent node: after it, silence is an error of a node that is there.
    try:
        reader.read(objects.DEVICE_TYPE)
    except InstrumentSilent as error:
        what = f"nobody answers as node {settings.node} ({error.what})"
        raise InstrumentAbsent(settings.name, settings.address, what, error.check) from error
    for entry in _ALWAYS[1:]:
        reader.read(entry)
    # Only the vendor is mandatory in 1018h; the others are asked for, and missed where the bench names them.
    for entry in _NAMING:
        reader.read(entry, needed=entry in settings.expected())
    scaled = Found(reader.values, ()).scaled
    for entry in _SCALED if scaled else _UNSCALED:
        reader.read(entry)
    # What is mapped before the position shifts it in the frame: all of it has to be known.
    for number in range(1, min(reader.values.get(objects.TPDO1_LENGTH, 0), _MOST_MAPPED) + 1):
        reader.read(objects.tpdo1_object(number))
    return Found(reader.values, tuple(reader.refusals))


class _Reader:
    """Reads entries one by one and keeps what is refused for later."""

    def __init__(self, link: CanLink) -> None:
        self._link = link
        self.values: dict[Entry, int] = {}
        self.refusals: list[str] = []

    def read(self, entry: Entry, needed: bool = True) -> None:
        try:
            self.values[entry] = self._link.upload(entry)
        except InstrumentRefused as error:
            if needed:
                self.refusals.append(error.what)


def differences(found: Found, settings: EncoderSettings) -> list[str]:
    """Return in words everything in which an encoder is not what it must be."""
    values = found.values
    said = list(found.refusals)
    if values.get(objects.DEVICE_TYPE, 0) not in objects.ROTARY:
        allowed = " or ".join(f"{kind:08X}h ({name})" for kind, name in objects.ROTARY.items())
        said.append(
            f"{objects.DEVICE_TYPE} is {values.get(objects.DEVICE_TYPE, 0):08X}h instead of {allowed}"
        )
    said += [
        f"{entry} is {values[entry]:X}h instead of {wanted:X}h"
        for entry, wanted in settings.expected().items()
        if entry in values and values[entry] != wanted
    ]
    for name, value, wanted in (
        ("counts per revolution", found.counts_per_revolution, settings.identity.counts_per_revolution),
        ("total range", found.total_range, settings.identity.total_range),
    ):
        if value is not None and wanted is not None and value != wanted:
            said.append(f"{name} is {value} instead of {wanted}")
        if value == 0:
            said.append(f"{name} is 0")
    said += _tpdo_differences(found, settings)
    return said


def _tpdo_differences(found: Found, settings: EncoderSettings) -> list[str]:
    values, said = found.values, []
    # Bits 0 to 29 of a COB-ID: the identifier, and whether it is an extended one, which ours is not.
    wanted_id = frames.TPDO1 + settings.node
    cob_id = values.get(objects.TPDO1_ID, wanted_id)
    if cob_id & objects.PDO_INVALID or cob_id & 0x3FFF_FFFF != wanted_id:
        said.append(f"{objects.TPDO1_ID} is {cob_id:08X}h instead of {wanted_id:08X}h")
    kind = values.get(objects.TPDO1_TYPE, objects.CYCLIC[0])
    if kind not in objects.CYCLIC:
        said.append(f"{objects.TPDO1_TYPE} is {kind} instead of {objects.CYCLIC[0]} or {objects.CYCLIC[1]}")
    try:
        PositionLayout.of(found.mapped)
    except ValueError as error:
        said.append(str(error))
    return said
