"""Another version beside this one: processor time for a second more of prediction, recording and replay.

Both run the same commands, turn about, on the same files. The time of a short run is taken from that of a
long one, so that neither the start nor the end counts. All processes count, emulators too.
`acquisition` is a run of sixteen channels between the begin and the end of its record, without the report;
`acquisition alone` its own process, without emulators, twin, derivation and supervisor.
`diagnosed` is the time, not of the processor, that `rattle diagnose` takes for three runs with an effect,
or two, hidden in them, at its usual effort, with nothing kept of what was simulated before.
What is `diagnosed` is looked at only where it is asked for: its bar is one against 474bf0b.
Returns 1 if the median of the ratios of any command is above 1.03, of an acquisition above 1.1, of what is
`diagnosed` above a third, of which the longest here may not be above a third of the longest there, either.

Usage: python -m benchmarks.versions OTHER [--rounds N] [--only NAME ...], where OTHER is a commit, which is
checked out and set up for it, or a folder where that is done.
"""

from __future__ import annotations

import argparse
import os
import re
import resource
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import psutil

HERE = Path(__file__).parents[1]
SIXTEEN = HERE / "scenarios" / "impact_beam_sixteen_channels.toml"
BAR = 1.03
ACQUISITION_BAR = 1.1
DIAGNOSED_BAR = 1 / 3
_RECORD_S = 20.0
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


EMULATION = """\
[emulation]
effects = "hidden.json"
seed = 7
"""


@dataclass(frozen=True, slots=True)
class Campaign:
    """Runs of so many `seconds` whose rig has an effect `hidden` in it; a scenario for each."""

    scenarios: tuple[str, ...]
    seconds: float
    hidden: str


DIAGNOSED = {
    "beam diagnosed": Campaign(
        tuple(CHANNELS.replace("20 Hz", f"{hertz} Hz") for hertz in (12, 20, 30)),
        6.0,
        '[{"name": "base_flexibility", "parameters": {"frequency_hz": 420.0, "mass_kg": 1.5, '
        '"damping_ratio": 0.02}}]',
    ),
    "beam with two diagnosed": Campaign(
        tuple(CHANNELS.replace("20 Hz", f"{hertz} Hz") for hertz in (12, 20, 30)),
        6.0,
        '[{"name": "contact_stiffness", "parameters": {"scale": 0.5}}, '
        '{"name": "sensor_gain", "parameters": {"channel": "yoke.force", "gain": 1.4}}]',
    ),
    "planar crank diagnosed": Campaign(
        tuple(ROTATION.format(rig="planar_slider_crank", speed=f"{rpm} rpm") for rpm in (150, 200, 250)),
        8.0,
        '[{"name": "contact_stiffness", "parameters": {"scale": 0.5}}]',
    ),
}


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


ALONE = "acquisition alone"
NAMES = [*WORK, "acquisition", ALONE, *DIAGNOSED]


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


def cost(work: Work, scenarios: list[Path], checkout: Path) -> float:
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


def while_recording(checkout: Path, alone: bool) -> float:
    """Processor seconds a second of a run's record, in all its processes or in that which records."""
    with tempfile.TemporaryDirectory() as folder:
        scenario = Path(folder) / "scenario.toml"
        text = re.sub(r'duration = ".*"', f'duration = "{_RECORD_S:g} s"', SIXTEEN.read_text())
        scenario.write_text(text)
        command = [
            "run",
            scenario,
            "--bench",
            SIXTEEN.with_name("sixteen_channels.bench.toml"),
            "--out",
            folder,
        ]
        with subprocess.Popen(  # noqa: S603
            [checkout / ".venv/bin/rattle", *map(str, command)],
            cwd=checkout,
            stdout=subprocess.PIPE,
            text=True,
        ) as run:
            assert run.stdout is not None
            if not any(line.startswith("recording") for line in run.stdout):
                raise RuntimeError(f"{checkout}: it recorded nothing")
            processes = [psutil.Process(run.pid)]
            processes += [] if alone else processes[0].children(recursive=True)
            before, began_s = _spent_s(processes), time.monotonic()
            time.sleep(_RECORD_S - 1.0)
            spent = (_spent_s(processes) - before) / (time.monotonic() - began_s)
            run.communicate()
    return spent


def campaign(given: Campaign, other: Path, folder: Path) -> list[Path]:
    """The logs of a campaign, recorded by the other version."""
    (folder / "hidden.json").write_text(given.hidden)
    bench = folder / "bench.toml"
    bench.write_text(EMULATION)
    for number, text in enumerate(given.scenarios):
        scenario = folder / f"{number}.toml"
        scenario.write_text(text + ACQUISITION.format(seconds=given.seconds))
        processor_s(other, ["run", scenario, "--bench", bench, "--out", folder])
    return sorted(folder.glob("*.mcap"))


def diagnosed_s(logs: list[Path], checkout: Path) -> float:
    """Seconds from the start of a diagnosis to its end."""
    with tempfile.TemporaryDirectory() as folder:
        began_s = time.monotonic()
        subprocess.run(  # noqa: S603
            [checkout / ".venv/bin/rattle", "diagnose", *logs, "--out", folder],
            cwd=checkout,
            env={**os.environ, "RATTLE_SIMULATED": "0"},
            check=True,
            stdout=subprocess.DEVNULL,
        )
        return time.monotonic() - began_s


def _spent_s(processes: list[psutil.Process]) -> float:
    return sum(times.user + times.system for times in (each.cpu_times() for each in processes))


@dataclass(frozen=True, slots=True)
class Bar:
    """What ratios are held to, and how costs are told: in `unit`, so many `times` what they are in s.

    `longest`: that of the largest costs as well as the median of all.
    """

    ratio: float
    unit: str = "ms a second"
    times: float = 1e3
    longest: bool = False


def bar_of(name: str) -> Bar:
    """The bar of a command."""
    if name in WORK:
        return Bar(BAR)
    return Bar(DIAGNOSED_BAR, "s", 1.0, longest=True) if name in DIAGNOSED else Bar(ACQUISITION_BAR)


def costs_of(name: str, other: Path, rounds: int) -> list[tuple[float, float]]:
    """What a command costs this version and the other, turn about; a first round fills caches."""
    with tempfile.TemporaryDirectory() as folder:
        measure: Callable[[Path], float] = partial(while_recording, alone=name == ALONE)
        if name in WORK:
            measure = partial(cost, WORK[name], written(name, WORK[name], other, Path(folder)))
        elif name in DIAGNOSED:
            measure = partial(diagnosed_s, campaign(DIAGNOSED[name], other, Path(folder)))
        for checkout in (other, HERE):
            measure(checkout)
        return [(measure(HERE), measure(other)) for _ in range(rounds)]


def within(name: str, costs: Sequence[tuple[float, float]]) -> bool:
    """Print costs (this version's, the other's) and whether their ratios keep to the bar of the command."""
    bar, (here, there) = bar_of(name), zip(*costs, strict=True)
    ratios = [this / that for this, that in costs]
    middle, longest = statistics.median(ratios), max(here) / max(there)
    this, that = (statistics.median(each) * bar.times for each in (here, there))
    print(
        f"{name}: median {this:.2f} {bar.unit} here, {that:.2f} there; ratio {middle:.3f}"
        f" ({min(ratios):.3f} to {max(ratios):.3f}; bar {bar.ratio:.4g})",
        flush=True,
    )
    if not bar.longest:
        return middle <= bar.ratio
    this, that = max(here) * bar.times, max(there) * bar.times
    print(
        f"{name}: longest {this:.2f} {bar.unit} here, {that:.2f} there; ratio {longest:.3f}"
        f" (bar {bar.ratio:.4g})",
        flush=True,
    )
    return bool(max(middle, longest) <= bar.ratio)


@contextmanager
def checked_out(other: str) -> Iterator[Path]:
    """The other version, set up."""
    if Path(other).is_dir():
        yield Path(other).resolve()
        return
    worktree = ["git", "-C", str(HERE), "worktree"]
    with tempfile.TemporaryDirectory() as folder:
        at = Path(folder) / "other"
        subprocess.run([*worktree, "add", "--detach", "--quiet", at, other], check=True)  # noqa: S603
        try:
            subprocess.run([at / "scripts" / "setup"], cwd=at, check=True, capture_output=True)  # noqa: S603
            yield at
        finally:
            subprocess.run([*worktree, "remove", "--force", at], check=True)  # noqa: S603


def main() -> int:
    """Compare, and return 1 if anything takes longer here."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("other", help="commit, or folder with the other version, set up")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--only", nargs="*", choices=NAMES, default=NAMES[: -len(DIAGNOSED)])
    given = parser.parse_args()
    with checked_out(given.other) as other:
        held = [within(name, costs_of(name, other, given.rounds)) for name in given.only]
    return int(not all(held))


if __name__ == "__main__":
    raise SystemExit(main())
