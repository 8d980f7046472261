"""Whether the answers agree on every processor: the same questions to other kernels and other machine code.

OpenBLAS has kernels for many processors and numba can compile for older ones, so one machine can calculate as
others would: `OPENBLAS_CORETYPE`, `NUMBA_CPU_NAME`, numpy's own vector code, one BLAS thread or two.
Structures and first peaks are compared under every combination: frequencies, compliances, times and forces
entry by entry, modes relative to the largest entry of their row. Diagnoses are compared under three that
share nothing. `--tests` runs the numerical tests under nine, every kernel with every code and threads
alternating, and twice with the last bits of every motion moved; those that run alone are left out.

Usage: python -m benchmarks.processors [--samples FOLDER] [--tests]
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from sim_twin.diagnosis.cause import Cause
from sim_twin.diagnosis.subject import Draw, Observed

BARS = {"structures": 1e-10, "first_peaks": 1e-6}
PROBABILITY_BAR = 0.05
_TOGETHER = 8  # rigs simulated at once
_PYTEST = (sys.executable, "-m", "pytest", "-q", "-n", "auto", "--dist", "loadfile")
_OF_TWO_PROCESSES = (
    "tests/sim_twin/ensembles/test_simulate.py::test_a_worker_process_gives_the_bits_of_this_one"
)
"""Last bits are moved in one of them."""
_NUMERICAL = ("tests/sim_twin", "tests/daq", "tests/rig")
_NEWER_THAN = {
    "Nehalem": ("X86_V3", "X86_V4", "AVX512_ICL", "AVX512_SPR"),
    "Haswell": ("X86_V4", "AVX512_ICL", "AVX512_SPR"),
    "SkylakeX": ("AVX512_ICL", "AVX512_SPR"),
}
"""Vector code of numpy that a processor of that kernel does not have."""


@dataclass(frozen=True, slots=True)
class Processor:
    """What stands for one: kernel of OpenBLAS, target of numba, threads of OpenBLAS."""

    kernel: str
    code: str
    threads: int

    def __str__(self) -> str:
        return f"{self.kernel}, {self.code}, {self.threads} thread{'s' * (self.threads > 1)}"

    def environment(self) -> dict[str, str]:
        """The variables of a process that calculates as this one would."""
        given = {name: value for name, value in os.environ.items() if name != "NUMBA_CPU_NAME"}
        given |= {"OPENBLAS_CORETYPE": self.kernel, "OPENBLAS_NUM_THREADS": str(self.threads)}
        given["NPY_DISABLE_CPU_FEATURES"] = " ".join(
            each for each in _NEWER_THAN.get(self.kernel, ()) if _has_vector_code(each)
        )
        # no features of its own: numba would add those of the host to the name
        named = {"NUMBA_CPU_NAME": self.code, "NUMBA_CPU_FEATURES": ""}
        return given if self.code == "host" else {**given, **named}


def _has_vector_code(feature: str) -> bool:
    """Raise KeyError for a feature that numpy does not know: its names change from version to version."""
    from numpy._core._multiarray_umath import __cpu_features__  # type: ignore[import-not-found]

    return bool(__cpu_features__[feature])


EVERY = [
    Processor(*each)
    for each in product(("Nehalem", "Haswell", "SkylakeX"), ("generic", "haswell", "host"), (1, 2))
]
APART = [
    Processor("Nehalem", "generic", 1),
    Processor("Haswell", "haswell", 2),
    Processor("SkylakeX", "host", 1),
]
PAIRS = [
    Processor(kernel, code, 1 + number % 2)
    for number, (kernel, code) in enumerate(
        product(("Nehalem", "Haswell", "SkylakeX"), ("generic", "haswell", "host"))
    )
]
"""Three of each in a row, so that threads alternate along kernels and along codes."""


def structures() -> dict[str, list[float]]:
    """Compliance, natural frequencies, and modes at drive, tip, pivot and sensors of beams and bases."""
    from sim_twin.effects import BaseMass
    from sim_twin.rigs.impact_beam.base.model import flexible_base
    from sim_twin.rigs.impact_beam.model import FLEXURE_TRANSLATION, nominal
    from sim_twin.rigs.impact_beam.structure import resting, structure_of

    steel = nominal()
    shaker: dict[str, Any] = {"shaker_mass": 0.02, "shaker_stiffness": 3e3, "shaker_damping": 20.0}
    rigs = {
        "steel beam": steel,
        "steel beam, flexure that translates": replace(steel, pivot_stiffness=FLEXURE_TRANSLATION),
        "steel beam on a shaker": replace(steel, **shaker),
        "aluminium beam": nominal("aluminium"),
        "yoke on a mass": replace(steel, base=BaseMass(420.0, 1.5, 0.02)),
        "flexible base": replace(steel, base=flexible_base()),
        "flexible base, shaker": replace(steel, base=flexible_base(), **shaker),
        "flexible base, clamped beam": replace(nominal("aluminium"), base=flexible_base()),
        "flexible base, aluminium cover": replace(steel, base=flexible_base("aluminium")),
        "flexible base, fibreglass cover": replace(steel, base=flexible_base("fibreglass")),
    }
    found = {}
    for name, rig in rigs.items():
        s = structure_of(rig)
        found[f"{name}: compliance"] = [resting(rig).compliance]
        found[f"{name}: frequencies"] = list(np.sqrt(np.diag(s.K)) / (2 * np.pi))
        for row in ("drive", "contact", "rotation", "base"):
            if getattr(s, row) is not None:
                found[f"{name}: modes at {row}"] = list(getattr(s, row))
        for number, accelerometer in enumerate(s.cover):
            found[f"{name}: modes at cover {number + 1}"] = list(accelerometer)
    return found


def first_peaks() -> dict[str, list[float]]:
    """Time (s) and force (N) of the very first contacts, before chaos acts, of all three rigs."""
    from benchmarks.reference_values import RATE, TABLE, first_contact
    from sim_twin.rigs.crank_drive import SpeedDrive
    from sim_twin.rigs.planar_slider_crank import model as planar
    from sim_twin.rigs.planar_slider_crank.motion import simulation as of_planar
    from sim_twin.rigs.spatial_slider_crank.model import SpatialSliderCrank
    from sim_twin.rigs.spatial_slider_crank.motion import simulation as of_spatial

    found = {f"beam, {row.frequency} Hz, {row.g_mm} mm": list(first_contact(row, RATE)) for row in TABLE}
    crank = of_planar(planar.nominal(), SpeedDrive(200 * np.pi / 30), 0.0, 0.01)
    spatial = of_spatial(SpatialSliderCrank(), SpeedDrive(230 * np.pi / 30), 0.0, 0.03)
    for name, motion, contacts in (
        ("planar crank, joint", crank, (0, 1)),
        ("spatial crank, socket", spatial, (8,)),
    ):
        episodes = motion.advance(2).episodes
        for contact in contacts:
            first = episodes[episodes[:, 1] == contact][0]
            found[f"{name} {contact + 1}"] = [first[0], first[3]]
    return found


def diagnosis(log: Path, budget_s: float = 60.0, seed: int = 1) -> dict[str, Any]:
    """Verdict, selected effects and probabilities for a recorded run; nothing is cut short."""
    from rig.diagnosis.recordings import recorded
    from sim_twin.diagnosis.diagnose import diagnose, effort_for

    data = recorded([log])
    effort = effort_for(data.campaign, budget_s)

    def execute(draws: Sequence[Draw]) -> list[Observed]:
        pieces = (draws[first : first + _TOGETHER] for first in range(0, len(draws), _TOGETHER))
        return [each for piece in pieces for each in data.campaign.observe(piece)]

    findings = diagnose(data.campaign, data.measured, effort, execute, seed)
    probabilities = {_name(each.cause): each.probability for each in findings.judged}
    return {
        "verdict": findings.verdict,
        "selected": sorted(_name(cause) for cause in findings.selected),
        "probabilities": probabilities | {"none": findings.none, "unknown": findings.unknown},
    }


def _name(cause: Cause) -> str:
    return cause.name if cause.channel is None else f"{cause.name} on {cause.channel}"


def _by(processors: list[Processor], *question: str) -> list[Any]:
    command = [sys.executable, "-m", "benchmarks.processors", "--answer", *question]

    def answer(processor: Processor) -> Any:
        asked = subprocess.run(command, env=processor.environment(), check=True, stdout=subprocess.PIPE)  # noqa: S603
        return json.loads(asked.stdout)

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(answer, processors))


def _compare(name: str, processors: list[Processor]) -> bool:
    print(f"{name}: asking {len(processors)} processors, some seconds to a minute each", flush=True)
    answers = _by(processors, name)
    print(f"{name}: largest relative difference of {len(processors)} processors (bar {BARS[name]:.0e})")
    worst = 0.0
    for key in answers[0]:
        values = np.array([answer[key] for answer in answers])
        # the entries of a mode have a scale in common, two frequencies or a time and a force have not
        size = np.abs(values[0])
        scale = np.maximum(size.max() if ": modes at " in key else size, 1e-300)
        apart = float(np.max(np.ptp(values, axis=0) / scale))
        worst = max(worst, apart)
        print(f"  {apart:8.1e}  {key}")
    print(f"{name}: {worst:.1e} at worst, {'holds' if worst <= BARS[name] else 'DOES NOT HOLD'}", flush=True)
    return worst <= BARS[name]


def _logs(samples: Path) -> list[Path]:
    return sorted(samples.glob("*.mcap"))


def _compare_diagnoses(samples: Path) -> bool:
    holds = True
    for log in _logs(samples):
        answers = _by(APART, str(log))
        same = len({(each["verdict"], tuple(each["selected"])) for each in answers}) == 1
        names = {name for each in answers for name in each["probabilities"]}
        shares = np.array(
            [[each["probabilities"].get(name, 0.0) for name in sorted(names)] for each in answers]
        )
        apart = float(np.ptp(shares, axis=0).max())
        holds &= same and apart <= PROBABILITY_BAR
        for processor, each in zip(APART, answers, strict=True):
            likely = sorted(each["probabilities"].items(), key=lambda item: -item[1])[:3]
            text = ", ".join(f"{name} {share:.3f}" for name, share in likely)
            print(f"  {log.stem}, {processor}: {each['verdict']} {each['selected']}; {text}")
        answer = "the same" if same else "NOT THE SAME"
        print(f"  {log.stem}: {answer}, probabilities {apart:.3f} apart (bar {PROBABILITY_BAR})")
    return holds


def _run_tests() -> bool:
    holds = True
    for processor in PAIRS:
        print(f"tests as on {processor}", flush=True)
        command = [*_PYTEST, "--part", "others", *_NUMERICAL]
        holds &= subprocess.run(command, env=processor.environment(), check=False).returncode == 0  # noqa: S603
    for seed in ("1", "2"):
        print(f"tests with last bits moved, seed {seed}", flush=True)
        moved = [*_PYTEST, "-p", "tests.last_bits", f"--deselect={_OF_TWO_PROCESSES}", "tests/sim_twin"]
        given = {**os.environ, "LAST_BITS": seed}
        holds &= subprocess.run(moved, env=given, check=False).returncode == 0  # noqa: S603
    return holds


_ANSWERS: dict[str, Callable[[], Any]] = {"structures": structures, "first_peaks": first_peaks}


def main() -> int:
    """Compare, and return 1 if anything lies further apart than its bar."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--samples", type=Path, help="a folder of recorded runs to diagnose")
    parser.add_argument("--tests", action="store_true", help="run the numerical tests under each")
    parser.add_argument("--answer", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.answer:
        answer = _ANSWERS[given.answer]() if given.answer in _ANSWERS else diagnosis(Path(given.answer))
        json.dump(answer, sys.stdout)
        return 0
    if given.samples and not _logs(given.samples):
        parser.error(f"no recorded runs (*.mcap) in {given.samples}")
    holds = [_compare("structures", EVERY), _compare("first_peaks", EVERY)]
    if given.samples:
        holds.append(_compare_diagnoses(given.samples))
    if given.tests:
        holds.append(_run_tests())
    return 0 if all(holds) else 1


if __name__ == "__main__":
    sys.exit(main())
