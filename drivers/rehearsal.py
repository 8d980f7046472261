"""Faults to rehearse: what instruments, wires and disks do to a run, in one table.

Emulators take them from here by name; `[emulation] faults` of a bench, `rattle emulate --fault` and the tests
of faults name them as `NAME[@TIME][:key=value]...`, TIME in s since the instrument was first used.
"""

from __future__ import annotations

import ctypes
import math
import os
import random
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final

from daq.errors import ConfigurationError, Problem


@dataclass(frozen=True, slots=True)
class Fault:
    """A line of the table: its `number` in the list of faults, what it does, and what one should then see.

    `values` are its keys, each with what stands for it by itself. One that comes `at_start` is there before
    its instrument is used, or not at all.
    """

    number: str
    does: str
    seen: str
    values: Mapping[str, float | str] = field(default_factory=dict)
    at_start: bool = False

    @property
    def told(self) -> str:
        """What it does, and when."""
        return self.does + (" (from the start)" if self.at_start else "")

    def spelled(self, name: str) -> str:
        """Its name with its keys, as one types it."""
        shown = (f"{value:g}" if isinstance(value, float) else "..." for value in self.values.values())
        return name + "".join(f":{key}={each}" for key, each in zip(self.values, shown, strict=True))


_MAY_BE_ON = "exit 1; THE DRIVE MAY STILL BE ON; with a real one, a process goes on trying"
_STOPPED = "exit 3, `emergency_stop...`; the next run is refused while the line is open, then asks a person"
_LOST = "exit 1 within a second, the instrument named; drive off; what it owed is in /gap"
_WATCHDOG_STOPS = "exit 1; THE MOTOR MAY STILL TURN: its watchdog stops it"
_COUNTED = "the run goes on; what is missing is in /gap with its cause, and counted in `encoder.frames`"
_TRIED = "the run goes on; tried again and never believed"
_MARKED = "the channel's flag and an event `sensor...`; the run goes on (drive.force blind for 0.2 s: exit 3)"
_REFUSED = "refused before anything moves"
_DRIVE_STOPS = "exit 1; the motor is brought to rest, the word says why"
_SOME = {"share": 0.01}  # of the answers: seldom enough that a run lives, often enough to show
_ONE_INPUT = {"channel": ""}  # how its name ends; the first such
ON_A_WIRE = ("open", "short", "wrong_sensor")
"""Kinds that come to analog inputs only."""


def _faults_of(source: str) -> dict[str, Fault]:
    """Those that every source over SCPI may have."""
    return {
        f"{source}.unplugged": Fault("F1", "its process is gone", _MAY_BE_ON),
        f"{source}.hangs": Fault("F1", "is silent `for` s", _MAY_BE_ON, {"for": 20.0}),
        f"{source}.wrong_model": Fault("F3", "is another make", _REFUSED, at_start=True),
        f"{source}.errors": Fault(
            "F30", "has a full error queue", "drained; the run goes on", {"count": 30.0}, at_start=True
        ),
        f"{source}.stale_answer": Fault(
            "F30", "an old answer and half of one lie in its buffer", "the run goes on", at_start=True
        ),
        f"{source}.endless_errors": Fault("F30", "its error queue has no end", _REFUSED, at_start=True),
        f"{source}.garbled": Fault(
            "F30", "a `share` of its answers is garbled; 1: all", _MAY_BE_ON, {"share": 1.0}
        ),
        f"{source}.unterminated": Fault(
            "F30", "a `share` of its answers lacks its end; 1: all", _MAY_BE_ON, {"share": 1.0}
        ),
        f"{source}.stays_on": Fault("F9", "takes the word to go off and stays on", _MAY_BE_ON),
    }


FAULTS: Final[Mapping[str, Fault]] = {
    **_faults_of("signal_generator"),
    "signal_generator.set_by_another": Fault(
        "F33", "its amplitude is turned to `volts` peak to peak at its panel",
        f"{_LOST}; where the force is half as much again: exit 3", {"volts": 1.0},
    ),
    **_faults_of("dc_supply"),
    "dc_supply.set_by_another": Fault("F33", "is turned to `volts` at its panel", _LOST, {"volts": 1.0}),
    "dc_supply.trips": Fault("F13", "switches off: over temperature", _LOST),
    "inverter.unplugged": Fault("F1", "its process is gone", "exit 1; THE MOTOR MAY STILL TURN"),
    "inverter.hangs": Fault("F1", "is silent `for` s", _WATCHDOG_STOPS, {"for": 20.0}),
    "inverter.flip": Fault("F4", "a `share` of the answers has wrong bits", _TRIED, _SOME),
    "inverter.cut": Fault("F4", "a `share` of the answers is cut", _TRIED, _SOME),
    "inverter.garbage": Fault("F5", "noise before a `share` of the answers", _TRIED, _SOME),
    "inverter.echo": Fault("F5", "the request comes back before the answer", _TRIED, _SOME),
    "inverter.echo_alone": Fault("F5", "the request comes back instead of it", _TRIED, _SOME),
    "inverter.twice": Fault("F5", "a `share` of the answers comes twice", _TRIED, _SOME),
    "inverter.stale": Fault("F5", "the answer before comes again", _TRIED, _SOME),
    "inverter.old_first": Fault("F5", "the answer before comes ahead of it", _TRIED, _SOME),
    "inverter.late": Fault("F5", "a `share` of the answers comes too late", _TRIED, _SOME),
    "inverter.other_station": Fault("F5", "another station answers", _TRIED, _SOME),
    "inverter.busy": Fault("F7", "a `share` of the answers says busy", _TRIED, _SOME),
    "inverter.refuses": Fault(
        "F6", "Modbus exception `code` for the next `count` uses of `register`", _DRIVE_STOPS,
        {"code": 2.0, "register": 40201.0, "count": 1.0},
    ),
    "inverter.forgets": Fault(
        "F9", "a write of `register` is acknowledged and forgotten", _DRIVE_STOPS, {"register": 40014.0}
    ),
    "inverter.stuck": Fault("F9", "keeps its speed, whatever it is told", "exit 1; THE MOTOR MAY STILL TURN"),
    "inverter.drop": Fault(
        "F10", "a `share` of the answers is lost; 1: all", _WATCHDOG_STOPS, {"share": 1.0}
    ),
    "inverter.set_by_another": Fault(
        "F33", "its set value is turned to `hz` by another program", _DRIVE_STOPS, {"hz": 3.0}
    ),
    "inverter.wrong_parameter": Fault(
        "F3", "parameter `number` is set to `value`; Pr.122: no watchdog", _REFUSED,
        {"number": 122.0, "value": 9999.0}, at_start=True,
    ),
    "inverter.stop_pressed": Fault(
        "E", "the emergency stop on its [emergency_stop] terminal is pressed", _STOPPED
    ),
    "inverter.trips": Fault(
        "F13", "trips; `code` 16 is E.OC1", "exit 1, event `inverter.E...`; nobody resets it", {"code": 16.0}
    ),
    "daq_card.unplugged": Fault("F1", "its process is gone", _LOST),
    "daq_card.hangs": Fault("F31", "is silent `for` s", _LOST, {"for": 20.0}),
    "daq_card.overruns": Fault("F15", "samples were overwritten in it before they were read", _LOST),
    "daq_card.not_finite": Fault(
        "F24", "a sample of `channel` in each block is no number", _MARKED, {**_ONE_INPUT, "for": 0.1}
    ),
    "daq_card.clips": Fault("F25", "`channel` is clipped `for` s", _MARKED, {**_ONE_INPUT, "for": 0.5}),
    "daq_card.stuck": Fault(
        "F25", "`channel` gives one value `for` s",
        "an event `sensor.stuck`; the run goes on (drive.force for a second: exit 3)",
        {**_ONE_INPUT, "for": 2.0},
    ),
    "daq_card.offset": Fault(
        "F25", "the sensor of `channel` is off by `by` of its unit",
        "nothing: a wrong mean, at rest too (rattle monitor); past a limit or the bench's maximum: exit 3",
        {**_ONE_INPUT, "by": 1.0},
    ),
    "daq_card.open": Fault("F25", "the cable of `channel` is loose", _MARKED, _ONE_INPUT, at_start=True),
    "daq_card.comes_loose": Fault("F25", "the cable of `channel` comes loose", _MARKED, _ONE_INPUT),
    "daq_card.short": Fault("F25", "the cable of `channel` is shorted", _MARKED, _ONE_INPUT, at_start=True),
    "daq_card.wrong_sensor": Fault(
        "F3", "another sensor is on `channel`, says its TEDS", f"{_REFUSED}, if the bench has its serial",
        _ONE_INPUT, at_start=True,
    ),
    "daq_card.rolls_over": Fault(
        "F26", "its counters start `before` their highest count", "nothing: angles go on",
        {"before": 1000.0}, at_start=True,
    ),
    "daq_card.marks_missing": Fault(
        "F27", "a `share` of the marks of `channel` is not there", "told of at the end, speed goes on",
        {"channel": ".marker", "share": 0.1},
    ),
    "daq_card.marks_doubled": Fault(
        "F27", "a glitch follows a `share` of the marks of `channel`", "told of at the end, speed goes on",
        {"channel": ".marker", "share": 0.1},
    ),
    "daq_card.marks_late": Fault(
        "F27", "marks of `channel` come up to `by` s late, by lot", "the speed scatters; the run goes on",
        {"channel": ".marker", "by": 5e-4},
    ),
    "daq_card.clock_off": Fault(
        "F23", "its clock is off by `ppm`", "`/clock` shows it", {"ppm": 100.0}, at_start=True
    ),
    "daq_card.chatters": Fault(
        "F35", "`channel` goes up by `height` of its unit for 0.02 s every 0.1 s, `for` s",
        "no limit on it: nothing; a warning: told once; an abort level: exit 3, at once or once held",
        {**_ONE_INPUT, "height": 1.0, "for": 1.0},
    ),
    "daq_card.stop_pressed": Fault(
        "E", "the emergency stop on its [emergency_stop] line is pressed", _STOPPED
    ),
    "daq_card.wrong_module": Fault(
        "F3", "the module of its first channel sits in another slot", _REFUSED, at_start=True
    ),
    "encoder.unplugged": Fault("F1", "its process is gone", _LOST),
    "encoder.hang_up": Fault("F2", "its CAN server closes the connection and takes a new one", _LOST),
    "encoder.hangs": Fault("F1", "is silent `for` s", _LOST, {"for": 20.0}),
    "encoder.wrong_device": Fault("F3", "is no CiA 406 encoder", _REFUSED, at_start=True),
    "encoder.garbage": Fault("F5", "the CAN server sends what is no frame", _LOST),
    "encoder.stuck": Fault(
        "F9", "shows the position that it has for ever: its coupling came off", "exit 3, `speed.abort`"
    ),
    "encoder.clock_jump": Fault(
        "F23", "the clock of the timestamps is set by `value` s", "`encoder.clock_step`; times go on",
        {"value": 1.0},
    ),
    "encoder.period_off": Fault(
        "F29", "its timer is off by `ppm`", "`/clock` shows it", {"ppm": 100.0}, at_start=True
    ),
    "encoder.rolls_over": Fault("F26", "starts a count before 0", "angles go on", at_start=True),
    "encoder.duplicate": Fault("F28", "a frame comes again 130 us later", _COUNTED),
    "encoder.reorder": Fault("F28", "a frame comes after the next one", _COUNTED),
    "encoder.missing": Fault("F28", "a frame is not sent", _COUNTED),
    "encoder.wrong_length": Fault("F28", "a frame has three bytes", _COUNTED),
    "encoder.error_frame": Fault("F28", "a bus error is reported before a frame", _COUNTED),
    "encoder.receive_overrun": Fault("F28", "a frame is lost in the interface, which says so", _COUNTED),
    "encoder.bus_off": Fault("F28", "it sends nothing any more", _LOST),
    "encoder.heartbeat_stops": Fault("F29", "its heartbeat stops, if it has one", _LOST),
    "encoder.positions_stop": Fault("F29", "its positions stop, its heartbeat goes on", _LOST),
    "encoder.emergency": Fault(
        "F29", "an emergency `value`; 0 takes all back", "exit 3, `encoder.emergency`", {"value": 20480.0}
    ),
    "encoder.pre_operational": Fault("F29", "is back in pre-operational", _LOST),
    "encoder.restart": Fault("F29", "boots anew", _LOST),
    "disk.open_fails": Fault("F17", "no log can be opened on it", _REFUSED, at_start=True),
    "disk.stalls": Fault("F14", "takes nothing `for` s", "nothing is lost", {"for": 10.0}),
    "disk.slow": Fault(
        "F15",
        "takes `rate` bytes/s at most",
        "nothing is lost, or exit 1 after minutes: slower than the data",
        {"rate": 1e5},
    ),
    "disk.full": Fault("F16", "takes `bytes` more", "exit 1; the log is readable", {"bytes": 1e6}),
    "disk.fails": Fault("F17", "every write fails", "exit 1; the log is readable"),
    "disk.sync_fails": Fault("F17", "every sync fails", "exit 1; the log is readable"),
    "disk.close_fails": Fault("F17", "the file cannot be closed", "exit 1; the log is readable"),
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Rehearsed:
    """A fault of the table that is to come, `at_s` after its instrument was first used."""

    name: str
    at_s: float = 0.0
    values: Mapping[str, float | str] = field(default_factory=dict)

    @property
    def table(self) -> str:
        """The instrument, as its table in a bench is called; or the disk."""
        return self.name.partition(".")[0]

    @property
    def kind(self) -> str:
        return self.name.partition(".")[2]

    def number(self, key: str) -> float:
        return float(self.values.get(key, self.known[key]))

    @property
    def known(self) -> Mapping[str, float | str]:
        """Its keys."""
        return FAULTS[self.name].values

    @property
    def channel(self) -> str:
        """How the name of the channel ends that it comes to, the first such; empty: of all."""
        return str(self.values.get("channel", self.known.get("channel", "")))


def rehearsed(text: str) -> Rehearsed:
    """What `NAME[@TIME][:key=value]...` says; raises ConfigurationError with what is known instead."""
    place, *settings = text.split(":")
    name, at, time = place.partition("@")
    if name not in FAULTS:
        raise _wrong(text, f"one of {', '.join(FAULTS)}")
    if at and FAULTS[name].at_start:
        raise _wrong(text, f"no time: {name} is there from the start")
    known = FAULTS[name].values
    values: dict[str, float | str] = {}
    for setting in settings:
        key, _, value = setting.partition("=")
        if key not in known or not value:
            raise _wrong(
                text, f"of {name} " + (f"{', '.join(f'{each}=...' for each in known)}" if known else "no key")
            )
        values[key] = value if isinstance(known[key], str) else _number(text, value)
    return Rehearsed(name, _number(text, time) if at else 0.0, values)


def _number(text: str, value: str) -> float:
    try:
        number = float(int(value, 0)) if value.startswith("0x") else float(value)
    except ValueError:
        number = math.nan
    if not 0.0 <= number < math.inf:
        raise _wrong(text, f"a number from 0 on instead of {value!r}")
    return number


def _wrong(text: str, allowed: str) -> ConfigurationError:
    return ConfigurationError("faults to rehearse", [Problem("fault", text, allowed)])


class Rehearsal:
    """What is still to come to one instrument, for whoever makes it knows what is there from the start.

    What every process can do it does itself.
    """

    def __init__(self, faults: Iterable[Rehearsed], seed: int = 0) -> None:
        coming = (each for each in faults if not FAULTS[each.name].at_start)
        self._waiting = sorted(coming, key=lambda each: each.at_s)  # popped from the front: each comes once
        self.lot = random.Random(seed)  # noqa: S311 - a schedule, no secret

    def due(self, used_s: float) -> Iterator[Rehearsed]:
        """Those whose time has come by `used_s` after the first use, each once."""
        while self._waiting and self._waiting[0].at_s <= used_s:
            fault = self._waiting.pop(0)
            if fault.kind == "unplugged":
                os._exit(1)  # no clean-up: whoever pulls a plug leaves none
            elif fault.kind == "hangs":
                ctypes.PyDLL(None).sleep(round(fault.number("for")))  # holds the interpreter: no thread runs
            else:
                yield fault
