"""What somebody's own rig is simulated by: whatever of it changes, nothing that was simulated is used."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rig.diagnosis.subject_file import read_rig
from sim_twin.own_rig import Draw

SUBJECT = """

SUBJECT = Simulator(
    simulate,
    {"way": "m"},
    {"slope": (1.0, 0.1)},
    (cause("steeper", "slope", number("slope", "", (2.0, 9.0))),),
)
"""
RIG = """
from functools import cache
from pathlib import Path

import numpy as np
from my_helper import FACTOR

from sim_twin.own_rig import Simulator, cause, number


@cache
def table():
    return np.loadtxt(Path(__file__).parent / "table.csv")


def simulate(p, given):
    return {"way": FACTOR * p.slope * given["time"] + table().sum()}
"""
TIMES = np.arange(32) / 16
WAYS = {"time": TIMES, "way": TIMES}


@pytest.fixture
def rig(folder: Path) -> Path:
    files = {"my_rig.py": RIG + SUBJECT, "my_helper.py": "FACTOR = 2.0\n", "table.csv": "1\n2\n"}
    for name, content in files.items():
        (folder / name).write_text(content)
    return folder / "my_rig.py"


def looked(rig: Path) -> tuple[str, float]:
    """Its version, and the last of the means of one healthy rig's way."""
    found = read_rig(str(rig), [WAYS])
    [(blocks,)] = found.subject.observe([Draw((), 1)])
    assert blocks is not None
    return found.version, float(blocks[0, -1])


def test_a_rig_that_nobody_changed_is_of_the_same_version(rig: Path) -> None:
    first = looked(rig)
    (rig.parent / "notes.txt").write_text("nobody reads them")
    assert looked(rig) == first


@pytest.mark.parametrize("name", ["my_rig.py", "my_helper.py"])
def test_one_whose_code_changed_is_another_even_where_it_shows_the_same(rig: Path, name: str) -> None:
    first, shown = looked(rig)
    with (rig.parent / name).open("a") as file:
        file.write("# more\n")
    other, again = looked(rig)
    assert other != first
    assert again == shown


def test_one_that_reads_another_table_is_another(rig: Path) -> None:
    first, _ = looked(rig)
    (rig.parent / "table.csv").write_text("1\n2\n5\n")
    assert looked(rig)[0] != first


def test_a_file_is_read_as_it_is_now_with_what_it_imports(rig: Path) -> None:
    _, before = looked(rig)
    (rig.parent / "my_helper.py").write_text("FACTOR = 4.0  # twice as much\n")
    assert looked(rig)[1] - 3.0 == pytest.approx(2 * (before - 3.0))  # the table adds 3
