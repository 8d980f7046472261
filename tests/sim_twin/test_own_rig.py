"""A subject from a simulator function and tables: how files become blocks, and draws become rigs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from sim_twin.own_rig import (
    Cause,
    Draw,
    OwnRig,
    Simulator,
    Widening,
    binned,
    cause,
    number,
    parts,
)

Array = NDArray[np.float64]
STEEPER = cause("steeper", "slope", number("slope", "m/s", (2.0, 9.0)))
TIMES = np.arange(64) / 32


def simulate(p: Any, given: Mapping[str, Array]) -> dict[str, Array]:
    return {"way": p.offset + p.slope * given["time"]}


def rig(**more: Any) -> Simulator:
    return Simulator(
        simulate, {"way": "m"}, **{"rig": {"slope": (1.0, 0.1)}, "causes": (STEEPER,)} | more
    )  # fmt: skip


SLOPE = {"rig": {"slope": (1.0, 0.1), "offset": (0.0, 0.0)}}


def table(*offsets: float) -> dict[str, Array]:
    way = np.concatenate([offset + TIMES for offset in offsets])
    return {
        "drop": np.repeat(np.arange(len(offsets)), len(TIMES)),
        "time": np.tile(TIMES, len(offsets)),
        "way": way,
    }


@pytest.mark.parametrize(
    ("more", "files", "blocks"),
    [
        ({"block": "drop"}, [table(0.0, 1.0, 2.0)], 3),
        ({}, [table(0.0), table(1.0)], 2),
        ({"cut": 4}, [table(0.0)], 4),
        ({"block": "drop", "cut": 2}, [table(0.0, 1.0), table(2.0)], 6),
    ],
    ids=["column", "files", "cut", "all"],
)
def test_blocks_are_numbers_in_a_column_or_files_and_may_be_cut(
    more: dict[str, Any], files: list[dict[str, Array]], blocks: int
) -> None:
    subject, measured = rig(**SLOPE, **more).measured(files)
    assert measured.shape == (blocks, 16)
    assert subject.layout.size == 16
    assert {(cell.channel, cell.unit) for cell in subject.layout.cells} == {("way", "m")}
    assert isinstance(rig(**SLOPE), OwnRig)


def test_blocks_come_as_they_were_measured() -> None:
    _, measured = rig(**SLOPE, block="drop").measured([table(0.0, 1.0, 2.0, 3.0)])
    assert np.diff(measured.mean(axis=1)) == pytest.approx([1.0, 1.0, 1.0])


def test_a_rig_is_one_in_all_its_blocks_and_starts_anew_in_each() -> None:
    start = {"offset": (5.0, 0.5)}
    subject, _ = rig(start=start, noise={"way": 1e-3}, block="drop").measured([table(0.0, 1.0)])
    [(several,), (one,), (same,)] = subject.observe([Draw((), 1, blocks=40), Draw((), 1), Draw((), 1)])
    assert several is not None
    assert one is not None
    assert np.array_equal(several[:1], one)
    assert np.array_equal(one, same if same is not None else 0)
    slopes, offsets = several[:, -1] - several[:, 0], several.mean(axis=1)
    assert np.std(slopes) < 2e-3  # noise alone, of means of two samples
    assert np.std(offsets) == pytest.approx(0.5, rel=0.3)
    rigs = [got[0] for got in subject.observe([Draw((), seed) for seed in range(60)]) if got[0] is not None]
    # between the middles of the first and the last part there are 15/16 of the record
    assert np.std([each[0, -1] - each[0, 0] for each in rigs]) == pytest.approx(0.1 * 15 / 8, rel=0.3)


def test_wider_rigs_differ_by_more_and_by_nothing_else() -> None:
    subject, _ = rig(**SLOPE | {"noise": {"way": 0.5}}).measured([table(0.0)])
    assert isinstance(subject, Widening)
    draws = [Draw((), seed) for seed in range(20)]
    one, wide = (
        np.array([got[0] for got in each.observe(draws)], np.float64)
        for each in (subject, subject.wider(2.0))
    )
    sound = parts(TIMES)
    assert wide - sound == pytest.approx(2 * (one - sound), abs=1e-5)


def test_an_effect_sets_the_numbers_that_its_parameters_are_named_after() -> None:
    subject, _ = rig(**SLOPE).measured([table(0.0)])
    steeper = (("steeper", {"slope": 4.0}),)
    [(moved, also)] = subject.observe([Draw((), 1, (steeper, ()))])
    [(before,)] = subject.observe([Draw(steeper, 1)])
    assert moved is not None
    assert before is not None
    assert np.array_equal(moved, before)
    assert moved[0, -1] - moved[0, 0] == pytest.approx(4.0 * 15 / 8)
    assert also is not None
    assert not np.array_equal(also, moved)


def test_each_block_has_the_inputs_of_a_measured_one() -> None:
    files = [{**table(0.0), "time": factor * TIMES} for factor in (1.0, 2.0, 3.0)]
    subject, _ = rig(rig={"slope": (1.0, 0.0), "offset": (0.0, 0.0)}).measured(files)
    [(blocks,)] = subject.observe([Draw((), 3, blocks=3)])
    assert blocks is not None
    assert sorted(np.round(blocks[:, -1] / blocks[:, -1].min())) == [1, 2, 3]


def test_a_simulation_that_gives_no_number_is_a_failed_run() -> None:
    subject, _ = rig(rig={"slope": (np.inf, 0.0), "offset": (0.0, 0.0)}).measured([table(0.0)])
    with np.errstate(invalid="ignore"):
        assert subject.observe([Draw((), 1, ((), ()))]) == [(None, None)]


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"causes": (cause("drag", "air", number("drg", "", (1.0, 2.0))),)}, "drag sets drg; the rig has"),
        ({"noise": {"wy": 1.0}}, "noise of wy; the channels are way"),
        ({"start": {"slope": (1.0, 0.0)}}, "slope: of the rig, or of each start?"),
    ],
    ids=["cause", "noise", "twice"],
)  # fmt: skip
def test_tables_that_do_not_go_together_are_refused(more: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words.replace("?", r"\?")):
        rig(**SLOPE | more)


def test_files_that_lack_a_channel_or_have_other_numbers_are_refused() -> None:
    with pytest.raises(ValueError, match="no column way; there are drop, time"):
        rig(**SLOPE).measured([{name: each for name, each in table(0.0).items() if name != "way"}])
    peaks = rig(**SLOPE, fingerprint=lambda record: {"peaks": record["way"][record["way"] > 1.5]})
    with pytest.raises(ValueError, match=r"block 2 has \{'peaks': 64\} numbers, the first \{'peaks': 15\}"):
        peaks.measured([table(0.0), table(2.0)])


def test_a_record_too_short_for_its_parts_is_refused() -> None:
    with pytest.raises(ValueError, match="8 samples cannot be cut into 16 parts"):
        parts(TIMES[:8])


def test_means_by_parts_and_by_classes() -> None:
    assert parts(np.arange(8), 4).tolist() == [0.5, 2.5, 4.5, 6.5]
    means = binned([1.0, 2.0, 3.0, 4.0], [0.1, 0.2, 1.5, 9.0], [0, 1, 2, 3])
    assert means[:2].tolist() == [1.5, 3.0]
    assert np.isnan(means[2])


def test_a_cause_has_the_parameters_that_it_is_given() -> None:
    assert Cause("steeper", "slope", (number("slope", "m/s", (2.0, 9.0)),)) == STEEPER
