"""docs/faults.md names a test for every fault and bug of the lists, and each of them exists."""

from __future__ import annotations

import re
from pathlib import Path

TESTS = Path(__file__).parent
PAGE = TESTS.parent / "docs" / "faults.md"
ROWS = dict(re.findall(r"^\| ([BF]\d+) \|[^|]*\| (.*) \|$", PAGE.read_text(), re.MULTILINE))
BUGS, FAULTS = 25, 35


def test_every_fault_and_bug_has_its_row() -> None:
    assert list(ROWS) == [f"B{number + 1}" for number in range(BUGS)] + [
        f"F{number + 1}" for number in range(FAULTS)
    ]


def test_every_test_that_is_named_is_there() -> None:
    for number, cell in ROWS.items():
        named = re.findall(r"`([\w/]+\.py)::(test_\w+)`", cell)
        assert named, number
        for path, name in named:
            assert f"def {name}(" in (TESTS / path).read_text(), (number, path, name)
