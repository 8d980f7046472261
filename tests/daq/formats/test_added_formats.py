"""A file format of another installed package is read and written like those here."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from daq.errors import LogError
from daq.formats import FORMATS, all_formats, format_of
from daq.formats.contents import FileFormat
from daq.plugins import plugins
from tests.fake_packages import install

CODE = """
from daq.formats.contents import Contents, FileFormat

def read(path, scratch):
    return Contents(())

def write(recording, path, warn):
    path.write_text("tape")
    return (path,)

FORMAT = FileFormat("tape", (".tape", ".csv"), read, write)
"""


@pytest.fixture
def added(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[None]:
    points = {"tape": "added_tape:FORMAT", "uff": "added_tape:FORMAT", "reel": "added_tape:read"}
    install(monkeypatch, tmp_path, "added-tape", "rattle.formats", points, CODE)
    all_formats.cache_clear()
    yield
    all_formats.cache_clear()


@pytest.mark.usefixtures("added")
def test_a_format_of_another_package_is_found_by_name_and_by_ending() -> None:
    assert list(all_formats()) == [*FORMATS, "tape"]
    assert format_of(Path("run.tape")).name == "tape"
    assert format_of(Path("run.csv")).name == "csv"  # the endings of the formats here come first
    with pytest.raises(LogError, match=r"known are .*\.npz, \.npy, \.tape"):
        format_of(Path("run.xlsx"))


@pytest.mark.usefixtures("added")
def test_what_is_wrong_with_it_is_told_and_the_rest_works() -> None:
    taken, no_format = sorted(
        plugins("rattle.formats", FileFormat, FORMATS).faults, key=lambda fault: "wanted" in fault
    )
    assert taken == "rattle.formats: uff of added-tape 1.2 is not used: that of rattle itself has the name"
    assert no_format.endswith(
        "reel of added-tape 1.2 is not used: added_tape:read is of function, wanted is FileFormat"
    )
    assert all_formats()["uff"] is FORMATS["uff"]
