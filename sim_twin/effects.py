"""What an effect is: something that the nominal twin leaves out or has wrong; those of sensors and clocks.

Each rig has its own besides.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from daq.plugins import OpenTable
from daq.quantity import Bound, Quantity
from sim_twin.ranges import require_bounds
from sim_twin.sensors import SensorChain
from sim_twin.twin import AnyTwin, changed

ParameterValues: TypeAlias = Mapping[str, float | str]
Intervals: TypeAlias = tuple[tuple[float, float], ...]
Coordinates: TypeAlias = Callable[[NDArray[np.float64]], NDArray[np.float64]]


@dataclass(frozen=True, slots=True)
class Parameter:
    """A number with its unit and the intervals (ends included) in which a rig may plausibly lie.

    `whole`: where it is guessed, only whole numbers are. One with `words` is one of them instead.
    """

    name: str
    unit: str = ""
    intervals: Intervals = ()
    whole: bool = False
    words: tuple[str, ...] = ()

    @property
    def allowed(self) -> str:
        """The intervals with their unit, or the words, for people."""
        if self.words:
            return f"one of {', '.join(self.words)}"
        ranges = " or ".join(f"{low:g} to {high:g}" for low, high in self.intervals)
        return f"{ranges} {self.unit}".rstrip()

    def holds(self, value: object) -> bool:
        """Whether `value` is allowed."""
        if self.words:
            return value in self.words
        return isinstance(value, float) and any(low <= value <= high for low, high in self.intervals)


@dataclass(frozen=True, slots=True)
class Effect:
    """One cause: its `location`, its parameters (the main one first) and what it changes in a twin.

    `channels` are those that the effect may sit on; empty for effects that sit on none. `refusal` says why
    a twin cannot have it (a friction torque at a clamp), or nothing; `together` what is wrong with parameters
    that are fine one by one. `sensing` effects change what is shown, not what moves. `coordinates` takes
    parameters (n, parameters) to (n, any), in which responses are nearly straight; None: each by itself is.
    """

    name: str
    location: str
    parameters: tuple[Parameter, ...]
    change: Callable[[Any, ParameterValues], Any]
    channels: tuple[str, ...] = ()
    refusal: Callable[[Any], str] = lambda _: ""
    together: Callable[[ParameterValues], str] = lambda _: ""
    sensing: bool = False
    coordinates: Coordinates | None = None

    @property
    def asked(self) -> Mapping[str, Parameter]:
        """All that has to be said of it, by name: its parameters, and the channel that it sits on."""
        channel = (Parameter("channel", words=self.channels),) if self.channels else ()
        return {each.name: each for each in (*self.parameters, *channel)}

    def allows(self, values: ParameterValues) -> bool:
        """Whether parameters that are fine one by one may go together."""
        return not self.together(values)

    def apply(self, twin: AnyTwin, values: ParameterValues) -> AnyTwin:
        """Return `twin` with the effect in; raises ValueError for what it cannot have or be."""
        reason = self.refusal(twin)
        if reason:
            raise ValueError(f"{self.name} does not exist on this rig ({reason})")
        expected = [*(["channel"] if self.channels else []), *(each.name for each in self.parameters)]
        if set(values) != set(expected):
            raise ValueError(f"{self.name} takes exactly {', '.join(expected)}, not {', '.join(values)}")
        if self.channels and values["channel"] not in twin.channels:
            raise ValueError(f"{self.name}: this rig has no channel {values['channel']}")
        if self.channels and values["channel"] not in self.channels:
            raise ValueError(
                f"{self.name} sits on one of {', '.join(self.channels)}, not {values['channel']}"
            )
        for parameter in self.parameters:
            value = float(values[parameter.name])
            if not parameter.holds(value):
                raise ValueError(f"{self.name}.{parameter.name} = {value:g}: {parameter.allowed}")
        wrong = self.together(values)
        if wrong:
            raise ValueError(f"{self.name}: {wrong}")
        try:
            affected: AnyTwin = self.change(twin, values)
        except (TypeError, AttributeError, LookupError) as error:  # another package's effect may be wrong
            raise ValueError(f"{self.name} failed ({type(error).__name__}: {error})") from error
        return affected


@dataclass(frozen=True, slots=True)
class PutIn:
    """Puts a part into a `field` of the twin's rig, made by `kind` of these parameters in their order."""

    field: str
    kind: Callable[..., Any]
    parameters: tuple[str, ...]

    def __call__(self, twin: AnyTwin, values: ParameterValues) -> AnyTwin:
        part = self.kind(*(float(values[name]) for name in self.parameters))
        return replace(twin, rig=replace(twin.rig, **{self.field: part}))


Catalogue: TypeAlias = Mapping[str, Effect]


def catalogue_of(rig: str, effects: Iterable[Effect]) -> Catalogue:
    """The effects of a rig by name, and those that other packages add to it in the group `rattle.effects`."""
    return OpenTable({effect.name: effect for effect in effects}, "rattle.effects", Effect, owner=rig)


@dataclass(frozen=True, slots=True)
class Scaled:
    """Multiplies what stands at `places` in a twin by the parameter `scale`; of a tuple, each number."""

    places: tuple[str, ...]

    def __call__(self, twin: AnyTwin, values: ParameterValues) -> AnyTwin:
        scale = float(values["scale"])

        def times(old: Any) -> Any:
            return tuple(each * scale for each in old) if isinstance(old, tuple) else old * scale

        affected: AnyTwin = changed(twin, {tuple(place.split(".")): times for place in self.places})
        return affected


@dataclass(frozen=True, slots=True)
class SetTo:
    """Sets numbers of a twin, each at its place `rig.field` or `drive.field`, to a parameter."""

    parameters: Mapping[str, Parameter]

    def __call__(self, twin: AnyTwin, values: ParameterValues) -> AnyTwin:
        for place, parameter in self.parameters.items():
            part, field = place.split(".")
            number = float(values[parameter.name])
            twin = replace(twin, **{part: replace(getattr(twin, part), **{field: number})})
        return twin


def set_to(name: str, location: str, parameters: Mapping[str, Parameter]) -> Effect:
    """An effect that sets numbers of a twin to its parameters, by their places: see `SetTo`."""
    return Effect(name, location, tuple(parameters.values()), SetTo(parameters))


def scaled(name: str, location: str, intervals: Intervals, *places: str) -> Effect:
    """An effect that multiplies numbers of a twin at `places` (with dots) by its one parameter, `scale`."""
    return Effect(name, location, (Parameter("scale", "", intervals),), Scaled(places))


@dataclass(frozen=True, slots=True)
class BaseMass:
    """What the rig stands on, as a mass on spring and damper: `frequency` Hz, `mass` kg, `damping_ratio`."""

    frequency: Annotated[float, Quantity("Hz", 10, 10_000), Bound("Hz", 0.0, above=True)]
    mass: Annotated[float, Quantity("kg", 0.01, 10_000), Bound("kg", 0.0, above=True)]
    damping_ratio: Annotated[float, Quantity("", 0.0001, 0.5, key="damping"), Bound("", 0.0, 1.0)]

    def __post_init__(self) -> None:
        require_bounds("BaseMass", self)


def base_flexibility() -> Effect:
    """What the rig stands on gives."""
    return Effect(
        "base_flexibility",
        "base",
        (
            Parameter("frequency_hz", "Hz", ((150.0, 1500.0),)),
            Parameter("mass_kg", "kg", ((0.5, 8.0),)),
            Parameter("damping_ratio", "", ((0.003, 0.05),)),
        ),
        PutIn("base", BaseMass, ("frequency_hz", "mass_kg", "damping_ratio")),
        refusal=lambda twin: "" if twin.rig.base is None else "its base is flexible already",
    )


@dataclass(frozen=True, slots=True)
class _OfChain:
    """Changes a `field` of the analog chain that the effect sits on: multiplied, shifted, or set."""

    field: str
    parameter: str

    def __call__(self, twin: AnyTwin, values: ParameterValues) -> AnyTwin:
        channel, number = str(values["channel"]), float(values[self.parameter])
        chain = twin.sensors.get(channel, SensorChain())
        if not isinstance(chain, SensorChain):
            raise ValueError(f"{channel} is not an analog channel")
        number = {
            "gain": chain.gain * number,
            "factor": chain.factor * number,
            "skew": chain.skew + number,
        }.get(self.field, number)
        return replace(
            twin,
            sensors={**twin.sensors, channel: replace(chain, **{self.field: number})},  # type: ignore[arg-type]
        )


def _on_a_channel(
    name: str, location: str, parameter: Parameter, field: str, channels: tuple[str, ...]
) -> Effect:
    change = _OfChain(field, parameter.name)
    return Effect(name, location, (parameter,), change, channels, sensing=True)


def sensor_gain(channels: tuple[str, ...]) -> Effect:
    """The channel's values are multiplied."""
    parameter = Parameter("gain", "", ((0.5, 0.92), (1.08, 2.0)))
    return _on_a_channel("sensor_gain", "sensor", parameter, "gain", channels)


def sensor_factor(channels: tuple[str, ...]) -> Effect:
    """A sensitivity that is off by ten, or a sensor or cable the wrong way round."""
    parameter = Parameter("factor", "", ((-1.05, -0.95), (0.095, 0.105), (9.5, 10.5)))
    return _on_a_channel("sensor_factor", "sensor", parameter, "factor", channels)


def sensor_droop(channels: tuple[str, ...]) -> Effect:
    """A first-order high-pass: the time constant of a charge amplifier."""
    parameter = Parameter("corner_hz", "Hz", ((0.3, 10.0),))
    return _on_a_channel("sensor_droop", "sensor", parameter, "droop_corner", channels)


def sensor_bandwidth(channels: tuple[str, ...]) -> Effect:
    """A second-order Butterworth low-pass before the anti-alias filter."""
    parameter = Parameter("corner_hz", "Hz", ((800.0, 8000.0),))
    return _on_a_channel("sensor_bandwidth", "sensor", parameter, "bandwidth_corner", channels)


def time_skew(channels: tuple[str, ...]) -> Effect:
    """The channel shows x(t - seconds)."""
    parameter = Parameter("seconds", "s", ((-2e-3, -5e-5), (5e-5, 2e-3)))
    return _on_a_channel("time_skew", "clock", parameter, "skew", channels)


@dataclass(frozen=True, slots=True)
class _AnalogLate:
    """Every analog channel is late against the encoder."""

    def __call__(self, twin: AnyTwin, values: ParameterValues) -> AnyTwin:
        late = float(values["seconds"])
        chains = {name: twin.sensors.get(name, SensorChain()) for name in twin.channels}
        analog = {
            name: replace(each, skew=each.skew + late)
            for name, each in chains.items()
            if isinstance(each, SensorChain)
        }
        return replace(twin, sensors={**twin.sensors, **analog})


def analog_delay() -> Effect:
    """All analog channels show x(t - seconds): the delay of a card, or an encoder that is early."""
    parameter = Parameter("seconds", "s", ((-2e-3, -5e-5), (5e-5, 2e-3)))
    return Effect("analog_delay", "clock", (parameter,), _AnalogLate(), sensing=True)


@dataclass(frozen=True, slots=True)
class _Swapped:
    """Two of `channels` show each other's sensors: one, and the `other`-th one after it."""

    channels: tuple[str, ...]

    def __call__(self, twin: AnyTwin, values: ParameterValues) -> AnyTwin:
        one = str(values["channel"])
        other = self.channels[(self.channels.index(one) + int(values["other"])) % len(self.channels)]
        swapped = {}
        for name, source in ((one, other), (other, one)):
            chain = twin.sensors.get(name, SensorChain())
            if not isinstance(chain, SensorChain):
                raise ValueError(f"{name} is not an analog channel")
            swapped[name] = replace(chain, source=source)
        return replace(twin, sensors={**twin.sensors, **swapped})


def swapped_channels(channels: tuple[str, ...]) -> Effect:
    """The sensors of a channel and of the `other`-th one after it among these, in a ring, are swapped."""
    parameter = Parameter("other", "", ((1.0, len(channels) - 1.0),), whole=True)
    return Effect("swapped_channels", "sensor", (parameter,), _Swapped(channels), channels, sensing=True)
