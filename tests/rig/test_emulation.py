"""What a person is told while emulated instruments start."""

from __future__ import annotations

from pathlib import Path

import pytest

from rig.emulation import first_start_of
from rig.files.bench import embedded_bench, parse_bench
from rig.rigs import RIGS
from rig.session.progress import FIRST_START


@pytest.fixture(params=["nothing compiled", "compiled"])
def compiled(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> bool:
    """Whether there is machine code on the disk."""
    monkeypatch.setattr("rig.session.pace._PROJECT", tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    if request.param == "compiled":
        (tmp_path / "sim_twin").mkdir()
        (tmp_path / "sim_twin" / "kernel.nbi").touch()
    return bool(request.param == "compiled")


@pytest.mark.parametrize("rig", RIGS)
def test_an_emulated_rig_says_how_long_its_first_start_takes_and_of_a_later_one_nothing(
    rig: str, compiled: bool
) -> None:
    assert first_start_of(embedded_bench(rig)) == ("" if compiled else FIRST_START)


@pytest.mark.usefixtures("compiled")
def test_an_emulated_generator_alone_compiles_nothing_and_says_nothing_of_it() -> None:
    head, table = RIGS["impact_beam"].bench.split("[daq_card]")
    real_card = table.replace("emulated = true\n", "", 1)
    bench = parse_bench(f"{head}[daq_card]{real_card}", "bench", Path())
    assert bench.emulated == ("signal_generator",)
    assert first_start_of(bench) == ""
