"""The file of a surrogate: nothing in it runs, all of it comes back, and what is wrong with it is said."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest

from daq.errors import ConfigurationError, LogError, RattleError
from rig.files.surrogate_file import load_surrogate, save_surrogate
from sim_twin.surrogates.surrogate import Surrogate, learnt_and_tested
from tests.sim_twin.surrogates.test_surrogate import CHANNELS, three_clearances

RIG = "planar_slider_crank"


def surrogate(kind: str = "grnn") -> Surrogate:
    return learnt_and_tested(three_clearances(), RIG, CHANNELS, "angle", kind, width=0.3)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    save_surrogate(surrogate(), tmp_path / "crank.npz")
    return tmp_path / "crank.npz"


@pytest.mark.parametrize("kind", ["rbf", "grnn"])
def test_all_of_it_comes_back(tmp_path: Path, kind: str) -> None:
    saved = surrogate(kind)
    save_surrogate(saved, tmp_path / "crank.npz")
    found = load_surrogate(tmp_path / "crank.npz", RIG, dict.fromkeys(CHANNELS))
    asked = three_clearances().inputs
    assert np.array_equal(found.predict(asked), saved.predict(asked))
    assert found.ranges == saved.ranges
    assert found.tested == saved.tested
    assert found.network.get_params() == saved.network.get_params()


def test_a_person_can_read_what_it_says_of_itself(file: Path) -> None:
    with zipfile.ZipFile(file) as packed:
        about = json.loads(packed.read("surrogate.json"))
    assert about["trained"]["clearance_1"] == [1.0, 2.0]
    assert about["rig"] == RIG


def test_a_file_that_is_there_is_never_changed(file: Path) -> None:
    before = file.read_bytes()
    with pytest.raises(RattleError, match="is there already"):
        save_surrogate(surrogate(), file)
    assert file.read_bytes() == before


def test_one_of_another_rig_or_of_other_channels_is_refused(file: Path) -> None:
    with pytest.raises(ConfigurationError, match='rig = planar_slider_crank: "impact_beam"'):
        load_surrogate(file, "impact_beam")
    with pytest.raises(ConfigurationError, match="channels = z: only what the run has: x, y"):
        load_surrogate(file, RIG, {"x": 0, "y": 0})


def rewritten(file: Path, name: str, content: bytes) -> Path:
    """With one part of it replaced."""
    with zipfile.ZipFile(file) as packed:
        parts = {each: packed.read(each) for each in packed.namelist()}
    with zipfile.ZipFile(file, "w") as packed:
        for each, data in (parts | {name: content}).items():
            packed.writestr(each, data)
    return file


def array(values: object) -> bytes:
    import io

    content = io.BytesIO()
    np.save(content, np.asarray(values))
    return content.getvalue()


@pytest.mark.parametrize(
    ("spoil", "told"),
    [
        (lambda file: file.write_bytes(file.read_bytes()[:-300]), "damaged, or no surrogate"),
        (lambda file: file.write_bytes(b"hello"), "damaged, or no surrogate"),
        (lambda file: file.unlink(), "No such file"),
        (lambda file: rewritten(file, "surrogate.json", b"{}"), "no surrogate of this version"),
        (lambda file: rewritten(file, "outputs_.npy", array(np.ones((2, 2)))), "damaged, or no surrogate"),
        (lambda file: rewritten(file, "prototypes_.npy", array(np.full((3, 3), np.nan))), "is not finite"),
        (lambda file: rewritten(file, "outputs_.npy", array(["a"])), "damaged, or no surrogate"),
        (lambda file: rewritten(file, "outputs_.npy", array([{}])), "damaged, or no surrogate"),
    ],
)
def test_a_damaged_file_is_said_to_be(file: Path, spoil, told: str) -> None:
    spoil(file)
    with pytest.raises(LogError, match=told):
        load_surrogate(file, RIG)


def test_no_flipped_bit_goes_unseen(file: Path) -> None:
    whole = bytearray(file.read_bytes())
    found = load_surrogate(file, RIG)
    asked = three_clearances().inputs[:50]
    for at in range(0, len(whole), len(whole) // 200):
        spoilt = bytearray(whole)
        spoilt[at] ^= 4
        file.write_bytes(spoilt)
        try:
            again = load_surrogate(file, RIG)
        except RattleError:
            continue
        assert np.array_equal(again.predict(asked), found.predict(asked))  # a date, or padding
