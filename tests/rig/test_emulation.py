"""What a person is told while emulated instruments start."""

from __future__ import annotations

from pathlib import Path

import pytest

from rig.emulation import first_start
from rig.files.bench import embedded_bench, parse_bench
from rig.rigs import RIGS
from rig.session.progress import FIRST_START


@pytest.mark.parametrize("rig", RIGS)
def test_an_emulated_rig_says_how_long_its_first_start_takes(rig: str) -> None:
    assert FIRST_START in first_start(embedded_bench(rig))


def test_an_emulated_generator_alone_compiles_nothing_and_says_nothing_of_it() -> None:
    head, table = RIGS["impact_beam"].bench.split("[daq_card]")
    real_card = table.replace("emulated = true\n", "", 1)
    bench = parse_bench(f"{head}[daq_card]{real_card}", "bench", Path())
    assert bench.emulated == ("signal_generator",)
    assert first_start(bench) == ""
