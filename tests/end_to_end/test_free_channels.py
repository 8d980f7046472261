"""What hangs on the bench and is none of the rig's: a microphone, a component of the socket's force."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from daq.log.reader import LogReader
from daq.log.recover import verify_log
from rig.rigs import RIGS
from tests.end_to_end.command import rattle
from tests.end_to_end.files import write_crank

DEADLINE_S = 300.0
RATE, DURATION_S = 25_600, 1.0
SPATIAL = "spatial_slider_crank"
FREE = """
[[daq_card.channels]]
name = "room.sound"
physical = "cDAQ1Mod3/ai3"
kind = "voltage"
modelled = false
sensitivity = "50 mV/Pa"
range = "20 Pa"

[[daq_card.channels]]
name = "socket.force_x"
physical = "cDAQ1Mod4/ai0"
kind = "charge_amplifier"
modelled = false
sensitivity = "4 pC/N"
gain = "2.5 mV/pC"
range = "500 N"

[emulation]
seed = 7
"""
UNITS = {"room.sound": "Pa", "socket.force_x": "N"}


@pytest.mark.long
@pytest.mark.timeout(400)
def test_what_no_twin_predicts_is_recorded_exported_and_reported(tmp_path: Path) -> None:
    scenario = write_crank(tmp_path / "scenario.toml", SPATIAL, DURATION_S)
    bench = tmp_path / "bench.toml"
    bench.write_text(RIGS[SPATIAL].bench + FREE)
    ended = rattle("run", scenario, "--bench", bench, "--out", tmp_path, deadline_s=DEADLINE_S)
    assert ended.code == 0, ended.err
    assert verify_log(ended.log).sound
    with LogReader(ended.log) as log:
        measured, predicted = log.channels("measured"), log.channels("predicted")
        recorded = {name: log.series("measured", name).values for name in UNITS}
    assert {name: measured[name].unit for name in UNITS} == UNITS
    assert measured.keys() - predicted.keys() == UNITS.keys()
    for values in recorded.values():
        assert len(values) == round(DURATION_S * RATE)
        assert np.ptp(values) > 0.0  # its noise
    page = ended.log.with_suffix(".html").read_text(encoding="utf-8")
    assert "no twin predicts room.sound and socket.force_x" in page
    file = tmp_path / "free.csv"
    exported = rattle("export", ended.log, "--to", "csv", "--channels", ",".join(UNITS), "-o", file)
    assert exported.code == 0, exported.err
    found = pd.read_csv(file)
    for name, unit in UNITS.items():
        column = found[f"measured/{name} [{unit}]"].to_numpy(np.float32)
        assert np.array_equal(column, recorded[name])
