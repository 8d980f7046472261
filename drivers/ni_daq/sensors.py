"""The kinds of sensor that a card's inputs take: how each one is declared to DAQmx, and what comes back.

A kind is one entry in the one table, or an entry point of another package in the group `rattle.sensors`.
Nothing of nidaqmx is imported before a channel is declared: a bench file is read where there is none.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import log10
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np
from numpy.typing import DTypeLike, NDArray

from daq.angle.unwrap import Unwrapper
from daq.channel import Channel
from daq.plugins import OpenTable
from daq.quantity import Quantity

if TYPE_CHECKING:
    from drivers.ni_daq.channels import CardChannel, Pulses


Decoder: TypeAlias = Callable[[NDArray[Any]], NDArray[np.float64]]
"""Takes the consecutive blocks of one task, each of shape (n,), and gives the channel's values."""

COUNTER_STATES = 2**32  # 32 bits, read as unsigned; half of them stand for counts below 0


class UnwrappedCount:
    """The whole count behind a 32-bit counter that starts at 0 as int64, forwards and backwards.

    `modulus` is after how many counts it repeats; steps of less than half of that come out exactly. The first
    count lies from `lowest` on. No step is ambiguous: a counter is read at every sample, and
    half of 2^32 within one takes 26 s at 80 MHz; with an index, half a turn is 30,000 rpm at 1 kHz.
    """

    def __init__(self, modulus: int = COUNTER_STATES, lowest: int = -COUNTER_STATES // 2) -> None:
        self._modulus, self._lowest = modulus, lowest
        self._unwrapper = Unwrapper(modulus)

    def __call__(self, raw: NDArray[np.uint32]) -> NDArray[np.int64]:
        """Return the counts of the next block, shape (n,)."""
        register = raw.view(np.int32).astype(np.int64)  # above 2^31: counts below 0
        above = (register - self._lowest) % self._modulus
        return self._unwrapper.unwrap(above).counts + self._lowest


def angle(counts: UnwrappedCount, rad_per_count: float) -> Decoder:
    """Unwrapped angle in rad."""
    return lambda raw: np.multiply(counts(raw), rad_per_count, dtype=np.float64)


class MarkPulses:
    """A marker whose edges a counter counts: `level` (V) at each sample that follows an edge, else 0.

    A mark shorter than a sample is not missed; two between two samples look like one.
    """

    def __init__(self, level: float) -> None:
        self._level = level
        self._counts = UnwrappedCount()
        self._last = 0

    def __call__(self, raw: NDArray[np.uint32]) -> NDArray[np.float64]:
        """Return the next block in V, shape (n,)."""
        counts = self._counts(raw)
        rising = np.diff(counts, prepend=self._last) > 0
        self._last = int(counts[-1]) if len(counts) else self._last  # an edge may lie between two blocks
        return np.where(rising, self._level, 0.0)


def speed(rad_per_pulse: float) -> Decoder:
    """Speed in rad/s from the frequency of pulses in Hz."""
    return lambda frequency_hz: frequency_hz * rad_per_pulse


STANDARD_GRAVITY = 9.80665  # m/s2, 3rd CGPM 1901; DAQmx takes accelerometer sensitivities per g
HEARING_THRESHOLD_PA = 20e-6  # what DAQmx counts a sound's decibels from (IEC 61672-1)
LBF = 4.4482216152605  # N, from the pound of 1959 and standard gravity
_SLOWEST = 1e-4  # of a tachometer's range: DAQmx wants to know the lowest frequency, which may not be 0

FORCE: Final = {"N": Quantity("N", 0, 1e6, above=True)}
ACCELERATION: Final = {"m/s2": Quantity("m/s2", 0, 1e6, above=True)}
VOLTAGE: Final = {"V": Quantity("V", 0, 1e3, above=True)}
SOUND: Final = {"Pa": Quantity("Pa", 0, 1e5, above=True)}
SPEED: Final = {"rad/s": Quantity("rad/s", 0, 1e5, above=True)}
ANY_UP_TO: Final = 1e9
"""Of a channel that no rig has, in its unit: 10,000 bar."""
_VOLTS_EACH: Final = ("sensitivity", "range")
_ANY_INPUT: Final = ("resonance", "resonance_damping", "delay", "inverted")


@dataclass(frozen=True, slots=True)
class AnalogSensor:
    """A kind of sensor on an analog input; `declare(task, channel)` adds its channel to a DAQmx task.

    `units` are those that it can measure, each with what a full scale may be; with `any_unit` that of a
    channel that no rig has may be any, for the card sees volts. A channel must have the keys `needs` of a
    bench file and may have the keys `takes`. With `in_volts` DAQmx delivers volts, else the unit itself.
    `noisy` inputs never show one code for long; `ac_coupled` ones have no mean. `sheet` reads the sensitivity
    (V per unit) that a TEDS states. Modules with an input by which it is `fed` (IEPE) are delta-sigma ones,
    later than a counter.
    """

    units: Mapping[str, Quantity]
    declare: Callable[[Any, CardChannel], None]
    needs: tuple[str, ...] = _VOLTS_EACH
    takes: tuple[str, ...] = ()
    in_volts: bool = True
    noisy: bool = True
    ac_coupled: bool = False
    sheet: Callable[[Any, CardChannel], float] | None = None
    any_unit: bool = False
    fed: bool = False

    def scale(self, channel: CardChannel) -> float | None:
        """Unit per volt, or per unit that DAQmx delivers; None where that is the unit as it is meant."""
        gain = -1.0 if channel.inverted else 1.0 if channel.mark is None else channel.mark.gain
        if self.in_volts:
            return gain / channel.volts_per_unit
        return gain if channel.inverted else None

    @property
    def raw_unit(self) -> str:
        """What `scale` is per."""
        return "V" if self.in_volts else ""


@dataclass(frozen=True, slots=True)
class CounterSensor:
    """A kind of pulse source on a counter; `units`, `declare`, `needs` and `takes` as those of an analog one.

    An angle has no full scale. `read` is the method of a `CounterReader` for `dtype`, `decoder` makes values
    of its readings.
    """

    units: Mapping[str, Quantity | None]
    declare: Callable[[Any, CardChannel], None]
    needs: tuple[str, ...]
    raw_unit: str
    scale: Callable[[CardChannel], float | None]
    decoder: Callable[[CardChannel], Decoder]
    takes: tuple[str, ...] = ()
    read: str = "read_many_sample_uint32"
    dtype: DTypeLike = np.uint32


Sensor: TypeAlias = AnalogSensor | CounterSensor


@dataclass(frozen=True, slots=True)
class SensorKind:
    """What the `kind` of a channel stands for, on an analog input, on a counter, or on either."""

    analog: AnalogSensor | None = None
    counter: CounterSensor | None = None

    def on(self, sort: str) -> Sensor | None:
        """The sensor on an input of that sort, `ai` or `ctr`; None where it is never on one."""
        return {"ai": self.analog, "ctr": self.counter}.get(sort)


def units_of(sensor: Sensor, unit: str, modelled: bool) -> Mapping[str, Quantity | None]:
    """What a sensor can measure of a channel in `unit`, which is free where none of the rig's is meant."""
    if modelled or unit in sensor.units or not (isinstance(sensor, AnalogSensor) and sensor.any_unit):
        return sensor.units
    return {**sensor.units, unit: Quantity(unit, 0, ANY_UP_TO, above=True)}


def declare_voltage(task: Any, channel: CardChannel) -> None:
    """Whatever gives volts: the card measures them, and the sensitivity makes the unit of them."""
    limit_v = channel.range * channel.volts_per_unit
    task.ai_channels.add_ai_voltage_chan(channel.physical, min_val=-limit_v, max_val=limit_v)


def declare_force_iepe(task: Any, channel: CardChannel) -> None:
    """A force sensor with its supply from the card."""
    from nidaqmx.constants import ExcitationSource, ForceIEPESensorSensitivityUnits, ForceUnits

    task.ai_channels.add_ai_force_iepe_chan(
        channel.physical,
        min_val=-channel.range,
        max_val=channel.range,
        units=ForceUnits.NEWTONS,
        sensitivity=channel.sensitivity * 1e3,  # V/N to mV/N
        sensitivity_units=ForceIEPESensorSensitivityUnits.MILLIVOLTS_PER_NEWTON,
        current_excit_source=ExcitationSource.INTERNAL,
        current_excit_val=channel.excitation_a,
    )


def declare_acceleration_iepe(task: Any, channel: CardChannel) -> None:
    """An accelerometer with its supply from the card."""
    from nidaqmx.constants import AccelSensitivityUnits, AccelUnits, ExcitationSource

    task.ai_channels.add_ai_accel_chan(
        channel.physical,
        min_val=-channel.range,
        max_val=channel.range,
        units=AccelUnits.METERS_PER_SECOND_SQUARED,
        sensitivity=channel.sensitivity * STANDARD_GRAVITY * 1e3,  # V per m/s2 to mV/g
        sensitivity_units=AccelSensitivityUnits.MILLIVOLTS_PER_G,
        current_excit_source=ExcitationSource.INTERNAL,
        current_excit_val=channel.excitation_a,
    )


def declare_microphone_iepe(task: Any, channel: CardChannel) -> None:
    """A microphone with its supply from the card."""
    from nidaqmx.constants import ExcitationSource, SoundPressureUnits

    task.ai_channels.add_ai_microphone_chan(
        channel.physical,
        units=SoundPressureUnits.PA,
        mic_sensitivity=channel.sensitivity * 1e3,  # V/Pa to mV/Pa
        max_snd_press_level=20 * log10(channel.range / HEARING_THRESHOLD_PA),
        current_excit_source=ExcitationSource.INTERNAL,
        current_excit_val=channel.excitation_a,
    )


def force_sheet(task: Any, channel: CardChannel) -> float:
    """Sensitivity in V/N by the data sheet in the sensor (TEDS)."""
    from nidaqmx.constants import ForceIEPESensorSensitivityUnits, ForceUnits

    declared = task.ai_channels.add_teds_ai_force_iepe_chan(
        channel.physical,
        min_val=-channel.range,
        max_val=channel.range,
        units=ForceUnits.NEWTONS,
        current_excit_val=channel.excitation_a,
    )
    volts_per_n = {
        ForceIEPESensorSensitivityUnits.MILLIVOLTS_PER_NEWTON: 1e-3,
        ForceIEPESensorSensitivityUnits.MILLIVOLTS_PER_POUND: 1e-3 / LBF,
    }
    one = volts_per_n[declared.ai_force_iepe_sensor_sensitivity_units]
    return float(declared.ai_force_iepe_sensor_sensitivity) * one


def acceleration_sheet(task: Any, channel: CardChannel) -> float:
    """Sensitivity in V per m/s2 by the data sheet in the sensor (TEDS)."""
    from nidaqmx.constants import AccelSensitivityUnits, AccelUnits

    declared = task.ai_channels.add_teds_ai_accel_chan(
        channel.physical,
        min_val=-channel.range,
        max_val=channel.range,
        units=AccelUnits.METERS_PER_SECOND_SQUARED,
        current_excit_val=channel.excitation_a,
    )
    volts_per_m_s2 = {
        AccelSensitivityUnits.MILLIVOLTS_PER_G: 1e-3 / STANDARD_GRAVITY,
        AccelSensitivityUnits.VOLTS_PER_G: 1.0 / STANDARD_GRAVITY,
    }
    return float(declared.ai_accel_sensitivity) * volts_per_m_s2[declared.ai_accel_sensitivity_units]


def declare_encoder(task: Any, channel: CardChannel) -> None:
    """Two tracks in quadrature, and the index mark where the channel has one."""
    from nidaqmx.constants import AngleUnits, EncoderType

    pulses = _pulses(channel)
    task.ci_channels.add_ci_ang_encoder_chan(
        channel.physical,
        decoding_type=EncoderType[f"X_{pulses.decoding}"],
        zidx_enable=pulses.index,
        zidx_val=pulses.counted_from,  # rad, as `units` below says
        units=AngleUnits.RADIANS,
        pulses_per_rev=pulses.per_revolution,
        initial_angle=pulses.counted_from,
    )


def angle_decoder(channel: CardChannel) -> Decoder:
    """Unwrapped angle in rad of what `declare_encoder` counts."""
    pulses = _pulses(channel)
    turn = pulses.counts_per_revolution
    # The index takes whole revolutions off the count, and whatever was lost since; no angle begins below 0.
    lowest = 1 - turn if pulses.backwards else 0
    turns = UnwrappedCount(turn, lowest) if pulses.index else UnwrappedCount()
    return angle(turns, -pulses.rad_per_count if pulses.backwards else pulses.rad_per_count)


def declare_edges(task: Any, channel: CardChannel) -> None:
    """Every rising edge counts."""
    task.ci_channels.add_ci_count_edges_chan(channel.physical)


def declare_frequency(task: Any, channel: CardChannel) -> None:
    """The frequency of the last two pulses, up to that of the channel's range."""
    from nidaqmx.constants import FrequencyUnits

    highest_hz = channel.range / _rad_per_pulse(channel)
    declared = task.ci_channels.add_ci_freq_chan(
        channel.physical, min_val=highest_hz * _SLOWEST, max_val=highest_hz, units=FrequencyUnits.HZ
    )
    # With it DAQmx wants two pulses between any two samples; without, it gives the last pulse's frequency.
    declared.ci_freq_enable_averaging = False


def _pulses(channel: CardChannel) -> Pulses:
    if channel.pulses is None:
        raise ValueError(f"{channel.name} has no pulses")
    return channel.pulses


def _rad_per_pulse(channel: CardChannel) -> float:
    return _pulses(channel).rad_per_count * _pulses(channel).decoding  # one track's pulse: no decoding


def _fed_by_the_card(
    units: Mapping[str, Quantity],
    declare: Callable[[Any, CardChannel], None],
    sheet: Callable[[Any, CardChannel], float] | None = None,
) -> SensorKind:
    takes = ("corner", *_ANY_INPUT)
    return SensorKind(
        AnalogSensor(units, declare, takes=takes, fed=True, in_volts=False, ac_coupled=True, sheet=sheet)
    )


_OWN: Final = {
    "voltage": SensorKind(
        AnalogSensor(
            FORCE | ACCELERATION | VOLTAGE, declare_voltage, takes=("filter", *_ANY_INPUT), any_unit=True
        )
    ),
    "charge_amplifier": SensorKind(
        AnalogSensor(
            FORCE | ACCELERATION,
            declare_voltage,
            needs=(*_VOLTS_EACH, "gain"),
            takes=("amplifier", "filter", *_ANY_INPUT),
            ac_coupled=True,
            any_unit=True,
        )
    ),
    "force_iepe": _fed_by_the_card(FORCE, declare_force_iepe, force_sheet),
    "acceleration_iepe": _fed_by_the_card(ACCELERATION, declare_acceleration_iepe, acceleration_sheet),
    "microphone_iepe": _fed_by_the_card(SOUND, declare_microphone_iepe),
    "encoder": SensorKind(
        counter=CounterSensor(
            {"rad": None},
            declare_encoder,
            ("pulses_per_revolution",),
            "count",
            lambda channel: _pulses(channel).rad_per_count,
            angle_decoder,
            takes=("decoding", "index", "initial_angle", "direction"),
        )
    ),
    "marker": SensorKind(
        AnalogSensor(
            VOLTAGE,
            declare_voltage,
            needs=("range",),
            takes=("sensitivity", "filter", "delay", "angle", "level", "polarity"),
            noisy=False,
        ),
        CounterSensor(
            VOLTAGE,
            declare_edges,
            ("range",),
            "edge",
            lambda _: None,
            lambda channel: MarkPulses(channel.range),
            takes=("angle",),
        ),
    ),
    "tachometer": SensorKind(
        AnalogSensor(SPEED, declare_voltage, takes=("filter", "delay", "inverted")),
        CounterSensor(
            SPEED,
            declare_frequency,
            ("pulses_per_revolution", "range"),
            "Hz",
            _rad_per_pulse,
            lambda channel: speed(_rad_per_pulse(channel)),
            read="read_many_sample_double",
            dtype=np.float64,
        ),
    ),
}
SENSORS: Final = OpenTable(_OWN, "rattle.sensors", SensorKind)


def sensor_of(channel: CardChannel) -> Sensor | None:
    """What is on the input of a channel; None where no such sensor can be."""
    return SENSORS[channel.kind].on(channel.input) if channel.kind in SENSORS else None


def known_sensor(channel: CardChannel) -> Any:
    """The `AnalogSensor` or `CounterSensor` of a channel that has been checked."""
    sensor = sensor_of(channel)
    if sensor is None:
        raise LookupError(f"no {channel.kind} is on {channel.physical}")
    return sensor


def described(channel: CardChannel) -> Channel:
    """Return what a log keeps of a channel, its stages included."""
    sensor = sensor_of(channel)
    stages = (f"{name} {stage.serial}" for name, stage in channel.stages.items() if stage.serial)
    try:
        scale = None if sensor is None else sensor.scale(channel)
    except (ZeroDivisionError, ValueError):
        scale = None  # numbers that cannot be are told when the card is opened
    return Channel(
        name=channel.name,
        unit=channel.unit,
        quantity=channel.quantity,
        location=channel.location,
        sensor=" + ".join([channel.sensor or channel.kind, *channel.stages]),
        serial=", ".join(text for text in (channel.serial, *stages) if text),
        scale=scale,
        raw_unit="" if sensor is None else sensor.raw_unit,
    )
