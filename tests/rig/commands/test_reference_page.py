"""docs/reference.md lists every command, and every message of a log with its fields."""

from pathlib import Path

import pytest

from daq.log.codec import MESSAGES
from rig.commands.cli import COMMANDS

PAGE = (Path(__file__).parents[3] / "docs" / "reference.md").read_text(encoding="utf-8")
TOLD = {name: told for name, _, told in COMMANDS}


@pytest.mark.parametrize("name", TOLD)
def test_a_command_stands_there_as_its_help_says_it(name: str) -> None:
    assert f"| `{name}` | {TOLD[name]} |\n" in PAGE


@pytest.mark.parametrize("name", MESSAGES)
def test_a_message_stands_there_with_its_fields(name: str) -> None:
    (row,) = (line for line in PAGE.splitlines() if line.startswith(f"| `{name}` | "))
    places = [row.rfind(f"`{field}`") for field, *_ in MESSAGES[name]]
    assert -1 < places[0] < places[-1]
    assert places == sorted(places)
