"""Every fault of the one table in a short run of its rig: it ends as is said there, with nothing lost unsaid.

What each log holds is compared with what was sent after every test (tests/conftest.py).
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from daq.log.reader import LogReader
from daq.log.records import RECORD_END, STOPPING
from daq.log.recover import recover_log, verify_log
from drivers.rehearsal import FAULTS, Rehearsed, rehearsed
from tests.accounting import disk_failed
from tests.end_to_end.command import rattle
from tests.end_to_end.files import write_crank, write_scenario

pytestmark = [pytest.mark.soak, pytest.mark.timeout(400)]
DEADLINE_S = 300.0
SHAFT = {f"daq_card.{kind}" for kind in ("rolls_over", "marks_missing", "marks_doubled", "marks_late")}
"""Of the card, but of what only a crank has on it."""
COMES_S = {"daq_card": 3.0, "signal_generator": 2.0, "disk": 0.5}
"""After the first use of an instrument, within the record of a beam."""
STOP_LINES = {"daq_card": "cDAQ1Mod4/port0/line0", "inverter": "inverter/RH"}
SELDOM, SURELY_SOME = 0.01, 0.05
"""Shares of an instrument's answers; of more than a hundred in a run one is spoilt by the latter."""
ON_A_CRANK_S, ON_A_SUPPLY_S = 4.5, 13.0
"""Up to speed, and trimmed: what is turned on a supply before that is set anew by the next trim."""


def played(fault: Rehearsed, folder: Path) -> tuple[Path, Path]:
    """Scenario and bench of the rig that has such an instrument, on which the fault comes."""
    crank = fault.table not in COMES_S or fault.name in SHAFT
    text = fault.name
    if not FAULTS[fault.name].at_start:
        on_a_crank_s = ON_A_SUPPLY_S if fault.table == "dc_supply" else ON_A_CRANK_S
        text += f"@{on_a_crank_s if crank else COMES_S[fault.table]:g}"
    if FAULTS[fault.name].values.get("share") == SELDOM:
        text += f":share={SURELY_SOME}"
    if "channel" in fault.known and not crank:
        text += ":channel=yoke.force"  # with a supply of its own, and nothing is driven by it
    tables = [fault.table] if fault.table in ("dc_supply", "encoder") else []
    bench = "".join(f"[{table}]\nemulated = true\n" for table in tables)
    if fault.kind == "stop_pressed":
        bench += f'[emergency_stop]\nline = "{STOP_LINES[fault.table]}"\n'
    (folder / "bench.toml").write_text(f'{bench}[emulation]\nseed = 7\nfaults = ["{text}"]\n')
    file = folder / "scenario.toml"
    seconds = 12.0 if fault.table == "dc_supply" else 4.0  # it comes up slowly, and trims
    scenario = write_crank(file, "planar_slider_crank", seconds) if crank else write_scenario(file, 1.0, 3.0)
    return scenario, folder / "bench.toml"


@pytest.mark.parametrize("name", FAULTS)
def test_it_ends_as_the_table_says_and_every_sample_is_accounted_for(name: str, tmp_path: Path) -> None:
    fault, seen = rehearsed(name), FAULTS[name].seen
    scenario, bench = played(fault, tmp_path)
    ended = rattle("run", scenario, "--bench", bench, "--out", tmp_path, deadline_s=DEADLINE_S)
    said = f"{ended.out}{ended.err}"
    if seen.startswith("refused"):
        assert ended.code == 1, said
        assert not list(tmp_path.glob("*.mcap"))
        return
    exits = re.match(r"exit (\d)", seen)
    assert ended.code == (int(exits[1]) if exits else 0), said
    may_be_on = re.findall(r"THE [A-Z]+ MAY STILL [A-Z]+", seen)
    assert set(re.findall(r"THE [A-Z]+ MAY STILL [A-Z]+", ended.out)) == set(may_be_on), said
    assert all(words in ended.err for words in may_be_on), said
    if "the instrument named" in seen:
        assert fault.table.replace("_", " ") in ended.err.lower(), said
    log = ended.log
    with LogReader(log) as reader:
        complete = reader.complete
    if fault.table == "disk" and not complete:
        recover_log(disk_failed(log), tmp_path / "recovered.mcap")
        log = tmp_path / "recovered.mcap"
    assert verify_log(log).sound
    with LogReader(log) as reader:
        codes = [event.code for event in reader.events()]
        flagged = any(block.flags for _, block in reader.blocks("measured"))
    if not may_be_on:
        assert "drive.off" in codes or re.search(r"the (drive|motor) is off", ended.err), said
    if ended.code == 0:
        assert {RECORD_END, "drive.off"} <= set(codes)
    elif fault.table != "disk":  # which may take that no more
        assert STOPPING in codes
    for code in re.findall(r"`([a-z][^`]*)`", seen):
        assert any(each.startswith(code.removesuffix("...")) for each in codes), (code, codes)
    assert flagged or "flag" not in seen
    assert re.search(r"[1-9]\d* (marks missing|edges rejected)", said) or "told of at the end" not in seen
