"""The object dictionary of the emulated encoder."""

from __future__ import annotations

from canopen.objectdictionary import ObjectDictionary, ODRecord, ODVariable, datatypes, import_od

from drivers.canopen_cia406 import objects
from drivers.canopen_cia406.emulator.setup import EncoderSetup
from drivers.canopen_cia406.objects import Entry

_TYPES = {8: datatypes.UNSIGNED8, 16: datatypes.UNSIGNED16, 32: datatypes.UNSIGNED32}
ERROR_REGISTER = Entry(0x1001, 0, "error register", 8, "", "CiA 301")
OFFSET = Entry(0x6509, 0, "offset value", 32, "counts", "CiA 406")


def dictionary(setup: EncoderSetup) -> ObjectDictionary:
    """Return a dictionary with everything that profile 406 makes mandatory for positions."""
    od = import_od(None)
    od.node_id = setup.node
    for entry, value in _values(setup).items():
        od.add_object(_variable(entry, value))
    identity = (setup.vendor, setup.product, setup.revision, setup.serial)
    entries = (objects.VENDOR, objects.PRODUCT, objects.REVISION, objects.SERIAL)
    od.add_object(_record("identity", 0x1018, dict(zip(entries, identity, strict=True))))
    for number, kind in ((0, setup.transmission_type), (1, 1)):
        _add_tpdo(od, setup, number, kind)
    return od


def _values(setup: EncoderSetup) -> dict[Entry, int]:
    return {
        objects.DEVICE_TYPE: setup.device_type,
        ERROR_REGISTER: 0,
        objects.HEARTBEAT_TIME: setup.heartbeat_ms,
        objects.OPERATING_PARAMETERS: objects.SCALING if setup.scaling else 0,
        objects.COUNTS_PER_REVOLUTION: setup.counts_per_revolution,
        objects.TOTAL_RANGE: setup.total_range,
        objects.PRESET: 0,
        objects.POSITION: 0,
        objects.CYCLIC_TIMER: 0,
        objects.SINGLE_TURN_RESOLUTION: setup.counts_per_revolution,
        objects.REVOLUTIONS: setup.revolutions,
        OFFSET: 0,
    }


def _add_tpdo(od: ObjectDictionary, setup: EncoderSetup, number: int, kind: int) -> None:
    cob_id = 0x180 + 0x100 * number + setup.node
    communication, mapping = 0x1800 + number, 0x1A00 + number
    od.add_object(
        _record(
            f"TPDO {number + 1} communication parameter",
            communication,
            {
                Entry(communication, 1, "COB-ID", 32, "", "CiA 301", writable=True): cob_id,
                Entry(communication, 2, "transmission type", 8, "", "CiA 301", writable=True): kind,
            },
        )
    )
    od.add_object(
        _record(
            f"TPDO {number + 1} mapping parameter",
            mapping,
            {
                Entry(mapping, place, f"object {place}", 32, "", "CiA 301"): value
                for place, value in enumerate(setup.mapped, 1)
            },
        )
    )


def _record(name: str, index: int, members: dict[Entry, int]) -> ODRecord:
    record = ODRecord(name, index)
    record.add_member(_variable(Entry(index, 0, "number of entries", 8, "", "CiA 301"), len(members)))
    for entry, value in members.items():
        record.add_member(_variable(entry, value))
    return record


def _variable(entry: Entry, value: int) -> ODVariable:
    variable = ODVariable(entry.name, entry.index, entry.subindex)
    variable.data_type = _TYPES[entry.bits]
    variable.access_type = "rw" if entry.writable else "ro"
    variable.default = value
    return variable
