"""The verdict along its whole way: emulated instruments, their log, healthy rigs as they are by default.

The other runs of these tests go without one, for healthy rigs take their time.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from rig.diagnosis.health import HEALTHY_RIGS
from tests.end_to_end.command import DEADLINE_S, Ended, rattle
from tests.end_to_end.files import SCENARIOS, write_bench, write_scenario

pytestmark = pytest.mark.long
SEED = 7
HIDDEN = SCENARIOS / "rehearsal.hidden.json"
"""The flexible base of the rehearsal."""


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("cache")
        patch.delenv(HEALTHY_RIGS)
        patch.setenv("XDG_CACHE_HOME", str(folder))
        yield folder / "rattle" / "healthy"


def judged(folder: Path, emulation: str = "") -> Ended:
    bench = write_bench(folder / "bench.toml", emulation=f"[emulation]\nseed = {SEED}\n{emulation}")
    scenario = write_scenario(folder / "s.toml", settle_s=1.0, duration_s=4.0)
    ended = rattle("run", scenario, "--bench", bench, "--out", folder, "--json", deadline_s=4 * DEADLINE_S)
    assert ended.code == 0, ended.err
    return ended


def test_a_healthy_rig_and_one_with_something_hidden_are_judged_right_by_one_kept_band(
    cache: Path, tmp_path: Path
) -> None:
    well = judged(tmp_path)
    answer = json.loads(well.out)
    assert answer["verdict"]["well"] is True
    assert "verdict    Within what healthy rigs do." in well.err
    assert "simulating healthy rigs" in well.err
    (band,) = cache.iterdir()
    made = band.stat().st_mtime_ns

    off = judged(tmp_path, f"effects = {json.dumps(os.path.relpath(HIDDEN, tmp_path))}")
    answer = json.loads(off.out)
    assert answer["verdict"]["well"] is False
    first, where, *_, what_next = answer["verdict"]["sentences"]
    assert first == "Not what healthy rigs do."
    assert "base.acceleration" in where
    assert what_next == f"What causes it: rattle diagnose {answer['log']} --out answer"
    assert first in Path(answer["report"]).read_text(encoding="utf-8")
    assert [each.stat().st_mtime_ns for each in cache.iterdir()] == [made]
