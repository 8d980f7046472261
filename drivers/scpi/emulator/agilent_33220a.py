"""A 33220A without its hardware: what it keeps, what it refuses, and what its output does.

Behaviour and limits after the Agilent 33220A User's Guide (33220-90002), chapters 2 and 4. Shapes other than
the sine and bursts of a finite count are answered with -241.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from drivers.protocols.generator import DriveSettings
from drivers.scpi.emulator.command_tree import (
    Command,
    CommandError,
    CommandTree,
    asked,
    boolean,
    none,
    number,
    single,
    told,
    word,
)
from drivers.scpi.emulator.status_reporting import StatusReporting

IDENTITY = "Agilent Technologies,33220A,MY00000000,2.02-2.02-22-2"
SOURCE_OHM = 50.0  # of its output
OPEN = 9.9e37  # ohm, or cycles: how SCPI writes infinity
PEAK_LIMIT_V = 10.0  # into an open circuit
AMPLITUDE_LIMITS_VPP = (0.02, 20.0)  # into an open circuit
_FREQUENCY_SUFFIXES = {"HZ": 1.0, "KHZ": 1e3, "MHZ": 1e6, "UHZ": 1e-6}
_VOLT_SUFFIXES = {"V": 1.0, "MV": 1e-3, "VPP": 1.0, "MVPP": 1e-3}
_ANGLE_SUFFIXES = {"DEG": 1.0, "RAD": 180.0 / math.pi}


@dataclass(frozen=True, slots=True)
class GeneratorState:
    """The settings after *RST. Voltages are those into an open circuit."""

    frequency_hz: float = 1e3
    amplitude_vpp: float = 0.2  # 0.1 Vpp into 50 ohm
    offset_v: float = 0.0
    unit: str = "VPP"
    load_ohm: float = 50.0  # what it is told, not what hangs on it
    output: bool = False
    phase_deg: float = 0.0
    burst: bool = False
    burst_mode: str = "TRIG"
    burst_count: float = 1.0
    burst_phase_deg: float = 0.0
    burst_running: bool = False  # triggered: the sine is let through, without an end
    trigger_source: str = "IMM"

    @property
    def load_factor(self) -> float:
        """Displayed volts per open-circuit volt: its 50 ohm and the load that it is told of divide it."""
        return 1.0 if self.load_ohm >= OPEN else self.load_ohm / (self.load_ohm + SOURCE_OHM)

    @property
    def sine_runs(self) -> bool:
        """Whether the sine is let through, as far as burst and trigger are concerned."""
        return self.burst_running or not self.burst


class Emulated33220A:
    """The instrument behind its interfaces; `listener` hears of every change of the output.

    `clock` gives monotonic seconds. Not safe for use by several threads.
    """

    def __init__(
        self,
        listener: Callable[[DriveSettings], None],
        clock: Callable[[], float],
        identity: str = IDENTITY,
        pending_errors: Sequence[int] = (),
    ) -> None:
        self._listener, self._clock, self._identity = listener, clock, identity
        self._state = GeneratorState()
        self.status = StatusReporting(pending_errors)
        self._output = DriveSettings(False, self._state.frequency_hz, 0.1, 0.0, clock())
        self._tree = CommandTree(self._commands())

    def run(self, message: str) -> str | None:
        """Run a program message and return its answer, if it asked anything."""
        return self._tree.run(message, self.status.report)

    def _commands(self) -> list[Command]:
        """What of chapter 4 of the User's Guide drives a sine."""
        return [
            *self.status.commands(),
            Command("*IDN", answer=asked(lambda: self._identity)),
            Command("*RST", apply=told(lambda: self._keep(GeneratorState()))),
            Command("*TRG", apply=told(self._trigger)),
            Command("SYSTem:REMote", apply=none),
            Command("SYSTem:LOCal", apply=none),
            Command("[SOURce:]APPLy:SINusoid", apply=self._apply_sine),
            Command("[SOURce:]FUNCtion[:SHAPe]", self._set_shape, asked(lambda: "SIN")),
            Command(
                "[SOURce:]FREQuency",
                self._set_frequency,
                lambda p: _queried(p, self._state.frequency_hz, 1e-6, 20e6),
            ),
            Command(
                "[SOURce:]VOLTage",
                self._set_amplitude,
                lambda p: _queried(p, self._displayed(self._state.amplitude_vpp), *self._amplitude_range),
            ),
            Command(
                "[SOURce:]VOLTage:OFFSet",
                self._set_offset,
                lambda p: _queried(p, self._state.offset_v * self._state.load_factor, *self._offset_range),
            ),
            Command("[SOURce:]VOLTage:UNIT", self._set_unit, asked(lambda: self._state.unit)),
            Command("[SOURce:]PHASe", self._set_phase, asked(lambda: _shown(self._state.phase_deg))),
            Command("OUTPut[:STATe]", self._switch, asked(lambda: str(int(self._state.output)))),
            Command("OUTPut:LOAD", self._set_load, asked(lambda: _shown(self._state.load_ohm))),
            Command(
                "[SOURce:]BURSt:MODE",
                lambda p: self._change(burst_mode=word(single(p), "TRIGgered", "GATed")),
                asked(lambda: self._state.burst_mode),
            ),
            Command(
                "[SOURce:]BURSt:NCYCles", self._set_count, asked(lambda: _shown(self._state.burst_count))
            ),
            Command(
                "[SOURce:]BURSt:PHASe",
                lambda p: self._change(burst_phase_deg=self._angle(p)),
                asked(lambda: _shown(self._state.burst_phase_deg)),
            ),
            Command(
                "[SOURce:]BURSt[:STATe]",
                lambda p: self._change(burst=boolean(single(p)), burst_running=False),
                asked(lambda: str(int(self._state.burst))),
            ),
            Command(
                "TRIGger[:SEQuence]:SOURce",
                lambda p: self._change(trigger_source=word(single(p), "IMMediate", "EXTernal", "BUS")),
                asked(lambda: self._state.trigger_source),
            ),
        ]

    def _switch(self, parameters: Sequence[str]) -> None:
        output = boolean(single(parameters))
        self._change(output=output, burst_running=self._state.burst_running and output)

    def _trigger(self) -> None:
        state = self._state
        if not (state.burst and state.trigger_source == "BUS" and state.output) or state.burst_running:
            raise CommandError(-211)  # nothing waits for a trigger
        if state.burst_count < OPEN:
            raise CommandError(-241, "bursts of a finite count")
        self._keep(replace(state, burst_running=True), phase_rad=math.radians(state.burst_phase_deg))

    def _apply_sine(self, parameters: Sequence[str]) -> None:
        if len(parameters) > 3:
            raise CommandError(-108)
        self._change(burst=False, burst_running=False)  # APPLy leaves burst mode
        setters = (self._set_frequency, self._set_amplitude, self._set_offset)
        for setter, parameter in zip(setters, parameters, strict=False):
            setter([parameter])  # each clips by itself; amplitude before offset, which it bounds
        self._change(output=True)

    def _set_shape(self, parameters: Sequence[str]) -> None:
        shape = word(single(parameters), "SINusoid", "SQUare", "RAMP", "PULSe", "NOISe", "DC", "USER")
        if shape != "SIN":
            raise CommandError(-241, "shapes other than the sine")

    def _set_frequency(self, parameters: Sequence[str]) -> None:
        value = self._quantity(parameters, _FREQUENCY_SUFFIXES, 1e-6, 20e6, 1e3)
        self._change(frequency_hz=round(value, 6))  # kept to 1 uHz

    def _set_amplitude(self, parameters: Sequence[str]) -> None:
        value = self._quantity(parameters, _VOLT_SUFFIXES, *self._amplitude_range, self._displayed(0.2))
        if self._state.unit == "DBM":
            value = math.sqrt(10.0 ** (value / 10.0) * 1e-3 * self._state.load_ohm)  # V rms
        volts = value if self._state.unit == "VPP" else value * math.sqrt(8.0)  # rms to peak to peak
        vpp = volts / self._state.load_factor
        # The amplitude wins over the offset, which moves towards 0 and is told (-221).
        room = PEAK_LIMIT_V - vpp / 2.0
        offset = min(max(self._state.offset_v, -room), room)
        moved = offset != self._state.offset_v
        self._change(amplitude_vpp=vpp, offset_v=offset)
        if moved:
            self.status.report(CommandError(-221, "offset changed due to amplitude"))

    @property
    def _amplitude_range(self) -> tuple[float, float]:
        lowest, highest = AMPLITUDE_LIMITS_VPP
        return self._displayed(lowest), self._displayed(highest)

    @property
    def _offset_range(self) -> tuple[float, float]:
        room = (PEAK_LIMIT_V - self._state.amplitude_vpp / 2.0) * self._state.load_factor
        return -room, room

    def _set_offset(self, parameters: Sequence[str]) -> None:
        value = self._quantity(parameters, _VOLT_SUFFIXES, *self._offset_range, 0.0)
        self._change(offset_v=value / self._state.load_factor)

    def _set_unit(self, parameters: Sequence[str]) -> None:
        unit = word(single(parameters), "VPP", "VRMS", "DBM")
        if unit == "DBM" and self._state.load_ohm >= OPEN:
            raise CommandError(-221, "dBm needs a finite output load")
        self._change(unit=unit)

    def _set_load(self, parameters: Sequence[str]) -> None:
        text = single(parameters)
        if text in ("INF", "INFINITY"):
            unit = "VPP" if self._state.unit == "DBM" else self._state.unit
            self._change(load_ohm=OPEN, unit=unit)
        else:
            self._change(load_ohm=self._quantity([text], {"OHM": 1.0, "KOHM": 1e3}, 1.0, 1e4, 50.0))

    def _set_phase(self, parameters: Sequence[str]) -> None:
        degrees = self._angle(parameters)
        shift = math.radians(degrees - self._state.phase_deg)
        self._keep(replace(self._state, phase_deg=degrees), phase_rad=self._phase_at(self._clock()) + shift)

    def _set_count(self, parameters: Sequence[str]) -> None:
        text = single(parameters)
        if text not in ("INF", "INFINITY"):
            self._change(burst_count=round(self._quantity([text], {}, 1.0, 5e4, 1.0)))
            return
        # An infinite burst cannot trigger itself; the change of source is told as -221.
        if self._state.trigger_source == "IMM":
            self._change(trigger_source="BUS")
            self.status.report(CommandError(-221, "infinite burst changed trigger source to BUS"))
        self._change(burst_count=OPEN)

    def _angle(self, parameters: Sequence[str]) -> float:
        return self._quantity(parameters, _ANGLE_SUFFIXES, -360.0, 360.0, 0.0)

    def _quantity(
        self, parameters: Sequence[str], suffixes: dict[str, float], low: float, high: float, default: float
    ) -> float:
        text = single(parameters)
        keywords = {
            "MIN": low,
            "MINIMUM": low,
            "MAX": high,
            "MAXIMUM": high,
            "DEF": default,
            "DEFAULT": default,
        }
        value = keywords[text] if text in keywords else number(text, suffixes)
        clipped = min(max(value, low), high)
        if not math.isclose(clipped, value, rel_tol=1e-12):
            limit = "upper" if value > high else "lower"
            self.status.report(CommandError(-222, f"value clipped to {limit} limit"))
        return clipped

    def _displayed(self, vpp: float) -> float:
        # A sine of 1 V peak to peak has 1/sqrt(8) V rms; dBm are of 1 mW in the load.
        volts = vpp * self._state.load_factor
        if self._state.unit == "VPP":
            return volts
        rms = volts / math.sqrt(8.0)
        if self._state.unit == "VRMS":
            return rms
        return 10.0 * math.log10(rms**2 / self._state.load_ohm / 1e-3)

    def _change(self, **fields: float | bool | str) -> None:
        self._keep(replace(self._state, **fields))  # type: ignore[arg-type]

    def _keep(self, state: GeneratorState, phase_rad: float | None = None) -> None:
        self._state, now, before = state, self._clock(), self._output
        phase = self._phase_at(now) if phase_rad is None else phase_rad  # the sine goes on
        self._output = DriveSettings(
            on=state.output,
            frequency_hz=state.frequency_hz,
            amplitude_v=state.amplitude_vpp / 2.0 if state.sine_runs else 0.0,
            offset_v=state.offset_v,
            started_s=now,
            phase_rad=phase % math.tau,
        )
        # While the output is off nobody hears of settings, and a plant is told nothing twice.
        silent = not (before.on or self._output.on)
        same = replace(before, started_s=now, phase_rad=self._output.phase_rad) == self._output
        if silent or (phase_rad is None and same):
            return
        self._listener(self._output)

    def _phase_at(self, now: float) -> float:
        before = self._output
        return before.phase_rad + math.tau * before.frequency_hz * (now - before.started_s)


def _shown(value: float) -> str:
    return f"{value:+.13E}"


def _queried(parameters: Sequence[str], value: float, low: float, high: float) -> str:
    if not parameters:
        return _shown(value)
    return _shown(low if word(single(parameters), "MINimum", "MAXimum") == "MIN" else high)
