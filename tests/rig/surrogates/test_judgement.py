"""The tables of surrogates: they are gone on with, and what they say of the paper follows from them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from rig.pages.content import page
from rig.surrogates import judgement
from rig.surrogates.judgement import HEADINGS, PIECES, claims, document, judged, markdown, parts, tables
from rig.surrogates.recordings import Setting
from rig.twin.recorded_samples import each_once
from sim_twin.surrogates.comparison import (
    ALL,
    AMOUNTS,
    CLEARANCE,
    METHODS,
    NEAREST,
    OVERS,
    POINTS,
    SPEED,
    SPLITS,
    Row,
)
from sim_twin.surrogates.judging import Score
from tests.rig.surrogates.crank_logs import write_recordings

SETTINGS = [Setting(1, 1, speed) for speed in (150, 200)]
TEN, GOAL, TEN_GENERAL, GENERAL = "RBF, 10 units", "RBF, error goal", "GRNN, 10 units", "GRNN, 500 units"


def rows(explained: dict[tuple[str, str, str], float]) -> list[Row]:
    """Tables in which methods explain so much of the variance, by split, amount and method; 0 else."""
    return [
        Row(
            split,
            amount,
            over,
            method,
            Score((1 - explained.get((split, amount, method), 0.0)) ** 0.5, 0.9, 0.3, 0.1),
        )
        for split in SPLITS
        for amount in AMOUNTS
        for over in OVERS
        for method in METHODS
    ]


def verdicts(explained: dict[tuple[str, str, str], float]) -> list[bool]:
    return [holds for _, holds, _ in claims(rows(explained))]


def test_claims_hold_where_the_numbers_say_so() -> None:
    exact, ten_ahead, many_ahead, unsuitable, elsewhere = range(5)
    assert verdicts({}) == [False, False, False, True, False]
    assert verdicts({(POINTS, NEAREST, TEN): 0.95})[exact]
    assert not verdicts({(POINTS, NEAREST, TEN): 0.85})[exact]
    near = verdicts({(POINTS, NEAREST, TEN): 0.3, (POINTS, NEAREST, TEN_GENERAL): 0.2})
    assert (near[ten_ahead], near[many_ahead]) == (True, False)
    near = verdicts({(POINTS, NEAREST, GOAL): 0.7, (POINTS, NEAREST, GENERAL): 0.6})
    assert (near[ten_ahead], near[many_ahead], near[unsuitable]) == (False, True, False)
    assert verdicts({(POINTS, ALL, GOAL): 0.7}) == verdicts({})  # the paper had few points
    both = {(SPEED, ALL, GENERAL): 0.7, (CLEARANCE, NEAREST, TEN): 0.6}
    assert verdicts(both)[elsewhere]
    assert not verdicts({(SPEED, ALL, GENERAL): 0.7})[elsewhere]


def test_of_settings_that_were_not_there_nothing_is_claimed() -> None:
    few = [row for row in rows({}) if row.split not in (SPEED, CLEARANCE)]
    assert len(claims(few)) == 4
    assert claims([]) == []


def test_page_json_and_text_have_every_row() -> None:
    table = rows({(POINTS, NEAREST, GENERAL): 0.64})
    text = page("Surrogates", [], [("What holds", parts(table))])
    claim = text[text.index("of many, the RBF network is ahead of the GRNN") :]
    assert claim.index("does not hold") < claim.index("the GRNN is not suitable")
    assert "GRNN, 500 units 64%" in text
    record = json.loads(document(table, [Path("a.mcap")]))
    assert len(record["rows"]) == len(table)
    (rmse, rmse_lines), (distance, distance_lines) = tables(table).items()
    assert rmse == "rmse, of all the floor is 0.90"
    assert distance == "distance of the distributions, of all the floor is 0.10"
    assert len(rmse_lines) == len(distance_lines) == PIECES
    assert dict(zip(HEADINGS, rmse_lines[0], strict=True))[GENERAL] == "0.60"
    assert distance_lines[0][3:] == ["0.30"] * len(METHODS)
    assert f"| {' | '.join(rmse_lines[0])} |" in markdown(table)
    assert "| the GRNN is not suitable | does not hold |" in markdown(table)


def test_what_was_judged_is_not_judged_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    logs = each_once(write_recordings(tmp_path / "logs", SETTINGS, 1.0), lambda _: None)
    done: list[tuple[str, str, str]] = []

    def compared(paths: tuple[Path, ...], split: str, amount: str, over: str) -> list[Row]:
        done.append((split, amount, over))
        if len(done) == 4:
            raise KeyboardInterrupt
        return [row for row in rows({}) if (row.split, row.learnt, row.over) == (split, amount, over)]

    monkeypatch.setattr(judgement, "_compared", compared)
    with pytest.raises(KeyboardInterrupt):
        judged(logs, tmp_path, None, lambda _: None)
    heard: list[float] = []
    assert judged(logs, tmp_path, None, heard.append) == rows({})
    assert heard[0] == 3
    assert len(done) == PIECES + 1
    (tmp_path / sorted(each.name for each in tmp_path.glob("rows-*"))[0]).write_text("[{")  # cut short
    judged(logs, tmp_path, None, heard.append)
    assert len(done) == PIECES + 2
    judged(dict(list(logs.items())[:1]), tmp_path, None, heard.append)  # other logs
    assert len(done) == 2 * PIECES + 2
    monkeypatch.setattr(judgement, "version", lambda name: f"another {name}")
    judged(logs, tmp_path, None, heard.append)  # other libraries
    assert len(done) == 3 * PIECES + 2
    monkeypatch.undo()
    monkeypatch.setattr(judgement, "_compared", compared)
    other = tmp_path / "changed.py"
    other.write_text("# other code")
    monkeypatch.setattr(judgement.recorded_samples, "__file__", str(other))
    judged(logs, tmp_path, None, heard.append)
    assert len(done) == 4 * PIECES + 2
