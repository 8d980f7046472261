"""The search for the middle between two stops, and how a beam is asked at one offset.

A small sine shakes the tip by less than the clearance. With the offset in the middle it touches nothing;
from some offset on it touches the upper stop, from another on the lower one. Whatever the sine's size, the
beam's stiffness or the clearance are, the middle between these two offsets holds the tip in the middle.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from daq.errors import ConfigurationError, Problem, RattleError
from daq.signals.impacts import FAINTEST_N, Levels, contacts_above
from drivers.scpi.settings import GeneratorSettings
from rig.files.bench import Bench
from rig.files.pairing import SOFT_START_FROM_S
from rig.files.scenario import Scenario
from rig.twin.scenario_twin import twin_of
from sim_twin.rigs.impact_beam.structure import resting, tip_response

Touched = Literal["nothing", "upper", "lower", "both"]
_MOST_PROBES: Final = 60
FARTHEST: Final = 10.0
"""Reaches: how far from where it began the search goes."""


class NoCentre(RattleError, RuntimeError):
    """The beam did not answer as one that rests between two stops does; says what to look at."""


@dataclass(frozen=True, slots=True)
class Sine:
    """Amplitude of the sine and the least that it can be, in N."""

    amplitude: float
    least: float


@dataclass(frozen=True, slots=True)
class Middle:
    """The `offset` in N that centres, off by at most `uncertainty`.

    `apart` is the way from one touch to the other, `amplitude` that of the sine in the end, `probes` how many
    offsets were tried.
    """

    offset: float
    uncertainty: float
    apart: float
    amplitude: float
    probes: int


def find_middle(
    touched: Callable[[float, float], Touched],
    sine: Sine,
    reach: float,
    precision: float,
    farthest: float,
) -> Middle:
    """Find the offset in the middle between the two stops by bracketing each touch to `precision` N.

    `touched(offset, amplitude)` says what is touched there. `reach` in N moves the tip by about a clearance;
    no offset beyond +-`farthest` is tried. Raises NoCentre.
    """
    return _Search(touched, sine, reach, precision, min(FARTHEST * reach, farthest), sine.amplitude).middle()


@dataclass(slots=True)
class _Search:
    """Tries offsets up to +-`farthest`; `clear`, `upper` and `lower` are those with that answer."""

    touched: Callable[[float, float], Touched]
    sine: Sine
    reach: float
    precision: float
    farthest: float
    amplitude: float
    probes: int = 0
    clear: list[float] = field(default_factory=list)
    upper: list[float] = field(default_factory=list)
    lower: list[float] = field(default_factory=list)

    def middle(self) -> Middle:
        """The answer, as soon as both touches are known well enough."""
        while (offset := self._next()) is not None:
            self._probe(offset)
        above, below = min(self.upper), max(self.lower)
        clear = self.clear or [(above + below) / 2]
        top, bottom = (max(clear) + above) / 2, (below + min(clear)) / 2
        widths = (above - max(clear)) + (min(clear) - below)
        return Middle((top + bottom) / 2, widths / 4, top - bottom, self.amplitude, self.probes)

    def _probe(self, offset: float) -> None:
        if self.probes >= _MOST_PROBES:
            raise NoCentre(
                f"no middle was found in {_MOST_PROBES} tries: does the beam answer the same twice?"
            )
        self.probes += 1
        touched = self.touched(offset, self.amplitude)
        if touched == "both":
            if self.amplitude <= self.sine.least:
                raise NoCentre("the least sine touches both stops: is the clearance as small as that?")
            # a sine that touches both sides says nothing of the middle
            self.amplitude = max(self.amplitude / 2, self.sine.least)
            self.clear, self.upper, self.lower = [], [], []
            return
        {"nothing": self.clear, "upper": self.upper, "lower": self.lower}[touched].append(offset)
        found = [*self.lower, *self.clear, *self.upper]
        if [*sorted(self.lower), *sorted(self.clear), *sorted(self.upper)] != sorted(found):
            raise NoCentre(
                f"the beam touches {touched} at {offset:.4g} N, which other offsets contradict: is it loose, "
                "or are the two force channels swapped?"
            )

    def _next(self) -> float | None:
        """The next offset to try; None once both touches are known."""
        if not (self.upper or self.lower or self.clear):
            return 0.0
        if not self.upper:
            return self._farther(max([*self.clear, *self.lower]), +1.0, "upper")
        if not self.lower:
            return self._farther(min([*self.clear, *self.upper]), -1.0, "lower")
        above, below = min(self.upper), max(self.lower)
        gaps = [(below, above)]
        if self.clear:
            gaps = [(max(self.clear), above), (below, min(self.clear))]
        low, high = max(gaps, key=lambda gap: gap[1] - gap[0])
        return (low + high) / 2 if high - low > self.precision else None

    def _farther(self, last: float, way: float, side: str) -> float:
        """Half a reach on, then in growing steps."""
        if last * way >= self.farthest:
            raise NoCentre(
                f"nothing touches the {side} stop up to an offset of {last:.4g} N: are its sensor and the "
                "amplifier's DC output in order, is shaker_stiffness in [model] right?"
            )
        return way * min(last * way + max(self.reach / 2, abs(last) / 2), self.farthest)


_SHAKEN: Final = 0.3
"""Of the clearance: how far the sine moves the tip, by the twin."""
_BELOW_RESONANCE: Final = 0.5
"""Of the beam's lowest natural frequency, where its tip follows the force."""
_PRECISE: Final = 0.04
"""Of the force for a clearance: how closely each touch is bracketed, so that 2 % of it are left."""
_STEP_V: Final = 1e-3
"""What a 33220A surely keeps an offset to."""
_LEAST_V: Final = 0.01
_CYCLES: Final = 6
_MOVE_STEPS: Final = 8
_MOVE_S: Final = 0.2
_DECAYS: Final = 3.0
_LONGEST_SETTLE_S: Final = 5.0
_ON_THEIR_WAY_S: Final = 0.2

_LEVELS: Final = Levels(FAINTEST_N, FAINTEST_N / 2)
_CYCLES_WITH: Final = 0.3
"""Share of the sine's cycles with an impact where a stop is touched; a knock on the bench is in one."""
_PRESSED: Final = 0.15
"""Share of the sine's force that a stop feels at its frequency once the tip leans on it, at least; the
lever of the drive point would pass on 0.69. A pick-up of the drive by the sensor's cable is far below."""


class ShakenBeam(Protocol):
    """A beam with a sine and an offset at its drive, in N, and two contact forces."""

    @property
    def sample_rate(self) -> float:
        """Of the forces, Hz."""

    def shake(self, amplitude: float) -> None: ...

    def push(self, offset: float) -> None: ...

    def wait(self, seconds: float) -> None: ...

    def forces(self, seconds: float) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
        """Upper and lower contact force of the next seconds, N, shape (n,)."""


@dataclass(frozen=True, slots=True)
class CentringPlan:
    """What centring would do: `sine` of `frequency` Hz, an offset of up to `farthest` N.

    `reach` is the offset in N that moves the tip by the clearance, `compliance` the tip's way in m for each
    N; `settle_s` passes at each offset.
    """

    frequency: float
    sine: Sine
    reach: float
    compliance: float
    clearance: float
    precision: float
    farthest: float
    settle_s: float

    @property
    def probe_s(self) -> float:
        return _MOVE_S + self.settle_s + _CYCLES / self.frequency

    def rest_offset(self, middle: Middle) -> float:
        """Where a tip rests without an offset, m towards the upper stop, if `middle` centres it."""
        return -self.compliance * middle.offset


def check_centring(scenario: Scenario) -> None:
    """Raise ConfigurationError for a scenario whose rig is centred on no bench."""
    if scenario.rig != "impact_beam":
        problem = Problem("rig", scenario.rig, "impact_beam: no other rests between two stops")
        raise ConfigurationError(scenario.name, [problem])
    if scenario.acquisition.settle < SOFT_START_FROM_S:
        allowed = f"at least {SOFT_START_FROM_S:g} s: a drive with an offset is brought up softly"
        problem = Problem("acquisition.settle", f"{scenario.acquisition.settle:g} s", allowed)
        raise ConfigurationError(scenario.name, [problem])


def plan_of(scenario: Scenario, bench: Bench) -> CentringPlan:
    """The plan for a scenario; raises ConfigurationError where no offset can centre its beam."""
    check_centring(scenario)
    if bench.unseen:
        allowed = "false beside a real generator: by emulated forces the real beam is pushed anywhere"
        raise ConfigurationError(bench.source, [Problem("daq_card.emulated", "true", allowed)])
    if not isinstance(bench.actuator, GeneratorSettings):
        allowed = "[signal_generator]: an offset is searched for in steps that nobody sets by hand"
        raise ConfigurationError(bench.source, [Problem(bench.actuator_table, "(here)", allowed)])
    rig, per_volt = twin_of(scenario).rig, bench.the(GeneratorSettings).force_per_volt
    beam = resting(rig)
    reach, step = rig.clearance / beam.compliance, _STEP_V * per_volt
    if step > _PRECISE * reach:
        allowed = (
            f"so stiff that a step of the generator's offset ({step:.2g} N) moves the tip by at most "
            f"{_PRECISE:.0%} of the clearance, not by {step / reach:.0%}: this beam rests as softly as its "
            "flexure, and no offset holds it; give shaker_stiffness, if the shaker holds it"
        )
        raise ConfigurationError(scenario.name, [Problem("model", f"{1 / beam.compliance:.3g} N/m", allowed)])
    frequency = _BELOW_RESONANCE * beam.frequency
    least = _LEAST_V * per_volt
    amplitude = max(_SHAKEN * rig.clearance / abs(tip_response(rig, frequency)), least)
    settle_s = min(max(_DECAYS * beam.decay_s, 2.0 / frequency), _LONGEST_SETTLE_S)
    farthest = bench.the(GeneratorSettings).maximum_amplitude - amplitude
    return CentringPlan(
        frequency,
        Sine(amplitude, least),
        reach,
        beam.compliance,
        rig.clearance,
        max(_PRECISE * reach, step),
        min(farthest, FARTHEST * reach),
        _ON_THEIR_WAY_S + settle_s,
    )


@dataclass(frozen=True, slots=True)
class Probe:
    """The `number`-th offset that was tried, N, with a sine of `amplitude` N, and what it `touched`."""

    number: int
    offset: float
    amplitude: float
    touched: Touched

    def __str__(self) -> str:
        return f"offset {self.offset:+.4f} N, sine {self.amplitude:.4f} N: touches {self.touched}"


def centre_beam(
    beam: ShakenBeam, plan: CentringPlan, told: Callable[[Probe], None] = lambda probe: None
) -> Middle:
    """Find the offset that holds the tip in the middle; raises NoCentre.

    The offset stays where it was last. `told` hears of each that was tried.
    """
    now, tried = 0.0, 0

    def touched(offset: float, amplitude: float) -> Touched:
        """Go there with the least sine, so that no bouncing is carried along; shake and listen."""
        nonlocal now, tried
        beam.shake(plan.sine.least)
        for step in range(1, _MOVE_STEPS + 1):
            beam.wait(_MOVE_S / _MOVE_STEPS)
            beam.push(now + (offset - now) * step / _MOVE_STEPS)
        now = offset
        beam.shake(amplitude)
        beam.wait(plan.settle_s)
        upper, lower = beam.forces(_CYCLES / plan.frequency)
        tried += 1
        side = what_is_touched(upper, lower, beam.sample_rate, plan.frequency, amplitude)
        told(Probe(tried, offset, amplitude, side))
        return side

    return find_middle(touched, plan.sine, plan.reach, plan.precision, plan.farthest)


def what_is_touched(
    upper: NDArray[np.floating],
    lower: NDArray[np.floating],
    sample_rate: float,
    frequency: float,
    amplitude: float,
) -> Touched:
    """Which side is touched while a sine (Hz, N) shakes the beam.

    Contact forces in N, shape (n,) each, over some cycles. Impacts tell, and the sine itself where the tip
    leans on a stop so gently that no force of a piezoelectric sensor stands out of its noise.
    """
    above, below = (_is_touched(force, sample_rate, frequency, amplitude) for force in (upper, lower))
    if above and below:
        return "both"
    if above or below:
        return "upper" if above else "lower"
    return "nothing"


def load_contact_scan() -> None:
    """Load and compile what looks for contacts; called before anything moves."""
    contacts_above(_LEVELS, np.zeros(1), 1.0)


def _is_touched(force: NDArray[np.floating], sample_rate: float, frequency: float, amplitude: float) -> bool:
    values = np.nan_to_num(np.asarray(force, dtype=np.float64))
    turns = np.arange(len(values), dtype=np.float64) * frequency / sample_rate
    found = contacts_above(_LEVELS, values, sample_rate)
    cycles_with = len(np.unique(turns[found.index].astype(np.intp)))
    if cycles_with >= max(2.0, _CYCLES_WITH * turns[-1]):
        return True
    # complex amplitude of the sine that most of the whole cycles agree on
    begins = np.searchsorted(turns, np.arange(np.floor(turns[-1] + 0.5 / len(turns)) + 1))
    spans = [slice(first, last) for first, last in pairwise(begins)]
    each = [
        2 * np.mean((values[span] - values[span].mean()) * np.exp(-2j * np.pi * turns[span]))
        for span in spans
    ]
    return abs(complex(np.median(np.real(each)), np.median(np.imag(each)))) > _PRESSED * amplitude
