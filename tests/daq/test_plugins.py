"""What other packages offer is taken by name; what is wrong with one is told and costs the others nothing."""

from __future__ import annotations

from pathlib import Path

import pytest

from daq.plugins import plugins
from tests.fake_packages import install

GROUP = "rattle.test_things"


def test_nobody_offers_anything() -> None:
    assert plugins(GROUP, int) == plugins("rattle.other_things", int)
    assert plugins(GROUP, int).found == {}
    assert plugins(GROUP, int).faults == ()


def test_objects_come_by_name_and_faults_as_sentences(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    points = {
        "two": "added_numbers:TWO",
        "one": "added_numbers:ONE",
        "built_in": "added_numbers:ONE",
        "word": "added_numbers:WORD",
        "absent": "added_numbers:THREE",
        "broken": "added_broken_module:ONE",
    }
    install(monkeypatch, tmp_path, "added-numbers", GROUP, points, "ONE, TWO, WORD = 1, 2, 'three'\n")
    (tmp_path / "added_broken_module.py").write_text("raise RuntimeError('no licence')\n")
    offered = plugins(GROUP, int, taken=("built_in",))
    assert offered.found == {"one": 1, "two": 2}
    whose = "of added-numbers 1.2 is not used:"
    assert offered.faults == (
        f"{GROUP}: absent {whose} it does not load "
        "(AttributeError: module 'added_numbers' has no attribute 'THREE')",
        f"{GROUP}: broken {whose} it does not load (RuntimeError: no licence)",
        f"{GROUP}: built_in {whose} that of rattle itself has the name",
        f"{GROUP}: word {whose} added_numbers:WORD is of str, wanted is int",
    )


def test_of_two_packages_with_one_name_the_first_is_used_and_told_with_the_other(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name, value in (("pack-b", 2), ("pack-a", 1)):
        module = name.replace("-", "_")
        install(monkeypatch, tmp_path, name, GROUP, {"same": f"{module}:THING"}, f"THING = {value}\n")
    offered = plugins(GROUP, int)
    assert offered.found == {"same": 1}
    assert offered.faults == (f"{GROUP}: same of pack-b 1.2 is not used: that of pack-a 1.2 has the name",)


@pytest.mark.parametrize("mistyped", ["rattle.rig", "rattle.rgis", "Rattle.rigs"])
def test_a_group_that_is_mistyped_is_told_with_the_one_that_is_meant(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, mistyped: str
) -> None:
    install(monkeypatch, tmp_path, "pack-a", mistyped, {"shaking_table": "pack_a:KIND"})
    told = f"{mistyped}: shaking_table of pack-a 1.2 is not used: there is no such group; did you mean"
    assert plugins("rattle.rigs", int).faults == (f"{told} rattle.rigs?",)
    assert plugins("rattle.formats", int).faults == ()  # told once, and beside what it is nearest to


@pytest.mark.parametrize("known", ["rattle.sensors", "pytest11", "rattlesnake.rigs"])
def test_a_group_that_is_known_or_another_programs_is_no_mistyped_one(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, known: str
) -> None:
    install(monkeypatch, tmp_path, "pack-a", known, {"shaking_table": "pack_a:KIND"})
    assert plugins("rattle.rigs", int).faults == ()
