"""How soon the live view shows a run, and how far behind its newest sample it is.

Runs `rattle run --live` on the emulated beam with 16 channels and then with 64, or as many as are asked for,
and opens the address that it prints, as soon as it does, in Chromium, which draws in software. Prints: from
the address to the first picture; how far behind the newest sample that the run had, and behind the newest
predicted one, the page was each time it had drawn, while the run recorded, and how far behind the clock, to
which the bar is held: it counts what emulates the card as well; in the middle of the record, texts that are
cut or lie on each other, and channels that have all their traces. Run and browser share this machine's
cores.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from playwright.sync_api import sync_playwright

from benchmarks.recording_load import SCENARIO, _beam_bench
from daq.block import NS_PER_S, SampleBlock, sample_time_ns
from daq.log.codec import decode_block
from daq.log.reader import LogReader, Origin
from rig.live.page_server import PORT_VARIABLE, PageServer, stop_page
from tests.accounting import late_s
from tests.rig.browser import CHROMIUM, PLACES, TRACED, faults_of_texts

ROOT = Path(__file__).parents[1]
FIRST_S, BEHIND_S = 5.0, 2.0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--channels", type=int, nargs="+", default=[16, 64])
    parser.add_argument("--size", default="1280x800")
    parser.add_argument(
        "--pictures", type=Path, help="a folder for a PNG of each in the middle of its record"
    )
    arguments = parser.parse_args()
    return max(_shown(arguments, channels) for channels in arguments.channels)


def _shown(arguments: argparse.Namespace, channels: int) -> int:
    print(f"channels                  {channels}")
    print(f"load before the run       {os.getloadavg()[0]:.2f} on {os.cpu_count()} cores", flush=True)
    with PageServer(0) as free:
        port = free.port
    try:
        with tempfile.TemporaryDirectory() as folder:
            return _measure(arguments, channels, Path(folder), port)
    finally:
        stop_page(port)


def _measure(arguments: argparse.Namespace, channels: int, folder: Path, port: int) -> int:
    scenario, bench = folder / "scenario.toml", folder / "bench.toml"
    text = re.sub(r'sample_rate = ".*"', 'sample_rate = "51200 Hz"', SCENARIO.read_text())
    scenario.write_text(re.sub(r'duration = ".*"', f'duration = "{arguments.seconds:g} s"', text))
    bench.write_text(_beam_bench(channels))
    width, height = map(int, arguments.size.split("x"))
    command = [
        sys.executable,
        "-m",
        "rig.start",
        "run",
        str(scenario),
        "--bench",
        str(bench),
        "--out",
        str(folder),
    ]
    with sync_playwright() as playwright:
        run = subprocess.Popen(  # noqa: S603 - our own
            [*command, "--live"],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            text=True,
            env=os.environ | {PORT_VARIABLE: str(port), "PYTHONUNBUFFERED": "1"},
        )
        assert run.stdout is not None
        address = next(line.split()[-1] for line in run.stdout if line.startswith("live view"))
        named_s = time.monotonic()
        browser = playwright.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu", "--no-first-run"]
        )
        page = browser.new_page(viewport={"width": width, "height": height})
        page.goto(address)
        page.wait_for_function("() => looks.length > 0")
        first_s = time.monotonic() - named_s
        for line in run.stdout:
            if line.startswith("recording"):
                break
        page.wait_for_timeout(500 * arguments.seconds)
        faults, traced = faults_of_texts(page, PLACES), page.evaluate(TRACED)
        if arguments.pictures:
            arguments.pictures.mkdir(parents=True, exist_ok=True)
            page.screenshot(path=arguments.pictures / f"{channels}.png")
        print(run.stdout.read(), end="")
        run.wait()
        looks = page.evaluate("() => looks.map(look => [performance.timeOrigin + look[0], ...look.slice(1)])")
        browser.close()
    if run.returncode:
        return run.returncode
    with LogReader(next(folder.glob("*.mcap"))) as log:
        print(f"samples came to the run   up to {late_s(log):.2f} s late")
        came = {origin: _arrivals(log, origin) for origin in BEHIND}
    print(f"texts cut or overlapping  {'; '.join(faults) or 0}")
    print(f"channels with all traces  {traced} of {channels}")
    return max(_report(looks, first_s, came), int(bool(faults) or traced != channels))


Look = tuple[float, float | None, str, float | None]
"""When it was drawn (Unix time, ms), s behind the clock, the stage, s of the prediction behind the clock."""
BEHIND: Final[Mapping[Origin, tuple[str, int]]] = {
    "measured": ("behind the newest sample", 1),
    "predicted": ("behind the prediction's", 3),
}


def _arrivals(log: LogReader, origin: Origin) -> NDArray[np.float64]:
    """When the run had samples, and of which time the newest of them then was; Unix time, s, shape (2, n)."""
    topics = [f"/{origin}/{name}" for name in log.channels(origin)]
    ends = [(each.log_ns, _end_ns(decode_block("", each.data))) for each in log.messages(topics)]
    at, end = np.array(sorted(ends), np.float64).T / NS_PER_S
    return np.stack([at, np.maximum.accumulate(end)])


def _end_ns(block: SampleBlock) -> int:
    return sample_time_ns(block.time_ns, len(block), block.sample_rate)


def _report(looks: list[Look], first_s: float, came: Mapping[Origin, NDArray[np.float64]]) -> int:
    recording = [look for look in looks if look[2] == "recording"]
    each_s = np.diff([at for at, *_ in recording]) / 1000
    before = sorted({stage for _, _, stage, _ in looks} - {"recording"})
    print(f"address to first picture  {first_s:.2f} s, with the browser's start (bar {FIRST_S:g})")
    print(f"before and after it said  {'; '.join(before)}")
    often = f"every {np.median(each_s):.2f} s, at the longest {each_s.max():.2f} s"
    print(f"pictures of the record    {len(recording)}, {often}")
    most_s = 0.0
    for origin, (name, place) in BEHIND.items():
        drawn = np.array([(look[0] / 1000, look[place]) for look in recording if look[place] is not None])
        drawn_s, clock_s = drawn.T
        had = np.maximum(np.searchsorted(came[origin][0], drawn_s, side="right") - 1, 0)
        behind = came[origin][1][had] - (drawn_s - clock_s)
        late = f"95 % {np.quantile(behind, 0.95):.2f} s, largest {behind.max():.2f} s"
        clock = (
            f"behind the clock {np.median(clock_s):.2f} s, largest {clock_s.max():.2f} s (bar {BEHIND_S:g})"
        )
        print(f"{name:<25} median {np.median(behind):.2f} s, {late}; {clock}")
        most_s = max(most_s, float(clock_s.max()))
    return int(first_s > FIRST_S or most_s > BEHIND_S)


if __name__ == "__main__":
    sys.exit(main())
