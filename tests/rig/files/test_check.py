from __future__ import annotations

from pathlib import Path

import pytest

from daq.errors import ConfigurationError
from rig.commands.check import load_any
from rig.files.bench import Bench
from rig.files.scenario import Scenario

SCENARIOS = Path(__file__).parents[3] / "scenarios"


@pytest.mark.parametrize(("name", "kind"), [("impact_beam.toml", Scenario), ("bench.example.toml", Bench)])
def test_kind_is_told_by_the_tables(name: str, kind: type) -> None:
    assert isinstance(load_any(SCENARIOS / name), kind)


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ('rig = "impact_beam"\n', r"drive\.frequency = \(missing\)"),
        ("[daq_card]\n", r"signal_generator = \(missing\)"),
        ('[encoder]\ndriver = "canopen_cia406"\n', r"inverter = \(missing\): a table \[inverter\]"),
        (
            '[inverter]\nemulated = true\n[encoder]\ninterface = "slcan"\nnode = 7\n',
            r"encoder\.emulated = false: true beside an emulated inverter",
        ),
        ("[sweep]\n", "a path behind sweep.scenario"),
        ("colour = 3\n", "a scenario .*, a bench .* or a sweep"),
        ("", "a scenario .*, a bench .* or a sweep"),
        ("[[[\n", "TOML"),
    ],
)
def test_faulty_file_is_refused(text: str, match: str, tmp_path: Path) -> None:
    path = tmp_path / "file.toml"
    path.write_text(text)
    with pytest.raises(ConfigurationError, match=match):
        load_any(path)
