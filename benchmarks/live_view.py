"""How soon the live view shows a run, and how far behind its newest sample it is.

Runs `rattle run --live` on the emulated beam with 16 channels and then with 64, or as many as are asked for,
and opens the address that it prints, as soon as it does, in Chromium, which draws in software. Prints: from
the address to the first picture; how far behind the newest sample, and behind the prediction's, the page was
each time it had drawn, while the run recorded; in the middle of the record, texts that are cut or lie on each
other, and channels that have all their traces. Run and browser share this machine's cores.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from playwright.sync_api import sync_playwright

from benchmarks.recording_load import SCENARIO, _beam_bench
from daq.log.reader import LogReader
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
        looks = page.evaluate("() => looks")
        browser.close()
    if run.returncode:
        return run.returncode
    with LogReader(next(folder.glob("*.mcap"))) as log:
        print(f"samples came to the run   up to {late_s(log):.2f} s late, by what emulates the card")
    print(f"texts cut or overlapping  {'; '.join(faults) or 0}")
    print(f"channels with all traces  {traced} of {channels}")
    return max(_report(looks, first_s), int(bool(faults) or traced != channels))


Look = tuple[float, float | None, str, float | None]


def _report(looks: list[Look], first_s: float) -> int:
    recording = [look for look in looks if look[2] == "recording"]
    each_s = np.diff([at for at, *_ in recording]) / 1000
    before = sorted({stage for _, _, stage, _ in looks} - {"recording"})
    print(f"address to first picture  {first_s:.2f} s, with the browser's start (bar {FIRST_S:g})")
    print(f"before and after it said  {'; '.join(before)}")
    often = f"every {np.median(each_s):.2f} s, at the longest {each_s.max():.2f} s"
    print(f"pictures of the record    {len(recording)}, {often}")
    most_s = 0.0
    for whose, place in (("newest sample", 1), ("prediction's", 3)):
        behind = np.array([look[place] for look in recording if look[place] is not None], dtype=float)
        late = f"95 % {np.quantile(behind, 0.95):.2f} s, largest {behind.max():.2f} s (bar {BEHIND_S:g})"
        print(f"{f'behind the {whose}':<25} median {np.median(behind):.2f} s, {late}")
        most_s = max(most_s, float(behind.max()))
    return int(first_s > FIRST_S or most_s > BEHIND_S)


if __name__ == "__main__":
    sys.exit(main())
