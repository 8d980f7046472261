"""The five statements of Deck and Dubowsky about their spatial slider-crank, on the twin of it.

With --around also with each chosen value 10 % up and down. Source: seed 000 section 4 (figures 16, 17 and
text). An impact is an onset at a vertical point of the guide (3, 4, 7, 8) at 1 cm/s or more; a cycle is one
turn of the crank. Near their onset impacts hang on start and last bit: they are counted from six starts.

Usage: python -m benchmarks.spatial_statements [--around both|down|up] [--cycles N]
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import pi

import numpy as np

from sim_twin.mechanisms.run import APPROACH, CONTACT, ONSET
from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.rigs.spatial_slider_crank.model import SpatialSliderCrank, rig_of_the_figures
from sim_twin.rigs.spatial_slider_crank.motion import simulation
from sim_twin.status import Status

VERTICAL = (2, 3, 6, 7)
RATE, IMPACT = 51_200, 0.01
QUIET, EDGE, LOUD = (110, 130, 138, 142, 144, 146), (148, 149, 150, 151, 152), (156, 170, 200)
STARTS = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0)
"""Crank angles from which it sets out, rad."""


@dataclass(frozen=True, slots=True)
class Cycles:
    """`peaks` (8, cycles) of the points in N, impacts a cycle, contacts (onset s, point, approach m/s)."""

    peaks: np.ndarray
    impacts: float
    contacts: np.ndarray


def cycles(rig: SpatialSliderCrank, rpm: float, count: int, settle: int = 8, start: float = 0.0) -> Cycles:
    """`count` turns of the crank after the first `settle`, from crank angle `start` (rad)."""
    turn = round(60 / rpm * RATE)
    motion = simulation(rig, SpeedDrive(rpm * 2 * pi / 60), start, 60 / rpm / turn)
    before = motion.advance(turn * settle)
    trace = motion.advance(turn * count)
    if trace.status is not Status.COMPLETED:
        raise SystemExit(f"{rig} at {rpm} rpm: {trace.status.advice}")
    peaks = trace.outputs[:8].reshape(8, count, turn).max(axis=2)
    hits = trace.episodes
    strong = np.isin(hits[:, CONTACT], VERTICAL) & (hits[:, APPROACH] >= IMPACT)
    every = np.concatenate([before.episodes, hits])[:, [ONSET, CONTACT, APPROACH]]
    return Cycles(peaks, np.count_nonzero(strong) / count, every)


def from_starts(rig: SpatialSliderCrank, rpm: float, count: int) -> np.ndarray:
    """Impacts a cycle from each start, (starts,); the count of cycles is shared between them."""
    each = max(2, count // len(STARTS))
    return np.array([cycles(rig, rpm, each, settle=16, start=start).impacts for start in STARTS])


def first(rig: SpatialSliderCrank, count: int) -> tuple[bool, str]:
    """Impacts in the guide begin between 150 and 200 rpm."""
    found = {rpm: from_starts(rig, rpm, count) for rpm in (*QUIET, *EDGE, *LOUD)}
    text = ", ".join(
        f"{rpm} rpm {np.mean(each):.1f} from {np.mean(each > 0):.0%}" for rpm, each in found.items()
    )
    quiet = all(found[rpm].max() < 1 for rpm in QUIET)
    return quiet and all(
        found[rpm].min() > 1 for rpm in LOUD
    ), f"impacts a cycle, from that share of starts: {text}"


def second(rig: SpatialSliderCrank, count: int) -> tuple[bool, str]:
    """At 230 rpm the peak of a cycle at a vertical point varies, in the source between 27 and 80 N."""
    peaks = cycles(rig, 230, count).peaks[list(VERTICAL)]
    low, high = peaks.min(axis=1), peaks.max(axis=1)
    points = ", ".join(
        f"force_{p + 1} {a:.0f}-{b:.0f} N" for p, a, b in zip(VERTICAL, low, high, strict=True)
    )
    near = np.any((low > 27 / 2) & (low < 27 * 2) & (high > 80 / 2) & (high < 80 * 2))
    return bool(near), points


def third(rig: SpatialSliderCrank, count: int) -> tuple[bool, str]:
    """Where there are no impacts, peaks repeat from cycle to cycle."""
    spread = {}
    for rpm in (110, 230):
        peaks = cycles(rig, rpm, count).peaks[2]
        spread[rpm] = (peaks.max() - peaks.min(), peaks.mean())
    text = ", ".join(f"{rpm} rpm {mean:.1f} N, range {span:.1f} N" for rpm, (span, mean) in spread.items())
    return spread[110][0] < 0.05 * spread[230][0], f"peaks of force_3: {text}"


def fourth(rig: SpatialSliderCrank, count: int) -> tuple[bool, str]:
    """Without sliding friction there are no impacts under some conditions that give some with it."""
    found = []
    for rpm in (148, 150, 151, 152, 154):
        with_it, without = (
            float(from_starts(replace(rig, friction=mu), rpm, count).mean()) for mu in (rig.friction, 0.0)
        )
        found.append((with_it - without if without < 0.5 else 0.0, rpm, with_it, without))
    _, rpm, with_it, without = max(found)
    holds = with_it >= 1 and without < 0.5
    return holds, f"at {rpm} rpm {with_it:.1f} impacts a cycle with friction, {without:.1f} without"


def fifth(rig: SpatialSliderCrank, count: int) -> tuple[bool, str]:
    """Moving the contact points by 5e-10 m changes the times of impact."""
    moved = replace(rig, contact_span=rig.contact_span + 5e-10)
    one, other = (cycles(each, 230, max(2, count // 8), settle=0).contacts for each in (rig, moved))
    n = min(len(one), len(other))
    late = np.abs(one[:n, 0] - other[:n, 0]) > 1e-4
    if not late.any():
        return False, f"no contact moved by 0.1 ms in {one[n - 1, 0]:.2f} s"
    return True, f"onsets differ by more than 0.1 ms from {one[np.argmax(late), 0]:.2f} s on"


STATEMENTS = (first, second, third, fourth, fifth)


def neighbours(
    rig: SpatialSliderCrank, factors: tuple[float, ...]
) -> Iterator[tuple[str, SpatialSliderCrank]]:
    """The rig with each chosen value 10 % up and down; the pin's place by a tenth of the points' distance."""
    slider = rig.slider
    for factor in factors:
        about = "-10 %" if factor < 1 else "+10 %"
        yield f"slider mass {about}", replace(rig, slider=replace(slider, mass=factor * slider.mass))
        inertia = (factor * slider.inertia[0], factor * slider.inertia[1], factor * slider.inertia[2])
        yield f"slider inertia {about}", replace(rig, slider=replace(slider, inertia=inertia))
        shift = (factor - 1) * rig.contact_span
        yield (
            f"pin {1e3 * shift:+.1f} mm along the guide",
            replace(rig, slider=replace(slider, pin=(shift, 0.0, 0.0))),
        )
        yield (
            f"pin {1e3 * shift:+.1f} mm above it",
            replace(rig, slider=replace(slider, pin=(0.0, 0.0, shift))),
        )
        for name in ("contact_span", "contact_offset", "friction", "modal_damping", "incline", "roll"):
            yield f"{name} {about}", replace(rig, **{name: factor * getattr(rig, name)})


def report(rig: SpatialSliderCrank, count: int) -> None:
    """Print statement by statement."""
    for number, statement in enumerate(STATEMENTS, 1):
        holds, text = statement(rig, count)
        print(
            f"  ({number}) {'holds' if holds else 'FAILS'}  {statement.__doc__}\n        {text}", flush=True
        )


def main() -> None:
    """Print the statements, and with --around which of them hold in the neighbourhood."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--around", choices=("both", "down", "up"))
    arguments.add_argument("--cycles", type=int, default=38)
    chosen = arguments.parse_args()
    rig = rig_of_the_figures()
    report(rig, chosen.cycles)
    if chosen.around:
        for name, other in neighbours(rig, {"both": (0.9, 1.1), "down": (0.9,), "up": (1.1,)}[chosen.around]):
            holds = [statement(other, chosen.cycles // 2)[0] for statement in STATEMENTS]
            print(
                f"{name:32s}",
                " ".join(str(n) if good else "-" for n, good in enumerate(holds, 1)),
                flush=True,
            )


if __name__ == "__main__":
    main()
