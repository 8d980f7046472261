"""Another version beside this one: processor time for a second more of prediction, recording and replay.

Both run the same commands, turn about, on the same files. The time of a short run is taken from that of a
long one, so that neither the start nor the end counts. All processes count, emulators too.
Returns 1 if the median of the ratios of any command is above 1.03.

Usage: python -m benchmarks.versions CHECKOUT [--rounds N] [--only NAME ...], where CHECKOUT is a folder with
the other version, set up (`git worktree add FOLDER COMMIT`, then `scripts/setup` in it).
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).parents[1]
BAR = 1.03
CHANNELS = """\
rig = "impact_beam"
[drive]
frequency = "20 Hz"
amplitude = "9 N"
"""
ROTATION = """\
rig = "{rig}"
[drive]
speed = "{speed}"
"""
ACQUISITION = """\
[acquisition]
sample_rate = "51.2 kHz"
settle = "0.5 s"
duration = "{seconds} s"
"""


@dataclass(frozen=True, slots=True)
class Work:
    """A command for a record of `seconds`, short and long."""

    scenario: str
    seconds: tuple[float, float]
    arguments: Callable[[Path, Path], list[object]]
    """Of the scenario and of a folder that is new."""


def predict(scenario: Path, folder: Path) -> list[object]:
    return ["predict", scenario, "--out", folder / "predicted.mcap"]


def record(scenario: Path, folder: Path) -> list[object]:
    return ["run", scenario, "--out", folder]


def replay(scenario: Path, _: Path) -> list[object]:
    return ["replay", scenario.with_suffix(".mcap"), "--speed", "0"]


WORK = {
    "beam predicted": Work(CHANNELS, (5.0, 305.0), predict),
    "planar crank predicted": Work(
        ROTATION.format(rig="planar_slider_crank", speed="200 rpm"), (2.0, 152.0), predict
    ),
    "spatial crank predicted": Work(
        ROTATION.format(rig="spatial_slider_crank", speed="230 rpm"), (1.0, 31.0), predict
    ),
    "beam recorded": Work(CHANNELS, (3.0, 23.0), record),
    "beam replayed": Work(CHANNELS, (3.0, 23.0), replay),
}


def processor_s(checkout: Path, arguments: list[object]) -> float:
    """User and system time of a command and of all that it started and waited for."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(  # noqa: S603
        [checkout / ".venv/bin/rattle", *map(str, arguments)],
        cwd=checkout,
        env={**os.environ, "NUMBA_NUM_THREADS": "1"},
        check=True,
        stdout=subprocess.DEVNULL,
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def cost(work: Work, checkout: Path, scenarios: list[Path]) -> float:
    """Processor seconds for a second more of the record."""
    times = []
    for scenario in scenarios:
        with tempfile.TemporaryDirectory() as folder:
            times.append(processor_s(checkout, work.arguments(scenario, Path(folder))))
    return (times[1] - times[0]) / (work.seconds[1] - work.seconds[0])


def written(name: str, work: Work, other: Path, folder: Path) -> list[Path]:
    """The two scenarios; what is replayed is recorded by the other version, for both."""
    scenarios = []
    for seconds in work.seconds:
        scenario = folder / f"{name.replace(' ', '_')}_{seconds:.0f}.toml"
        scenario.write_text(work.scenario + ACQUISITION.format(seconds=seconds))
        if work.arguments is replay:
            recorded = folder / scenario.stem
            processor_s(other, record(scenario, recorded))
            (log,) = recorded.glob("*.mcap")
            log.rename(scenario.with_suffix(".mcap"))
        scenarios.append(scenario)
    return scenarios


def compare(name: str, work: Work, other: Path, rounds: int) -> float:
    """The median of the ratios of this version to the other, turn about; a first round fills caches."""
    with tempfile.TemporaryDirectory() as folder:
        scenarios = written(name, work, other, Path(folder))
        for checkout in (other, HERE):
            cost(work, checkout, scenarios)
        costs = [(cost(work, HERE, scenarios), cost(work, other, scenarios)) for _ in range(rounds)]
    ratios = [this / that for this, that in costs]
    middle = statistics.median(ratios)
    this, that = (statistics.median(each) * 1e3 for each in zip(*costs, strict=True))
    print(
        f"{name}: {this:.2f} ms a second here, {that:.2f} ms there; ratio {middle:.3f}"
        f" ({min(ratios):.3f} to {max(ratios):.3f}; bar {BAR})",
        flush=True,
    )
    return middle


def main() -> int:
    """Compare, and return 1 if anything takes longer here."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("checkout", type=Path, help="folder with the other version, set up")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--only", nargs="*", choices=WORK, default=list(WORK))
    given = parser.parse_args()
    ratios = [compare(name, WORK[name], given.checkout.resolve(), given.rounds) for name in given.only]
    return int(max(ratios) > BAR)


if __name__ == "__main__":
    raise SystemExit(main())
