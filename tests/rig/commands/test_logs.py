"""`rattle verify` and `rattle recover`, and how commands end."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.daq.log.logs import write_ramp
from tests.rig.commands.cli import Call


def test_a_sound_log_is_called_sound(call: Call, tmp_path: Path) -> None:
    answer = call("verify", write_ramp(tmp_path / "log.mcap"))
    assert answer.code == 0
    assert answer.out.rstrip().endswith(": sound")
    found = json.loads(call("verify", tmp_path / "log.mcap", "--json").out)
    assert found["sound"] is True
    assert {topic["topic"]: topic["samples"] for topic in found["topics"]} == {
        "/measured/a": 3000,
        "/measured/b": 3000,
    }


def test_a_cut_log_exits_1_and_can_be_recovered(call: Call, tmp_path: Path) -> None:
    path = write_ramp(tmp_path / "log.mcap")
    path.write_bytes(path.read_bytes()[:-500])
    answer = call("verify", path)
    assert answer.code == 1
    assert "cut short" in answer.out
    assert call("recover", path, "-o", tmp_path / "whole.mcap").code == 0
    assert call("verify", tmp_path / "whole.mcap").code == 0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["verify"], "Missing argument"),
        (["dance"], "No such command"),
        (["verify", "--loud", "x.mcap"], "No such option"),
        (["predict", "gone.toml", "--out", "x.mcap"], "gone.toml"),
    ],
)
def test_wrong_use_exits_2_and_says_what_is_wrong(call: Call, arguments: list[str], words: str) -> None:
    answer = call(*arguments)
    assert answer.code == 2
    assert answer.err.startswith("rattle: ")
    assert words in answer.err


def test_a_missing_log_exits_1_with_one_line(call: Call, tmp_path: Path) -> None:
    answer = call("verify", tmp_path / "gone.mcap")
    assert answer.code == 1
    assert answer.err == f"rattle: {tmp_path / 'gone.mcap'}: No such file or directory\n"
