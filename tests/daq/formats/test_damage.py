"""Cut and flipped files: columns or LogError, never what another package raises, never all memory."""

from __future__ import annotations

import random
import warnings
from pathlib import Path

import numpy as np
import pytest

from daq.errors import LogError
from daq.formats import FORMATS, format_of
from daq.formats.samples import Scratch
from daq.log.records import Event
from daq.log.writer import LogWriter
from tests.daq.formats import runs

CUTS, FLIPS = 12, 60
COUNT = 300


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A small file of every format."""
    folder = tmp_path_factory.mktemp("whole")
    rng = np.random.default_rng(3)
    with LogWriter(folder / "run.mcap") as log:
        log.add_metadata("run", runs.RUN)
        log.add_event(Event(runs.START_NS, "info", "rig", "a", "b"))
        for channel, dtype in ((runs.BASE, "f4"), (runs.ANGLE, "f8")):
            log.declare("measured", channel)
            for block in runs.cut(channel, rng.normal(size=COUNT).astype(dtype), runs.SLOW):
                log.add_block("measured", block, block.time_ns)
    paths = {}
    with Scratch(folder) as scratch:
        recording = runs.recorded(folder / "run.mcap", scratch)
        for name, each in FORMATS.items():
            if each.write is not None:
                (paths[name],) = each.write(recording, folder / f"run{each.suffixes[0]}", str)
    paths["npz"], paths["npy"] = folder / "run.npz", folder / "run.npy"
    np.savez_compressed(paths["npz"], force=rng.normal(size=COUNT), sample_rate=1000.0)
    np.save(paths["npy"], rng.normal(size=(2, COUNT)))
    return paths


KINDS = ["uff", "tdms", "mat", "csv", "parquet", "npz", "npy"]


def read_all(path: Path) -> int:
    """How many samples could be read."""
    with warnings.catch_warnings(), Scratch(path.parent) as scratch:
        warnings.simplefilter("ignore")  # packages may warn before they give up
        contents = format_of(path).read(path, scratch)
        return sum(len(runs.everything(column.samples)) for column in contents.columns)


@pytest.mark.parametrize("kind", KINDS)
def test_a_cut_file_is_an_error_and_never_a_shorter_run(
    kind: str, whole: dict[str, Path], tmp_path: Path
) -> None:
    content = whole[kind].read_bytes()
    cut = tmp_path / whole[kind].name
    assert read_all(whole[kind]) > 0
    for share in np.linspace(0.01, 0.97, CUTS):
        cut.write_bytes(content[: int(share * len(content))])
        with pytest.raises(LogError, match=cut.name):
            read_all(cut)


@pytest.mark.parametrize("kind", KINDS)
def test_a_flipped_bit_gives_samples_or_a_log_error(
    kind: str, whole: dict[str, Path], tmp_path: Path
) -> None:
    content = whole[kind].read_bytes()
    flipped_path = tmp_path / whole[kind].name
    draw, refused = random.Random(11), 0
    for number in range(FLIPS):
        flipped = bytearray(content)
        # half of them where the head is, which matters more than samples
        reach = len(flipped) if number % 2 else min(1000, len(flipped))
        flipped[draw.randrange(reach)] ^= 1 << draw.randrange(8)
        flipped_path.write_bytes(flipped)
        try:
            assert read_all(flipped_path) <= 4 * COUNT
        except LogError:
            refused += 1
    assert refused > 0


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("content", [b"", b"hello\n", bytes(3000), b"\xff" * 3000])
def test_what_is_no_such_file_is_refused(
    kind: str, content: bytes, whole: dict[str, Path], tmp_path: Path
) -> None:
    path = tmp_path / whole[kind].name
    path.write_bytes(content)
    with pytest.raises(LogError, match=path.name):
        read_all(path)


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("first_peak", "peak_one", "no column first_peak"),
        (",39.9,", ",39.9", "cut short"),
        (",39.9,", ",a lot,", "is damaged"),
    ],
)
def test_a_damaged_table_of_impacts_is_told(tmp_path: Path, old: str, new: str, match: str) -> None:
    with Scratch(tmp_path) as scratch:
        recording = runs.recorded(runs.write_run(tmp_path / "run.mcap"), scratch)
        write = FORMATS["csv"].write
        assert write is not None
        *_, path = write(recording, tmp_path / "run.csv", str)
        path.write_text(path.read_text().replace(old, new))
        with pytest.raises(LogError, match=rf"run\.impacts\.csv: .*{match}"):
            FORMATS["csv"].read(path, scratch)
