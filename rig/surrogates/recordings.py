"""The recordings that the second paper's predictors are judged on, made on the emulated bench."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from daq.clock import Clock
from daq.errors import LogError
from daq.log.reader import LogReader
from daq.log.records import RECORD_END
from rig.files.bench import Bench, embedded_bench
from rig.files.scenario import parse_scenario
from rig.twin.recorded_samples import RIG

if TYPE_CHECKING:
    from rig.session.devices import Connect
    from rig.session.progress import Screen
    from rig.session.run import RunRequest

SEED: Final = 2012
"""Of the rig that all are recorded on."""
SECONDS, QUICK_SECONDS = 6.0, 2.0
"""At 150 rpm 15 revolutions and 5; a figure of the paper takes 0.3 s."""


@dataclass(frozen=True, slots=True)
class Setting:
    """How the crank is set for a recording: radial clearances in mm, speed in rpm, material."""

    clearance_1: float
    clearance_2: float
    speed: float
    material: str = "steel"

    @property
    def name(self) -> str:
        return f"{self.clearance_1:g}-{self.clearance_2:g}-mm-{self.speed:g}-rpm-{self.material}"

    def scenario(self, seconds: float) -> str:
        """The text of its scenario."""
        return f"""name = "{self.name}"
rig = "{RIG}"

[model]
clearance_1 = "{self.clearance_1:g} mm"
clearance_2 = "{self.clearance_2:g} mm"
material = "{self.material}"

[drive]
speed = "{self.speed:g} rpm"

[acquisition]
sample_rate = "25.6 kHz"
settle = "1 s"
duration = "{seconds:g} s"
"""


_GAPS: Final = ((1, 1), (1, 2), (2, 2))
PAPER: Final = tuple(
    Setting(*gaps, speed, material)
    for gaps in _GAPS
    for material in ("steel", "aluminium")
    for speed in (150, 200)
)
"""Those of figures 5 to 10; which two materials the paper had it does not say."""
ALL: Final = (*PAPER, *(Setting(*gaps, 175) for gaps in _GAPS))
"""With a speed between."""


def _bench() -> Bench:
    bench = embedded_bench(RIG)
    return replace(bench, emulation=replace(bench.emulation, seed=SEED))


def log_of(folder: Path, setting: Setting, seconds: float) -> Path | None:
    """The whole log of a setting on this bench that lies in `folder`; None where there is none yet."""
    bench_digest = hashlib.sha256(_bench().text.encode()).hexdigest()
    for path in sorted((folder / setting.name).glob("*.mcap")):
        try:
            with LogReader(path) as log:
                ended = any(event.code == RECORD_END for event in log.events())
                texts = [setting.scenario(each) for each in (SECONDS, QUICK_SECONDS) if each >= seconds]
                run = log.metadata.get("run", {})
                same = (run.get("bench_sha256"), run.get("emulation_seed")) == (bench_digest, str(SEED))
                if log.complete and ended and same and log.scenario in texts:
                    return path
        except LogError:
            continue
    return None


def recorded(
    settings: Sequence[Setting],
    folder: Path,
    seconds: float,
    connect: Connect,
    screen: Screen,
    clock: Clock,
    run: Callable[[RunRequest, Screen, Clock], Path] | None = None,
) -> dict[Setting, Path]:
    """The log of each setting; those that are not in `folder` yet are recorded, on one and the same rig."""
    from rig.session.run import RunRequest, run_scenario  # whoever only reads them drives no bench

    bench, found = _bench(), {}
    for number, setting in enumerate(settings, start=1):
        log = log_of(folder, setting, seconds)
        if log is None:
            screen.say(f"recording {number} of {len(settings)}  {setting.name}")
            scenario = parse_scenario(setting.scenario(seconds), setting.name)
            log = (run or run_scenario)(
                RunRequest(scenario, bench, connect, folder / setting.name), screen, clock
            )
        found[setting] = log
    return found
