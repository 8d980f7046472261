"""What a second look at the same runs costs: `diagnose` and `gap` again, and with one more run.

Three runs with an effect hidden in them are recorded for each rig, and a fourth at another setting. At first
nothing is kept. Memory is that of all processes together, each by its share of what several have (PSS).
Returns 1 where `gap` again or one more run takes more than a fifth of the first diagnosis, or a diagnosis
more than 3 GB.

Usage: python -m benchmarks.second_look [--rigs RIG ...]
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Mapping
from pathlib import Path

import psutil

from benchmarks.versions import ACQUISITION, CHANNELS, DIAGNOSED, EMULATION, ROTATION

ROOT = Path(__file__).parents[1]
SHARE, MOST_MB = 0.2, 3000.0
_EVERY_S = 0.5
_SPATIAL, _SECONDS = "spatial_slider_crank", 5.0
RIGS: Mapping[str, tuple[tuple[str, ...], float, str]] = {
    "impact_beam": (
        (*DIAGNOSED["beam diagnosed"].scenarios, CHANNELS.replace("20 Hz", "16 Hz")),
        DIAGNOSED["beam diagnosed"].seconds,
        DIAGNOSED["beam diagnosed"].hidden,
    ),
    "planar_slider_crank": (
        (
            *DIAGNOSED["planar crank diagnosed"].scenarios,
            ROTATION.format(rig="planar_slider_crank", speed="175 rpm"),
        ),
        DIAGNOSED["planar crank diagnosed"].seconds,
        DIAGNOSED["planar crank diagnosed"].hidden,
    ),
    _SPATIAL: (
        tuple(ROTATION.format(rig=_SPATIAL, speed=f"{rpm} rpm") for rpm in (200, 230, 260, 215)),
        _SECONDS,
        '[{"name": "contact_damping", "parameters": {"scale": 6.0}}]',
    ),
}
"""Scenarios, seconds of a run, and what is hidden; the last scenario is the further run's."""


def rattle(*arguments: object, cache: Path) -> tuple[float, float]:
    """Seconds that a command takes, and the most memory (MB) of its processes together."""
    most, ended = [0.0], threading.Event()
    environment = {**os.environ, "XDG_CACHE_HOME": str(cache)}
    began_s = time.monotonic()
    command = [sys.executable, "-m", "rig.start", *map(str, arguments)]
    with subprocess.Popen(command, cwd=ROOT, env=environment, stdout=subprocess.DEVNULL) as ran:  # noqa: S603

        def watch() -> None:
            while not ended.wait(_EVERY_S):
                most[0] = max(most[0], _memory_mb(ran.pid))

        watching = threading.Thread(target=watch)
        watching.start()
        code = ran.wait()
        ended.set()
        watching.join()
    if code:
        raise RuntimeError(f"{' '.join(command)} ended with {code}")
    return time.monotonic() - began_s, most[0]


def _memory_mb(pid: int) -> float:
    total = 0.0
    try:
        root = psutil.Process(pid)
        for each in (root, *root.children(recursive=True)):
            total += each.memory_full_info().pss / 1e6
    except psutil.Error:  # one has just ended
        return 0.0
    return total


def recorded(rig: str, folder: Path, cache: Path) -> list[Path]:
    """The logs of a rig's scenarios."""
    scenarios, seconds, hidden = RIGS[rig]
    (folder / "hidden.json").write_text(hidden)
    bench = folder / "bench.toml"
    bench.write_text(EMULATION)
    logs = list[Path]()
    for number, text in enumerate(scenarios):
        scenario, out = folder / f"{number}.toml", folder / str(number)
        scenario.write_text(text + ACQUISITION.format(seconds=seconds))
        rattle("run", scenario, "--bench", bench, "--out", out, cache=cache)
        logs += out.glob("*.mcap")
    return logs


def looked_at(rig: str) -> bool:
    """Print what each look takes; whether all is within its bar."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        cache, out = folder / "cache", folder / "answer"
        *logs, more = recorded(rig, folder, cache)
        first_s, first_mb = rattle("diagnose", *logs, "--out", out, cache=cache)
        again_s, _ = rattle("diagnose", *logs, "--out", folder / "again", cache=cache)
        effects = out / "effects.json"
        gap_s, gap_again_s = (
            sum(rattle("gap", log, "--effects", effects, cache=cache)[0] for log in logs) for _ in range(2)
        )
        more_s, more_mb = rattle("diagnose", *logs, more, "--out", folder / "more", cache=cache)
    most_mb = max(first_mb, more_mb)
    print(
        f"{rig}: first {first_s:.1f} s, again {again_s:.1f}, with one more run {more_s:.1f} "
        f"({more_s / first_s:.2f} of the first; bar {SHARE}); gap {gap_s:.1f}, again {gap_again_s:.1f} "
        f"({gap_again_s / first_s:.2f}); most memory {most_mb:.0f} MB (bar {MOST_MB:.0f})",
        flush=True,
    )
    return max(more_s, gap_again_s) <= SHARE * first_s and most_mb <= MOST_MB


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--rigs", nargs="*", choices=tuple(RIGS), default=tuple(RIGS))
    within = [looked_at(rig) for rig in parser.parse_args().rigs]
    return int(not all(within))


if __name__ == "__main__":
    raise SystemExit(main())
