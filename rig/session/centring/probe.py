"""How a beam is asked at one offset: moved there gently, left to settle, shaken for some cycles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from daq.errors import ConfigurationError, Problem
from daq.signals.impacts import FAINTEST_N, Levels, contacts_above
from rig.files.bench import Bench
from rig.files.pairing import SOFT_START_FROM_S
from rig.files.scenario import Scenario
from rig.session.centring.search import FARTHEST, Middle, Sine, Touched, find_middle
from rig.twin.scenario_twin import twin_of
from sim_twin.rigs.impact_beam.at_rest import resting, tip_response

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
        ...

    def shake(self, amplitude: float) -> None:
        """Set the sine's amplitude."""
        ...

    def push(self, offset: float) -> None:
        """Set the offset."""
        ...

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        ...

    def forces(self, seconds: float) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
        """Upper and lower contact force of the next seconds, N, shape (n,)."""
        ...


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
        """How long an offset takes."""
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
    rig, per_volt = twin_of(scenario).rig, bench.signal_generator.force_per_volt
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
    farthest = bench.signal_generator.maximum_amplitude - amplitude
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
    return abs(_sine_of(values, turns)) > _PRESSED * amplitude


def _sine_of(values: NDArray[np.float64], turns: NDArray[np.float64]) -> complex:
    """Complex amplitude of the sine that most of the whole cycles agree on."""
    begins = np.searchsorted(turns, np.arange(np.floor(turns[-1] + 0.5 / len(turns)) + 1))
    spans = [slice(first, last) for first, last in pairwise(begins)]
    each = [
        2 * np.mean((values[span] - values[span].mean()) * np.exp(-2j * np.pi * turns[span]))
        for span in spans
    ]
    return complex(np.median(np.real(each)), np.median(np.imag(each)))
