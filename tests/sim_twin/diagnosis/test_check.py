"""What a person gets wrong in a subject is told in words before anything is diagnosed with it."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from sim_twin.diagnosis.cause import Cause
from sim_twin.diagnosis.check import Check, check
from sim_twin.diagnosis.fingerprint import Cell, Layout
from sim_twin.diagnosis.subject import Draw, Named, Observed, Subject
from sim_twin.effects import Parameter

Blocks = NDArray[np.float32]
PUSH = Cause("push", "here", (Parameter("size", "N", ((2.0, 9.0),)), Parameter("place", "m", ((0.0, 1.0),))))
GAIN = Cause("gain", "sensor", (Parameter("factor", "", ((1.5, 3.0),)),), sensing=True)
_MEANS = np.array([4.0, 5.0, 6.0, 7.0, 40.0, 50.0])


@dataclass(frozen=True)
class Little:
    """Six numbers of two channels; what is wrong with it, by name."""

    causes: tuple[Cause, ...] = (PUSH, GAIN)
    wrong: str = ""
    block: float = 0.5

    @property
    def layout(self) -> Layout:
        torques = (Cell(0, "torque", "out"), Cell(0, "torque", "back"))
        return Layout((Cell(0, "height", "course", 4), *torques))

    def observe(self, draws: Sequence[Draw]) -> list[Observed]:
        if self.wrong == "raises":
            raise KeyError("sise")
        return [tuple(self._one(draw, (*draw.effects, *shown)) for shown in draw.sensing) for draw in draws]

    def _one(self, draw: Draw, effects: tuple[Named, ...]) -> Blocks | None:
        rng = np.random.default_rng(None if self.wrong == "no seed" else draw.seed)
        if self.wrong == "one rig":
            rng = np.random.default_rng(1)
        blocks = draw.blocks + (self.wrong == "blocks")
        rig, each = 0.3 * rng.standard_normal(6), self.block * rng.standard_normal((blocks, 6))
        numbers = _MEANS + np.array([1, 1, 1, 1, 5, 5]) * (rig + each)
        for name, values in effects:
            if name == "push" and self.wrong == "push fails":
                return None
            if name == "push":
                size = float(values["size"])
                place = 0.5 if self.wrong == "misspelt" else float(values["place"])
                numbers[:, :4] += size * np.array([1.0, 1 - place, place, 1.0])
            if name == "gain" and self.wrong != "no gain":
                numbers[:, 4:] *= float(values["factor"])
                if self.wrong == "no seed in gain":
                    numbers[:, 4:] += np.random.default_rng().standard_normal(2)
        if self.wrong == "faint":
            numbers[:, :4] = numbers[:, :4] * 1e-3 + 1e4 * each[:, :4]
        if self.wrong == "dead":
            numbers[:, 5] = 3.0
        if self.wrong == "all fail":
            return None
        return numbers.astype(np.float32)


def recorded(seed: int = 1000, blocks: int = 4) -> Blocks:
    [(found,)] = Little().observe([Draw((), seed, blocks=blocks)])
    assert found is not None
    return found


def looked(subject: Little, measured: Blocks | None = None, motions: int = 80) -> Check:
    return check(subject, recorded() if measured is None else measured, subject.observe, 0, motions)


def test_a_sound_subject_is_told_nothing_and_finds_again_what_is_hidden() -> None:
    found = looked(Little())
    assert (found.faults, found.remarks) == ((), ())
    assert {name: each[:2] for name, each in found.found_again.items()} == {
        "nothing": (3, 3), "push": (3, 3), "gain": (3, 3)
    }  # fmt: skip


@pytest.mark.parametrize(
    ("subject", "words"),
    [
        (Little(wrong="raises"), r"observe failed: KeyError: 'sise' \(test_check.py, line \d+\)"),
        (Little(wrong="no seed"), "the same draw gives other numbers"),
        (Little(wrong="no seed in gain"), "the same draw gives other numbers"),
        (Little(wrong="one rig"), "every healthy rig is the same: draw.seed is not used"),
        (Little(wrong="blocks"), r"fingerprint of shape \(3, 6\), wanted is \(2, 6\)"),
        (Little(wrong="misspelt"), "push.place moves nothing: does observe take it by that name"),
        (Little(wrong="no gain"), "gain changes nothing: does observe look for factor"),
        (Little(wrong="push fails"), "every rig with push failed, so that it could neither"),
        (Little(wrong="all fail"), "32 of 32 healthy rigs failed"),
        (Little(causes=()), "no cause is named"),
        (Little(causes=(PUSH, PUSH)), "push is there twice"),
        (Little(causes=(Cause("drag", "air", ()),)), "drag has no parameter"),
        (Little(causes=(Cause("drag", "air", (Parameter("c", "", ((2.0, 1.0),)),)),)), r"drag.c lies within"),
    ],
    ids=lambda each: each.wrong if isinstance(each, Little) else "",
)
def test_what_makes_every_answer_worthless_is_a_fault(subject: Little, words: str) -> None:
    [fault] = looked(subject).faults
    assert re.search(words, fault), fault


def test_a_subject_that_other_processes_cannot_have_is_a_fault() -> None:
    cause = replace(GAIN, allows=lambda _: True)
    [fault] = looked(Little(causes=(PUSH, cause))).faults
    assert "cannot be sent to other processes" in fault


@dataclass(frozen=True)
class Exact(Little):
    """With more digits than are kept."""

    def observe(self, draws: Sequence[Draw]) -> list[Observed]:
        shown = Little.observe(self, draws)
        return [tuple(None if one is None else one.astype(np.float64) / 3 for one in each) for each in shown]

    def kept(self, draws: Sequence[Draw]) -> list[Observed]:
        shown = self.observe(draws)
        return [tuple(None if one is None else np.float32(one) for one in each) for each in shown]


def test_numbers_are_compared_as_exactly_as_they_are_kept() -> None:
    exact = Exact()
    assert check(exact, recorded() / 3, exact.kept, 0, 80).faults == ()


class Apart(Little):
    """Two runs, a channel each, that are simulated one by one."""

    @property
    def layout(self) -> Layout:
        cells = [
            Cell(int(cell.channel == "torque"), cell.channel, cell.what, cell.size)
            for cell in Little().layout.cells
        ]
        return Layout(tuple(cells[::-1] if self.wrong == "order" else cells))

    def only(self, numbers: tuple[int, ...]) -> Subject:
        return One(run=numbers[0] ^ (self.wrong == "the other"))


@dataclass(frozen=True)
class One(Little):
    """One of its runs."""

    run: int = 0

    def observe(self, draws: Sequence[Draw]) -> list[Observed]:
        columns = slice(4, None) if self.run else slice(4)
        return [
            tuple(one if one is None else one[:, columns] for one in each) for each in Little().observe(draws)
        ]


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ("order", ["its cells have to stand run after run"]),
        ("the other", ["only((0,)) shows", "only((1,)) shows"]),
        ("", []),
    ],
)
def test_runs_that_are_simulated_one_by_one_show_what_they_do_among_all(wrong: str, words: list[str]) -> None:
    subject = Apart(wrong=wrong)
    faults = check(subject, recorded(), subject.observe, 0, 80).faults
    assert len(faults) == len(words)
    assert all(each in fault for each, fault in zip(words, faults, strict=True))


def test_numbers_that_differ_in_another_process_are_a_fault() -> None:
    sound, other = Little(), Little(block=0.6)
    [fault] = check(sound, recorded(), other.observe).faults
    assert fault.startswith("in another process the same draw gives other numbers")


@pytest.mark.parametrize(
    ("measured", "words"),
    [
        (recorded()[:, :5], r"shape \(4, 5\), wanted is \(blocks, 6\)"),
        (recorded()[0], r"shape \(6,\)"),
        (np.where(np.arange(6) == 4, np.nan, recorded()), "block 1: torque, out is no number"),
    ],
    ids=["numbers", "no blocks", "nan"],
)
def test_measured_fingerprints_of_another_shape_or_without_a_number_are_a_fault(
    measured: Blocks, words: str
) -> None:
    [fault] = looked(Little(), measured).faults
    assert re.search(words, fault), fault


REMARKS: list[tuple[str, Little, Callable[[Blocks], Blocks], str]] = [
    ("another unit", Little(), lambda x: 1000 * x, "height: measured numbers are about 5.+e\\+03"),
    ("one block", Little(), lambda x: x[:1], "one measured block only"),
    ("too narrow", Little(block=0.1), lambda x: x, "healthy rigs are too narrow"),
    ("too wide", Little(block=4.0), lambda x: x, "too wide from block to block"),
    ("no noise", Little(block=0.0), lambda x: x, "noise is missing"),
    ("never moves", Little(wrong="dead"), lambda x: x, "1 of 6 numbers are .* elsewhere: torque, back"),
    ("faint", Little(wrong="faint"), lambda x: x, "push.size moves no number by more than 1.6e-06"),
    ("effort", Little(), lambda x: x, "too few"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "subject", "change", "words"), REMARKS, ids=[each[0] for each in REMARKS])
def test_what_decides_an_answer_in_silence_is_remarked(
    name: str, subject: Little, change: Callable[[Blocks], Blocks], words: str
) -> None:
    found = looked(subject, change(recorded()), 30 if name == "effort" else 80)
    assert found.faults == ()
    assert any(re.search(words, each) for each in found.remarks), found.remarks
