"""The emulated encoder: a CANopen node whose position follows a shaft, in real time."""

from __future__ import annotations

import math
import sys
import threading
import traceback
from collections.abc import Callable
from typing import Any

import can
import canopen
import numpy as np
from canopen.nmt import NMT_STATES
from canopen.objectdictionary import ObjectDictionary, ODRecord, ODVariable, datatypes, import_od

from daq.clock import Clock
from drivers.canopen_cia406 import objects
from drivers.canopen_cia406.emulator.process import EncoderSetup
from drivers.canopen_cia406.emulator.socketcand import SocketcandBus
from drivers.canopen_cia406.objects import Entry
from drivers.emulator_truth import Truth
from drivers.protocols.encoder import Shaft
from drivers.rehearsal import Rehearsal

ERROR_REGISTER = Entry(0x1001, 0, "error register", 8, "", "CiA 301")
OFFSET = Entry(0x6509, 0, "offset value", 32, "counts", "CiA 406")
_TYPES = {8: datatypes.UNSIGNED8, 16: datatypes.UNSIGNED16, 32: datatypes.UNSIGNED32}
_STATES = {name: number for number, name in NMT_STATES.items()}
_RESENT_S = 130e-6  # as after a lost acknowledgement
_BUS_ERROR, _CONTROLLER, _BUS_OFF = 0x080, 0x004, 0x040  # linux/can/error.h
_GARBAGE = "< frame 18Z what >"  # an identifier that is no number
_IDLE_S = 0.005  # s


class EmulatedEncoder:
    """A node on a socketcand bus; frame k since its start is sent at k periods of its own timer."""

    def __init__(self, shaft: Shaft, setup: EncoderSetup, clock: Clock) -> None:
        self._shaft, self._setup, self._clock = shaft, setup, clock
        self._origin_s, self._unix_s = clock.monotonic_s(), clock.unix_ns() * 1e-9
        self._jump_s = 0.0  # by which the clock of the timestamps was set, s
        self._zero = setup.offset_counts
        self._bus = SocketcandBus(setup.channel, lambda: self._stamp(clock.monotonic_s()))
        self._network: Any = canopen.Network(self._bus)
        self._network.NOTIFIER_CYCLE = 0.05
        self._node: Any = canopen.LocalNode(setup.node, dictionary(setup))
        self._rehearsal = Rehearsal(setup.faults)
        # Jitter of the bus by a seed, so that a fault that a test finds comes again.
        self._random = np.random.default_rng(setup.seed)
        self._overtaken: can.Message | None = None
        self._silent = False  # positions alone; the heartbeat goes on
        self._truth = Truth("encoder")
        self._stuck_s = math.inf
        self._frame, self._start_s = -1, 0.0  # -1: its timer does not run
        self._beat_s, self._beat_due_s = 0.0, math.inf  # period of the heartbeat, and when the next is due, s
        # canopen's heartbeat has a thread of its own, which on a busy machine falls behind the positions.
        nmt: Any = self._node.nmt
        nmt.start_heartbeat = self._start_heartbeat
        nmt.stop_heartbeat = lambda: self._start_heartbeat(0)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="emulated encoder", daemon=True)

    def open(self) -> tuple[str]:
        """Boot; return where its socketcand server listens, `host:port`."""
        self._network.connect()
        self._network.add_node(self._node)
        self._node.add_read_callback(
            lambda index, **_: self._position(self._clock.monotonic_s()) if index == 0x6004 else None
        )
        self._node.add_write_callback(self._on_write)
        self._network.subscribe(0x80, self._on_sync)
        self._boot()
        self._truth.tell(
            counts_per_revolution=self._setup.counts_per_revolution, range=self._setup.total_range
        )
        self._thread.start()
        return (self._bus.address,)

    def serve(self) -> None:
        self._bus.serve()

    def stop(self) -> None:
        """End `serve`; may be called by any thread."""
        self._stop.set()
        self._bus.stop()

    def close(self) -> None:
        self._stop.set()
        self._thread.join()  # it sends by the network, which is closed last
        self._node.nmt.stop_heartbeat()
        self._network.disconnect()
        self._truth.close()

    def _boot(self) -> None:
        self._node.nmt.state = "INITIALISING"
        self._node.nmt.state = "PRE-OPERATIONAL"

    def _on_write(self, index: int, data: bytes, **_: object) -> None:
        # CiA 406: a preset is the value of the position where the shaft stands as it is written
        if index == 0x6003:
            here = self._position(self._clock.monotonic_s())
            self._zero += int.from_bytes(data, "little") - here  # position at angle 0, counts

    def _on_sync(self, *_: object) -> None:
        # TPDO 2, of transmission type 1: one position with every SYNC
        if self._node.nmt.state == "OPERATIONAL":
            now_s = self._clock.monotonic_s()
            self._send(0x280, self._position(now_s).to_bytes(4, "little"), now_s)

    def _position(self, time_s: float) -> int:
        turned_rad = self._shaft(min(time_s, self._stuck_s) - self._setup.lag_s)
        # Counts step where the shaft passes them, and are told of where it stood `lag_s` ago.
        turned = turned_rad / math.tau * self._setup.counts_per_revolution
        return (math.floor(turned) + self._zero) % self._setup.total_range

    def _stamp(self, time_s: float) -> float:
        rate = 1.0 + self._setup.clock_ppm * 1e-6
        elapsed_s = (time_s - self._origin_s) * rate
        return self._unix_s + self._setup.clock_offset_s + self._jump_s + elapsed_s

    def _run(self) -> None:
        try:
            while not self._stop.is_set():
                due_s = min(self._beat_due_s, self._position_due_s())
                # Not for longer: what is due may change, for the bus may start or stop the node.
                self._stop.wait(min(max(due_s - self._clock.monotonic_s(), 0.0), _IDLE_S))
                if due_s > self._clock.monotonic_s():
                    continue
                if due_s == self._beat_due_s:
                    self._send(0x700, bytes([_STATES[self._node.nmt.state]]), due_s)
                    self._beat_due_s += self._beat_s
                else:
                    self._frame += 1
                    self._send_position(self._frame - 1, due_s)
        except Exception:  # the shaft is not ours: whatever it raises ends what the node sends by itself
            traceback.print_exc(file=sys.stderr)

    def _position_due_s(self) -> float:
        # Object 6200h: positions come by themselves while the node is operational and this is not 0.
        # From the store: each read by SDO makes an object and a text for the log.
        timer_ms = int.from_bytes(self._node.data_store.get(0x6200, {}).get(0, b""), "little")
        if self._node.nmt.state != "OPERATIONAL" or timer_ms == 0:
            self._frame = -1
            return math.inf
        if self._frame < 0:
            self._frame, self._start_s = 0, self._clock.monotonic_s()
        return self._start_s + self._frame * timer_ms * 1e-3 * (1.0 + self._setup.period_ppm * 1e-6)

    def _start_heartbeat(self, period_ms: int) -> None:
        self._beat_s = period_ms * 1e-3
        self._beat_due_s = self._clock.monotonic_s() if period_ms else math.inf

    def _send_position(self, frame: int, due_s: float) -> None:
        faults = self._rehearsal.due(due_s - self._start_s)
        kinds = {each.kind: each.number("value") if "value" in each.known else 0.0 for each in faults}
        for kind, value in kinds.items():
            self._fail(kind, value, due_s)
        lost = self._silent or bool(kinds.keys() & {"missing", "receive_overrun"})
        counts = self._position(due_s)
        self._truth.tell(
            since_s=self._start_s,
            frame=frame,
            unix_s=self._unix_s + due_s - self._origin_s,
            counts=counts,
            sent=not lost and "wrong_length" not in kinds,
        )
        if lost:
            return
        data = b"".join(
            counts.to_bytes(4, "little") if mapped >> 16 == 0x6004 else bytes((mapped & 0xFF) // 8)
            for mapped in self._setup.mapped
        )
        # A bus only ever delays: a frame is due at its beat or up to `jitter_s` later.
        late_s = self._random.uniform(0.0, self._setup.jitter_s)
        message = self._message(0x180, data[:3] if "wrong_length" in kinds else data, due_s + late_s)
        if "reorder" in kinds:
            self._overtaken = message
            return
        overtaken, self._overtaken = self._overtaken, None
        for sent in (message, overtaken):
            if sent is not None:
                self._bus.send(sent)
        if "duplicate" in kinds:
            self._send(0x180, data, due_s + late_s + _RESENT_S)

    def _send(self, function: int, data: bytes, time_s: float) -> None:
        self._bus.send(self._message(function, data, time_s))

    def _message(self, function: int, data: bytes, time_s: float) -> can.Message:
        return can.Message(
            timestamp=self._stamp(time_s),
            arbitration_id=function + self._setup.node,
            data=data,
            is_extended_id=False,
        )

    def _fail(self, kind: str, value: float, due_s: float) -> None:
        acts: dict[str, Callable[[], None]] = {
            "error_frame": lambda: self._report(_BUS_ERROR, due_s),
            "receive_overrun": lambda: self._report(_CONTROLLER, due_s),
            "hang_up": self._bus.hang_up,
            "garbage": lambda: self._bus.say(_GARBAGE),
            "heartbeat_stops": self._node.nmt.stop_heartbeat,
            "positions_stop": lambda: setattr(self, "_silent", True),
            "stuck": lambda: setattr(self, "_stuck_s", due_s),
            "emergency": lambda: self._node.emcy.send(int(value), 0x01 if value else 0x00),
            "pre_operational": lambda: setattr(self._node.nmt, "state", "PRE-OPERATIONAL"),
            "restart": self._boot,
            "clock_jump": lambda: setattr(self, "_jump_s", self._jump_s + value),
        }
        if kind == "bus_off":
            self._report(_BUS_OFF, due_s)
            self._silent = True  # for good, as off the bus
            self._node.nmt.stop_heartbeat()
        elif kind in acts:
            acts[kind]()

    def _report(self, error_class: int, due_s: float) -> None:
        # with the time at which it was due: a thread that is late must not report behind the next frames
        stamp_s = self._stamp(due_s)
        self._bus.send(can.Message(timestamp=stamp_s, arbitration_id=error_class, is_error_frame=True))


def dictionary(setup: EncoderSetup) -> ObjectDictionary:
    """Return a dictionary with everything that profile 406 makes mandatory for positions."""
    od = import_od(None)
    od.node_id = setup.node
    values = {
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
    for entry, value in values.items():
        od.add_object(_variable(entry, value))
    identity = (setup.vendor, setup.product, setup.revision, setup.serial)
    entries = (objects.VENDOR, objects.PRODUCT, objects.REVISION, objects.SERIAL)
    od.add_object(_record("identity", 0x1018, dict(zip(entries, identity, strict=True))))
    for number, kind in ((0, setup.transmission_type), (1, 1)):
        cob_id, communication = 0x180 + 0x100 * number + setup.node, 0x1800 + number
        members = {
            Entry(communication, 1, "COB-ID", 32, "", "CiA 301", writable=True): cob_id,
            Entry(communication, 2, "transmission type", 8, "", "CiA 301", writable=True): kind,
        }
        od.add_object(_record(f"TPDO {number + 1} communication parameter", communication, members))
        members = {
            Entry(0x1A00 + number, place, f"object {place}", 32, "", "CiA 301"): value
            for place, value in enumerate(setup.mapped, 1)
        }
        od.add_object(_record(f"TPDO {number + 1} mapping parameter", 0x1A00 + number, members))
    return od


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
