"""The table of surrogates: it is gone on with, and what it says of the paper follows from its numbers."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from rig.pages.content import page
from rig.surrogates import judgement
from rig.surrogates.judgement import PIECES, cells, claims, document, judged, parts
from rig.surrogates.recordings import Setting
from sim_twin.surrogates.comparison import DENSE, OVERS, SPLITS, Row
from sim_twin.surrogates.judging import Score
from tests.rig.surrogates.crank_logs import write_recordings

SETTINGS = [Setting(1, 1, speed) for speed in (150, 200)]


def rows(explained: dict[tuple[str, str], float]) -> list[Row]:
    """A table in which methods explain so much of the variance, by split and method; 0 else."""
    return [
        Row(split, over, method, Score((1 - explained.get((split, method), 0.0)) ** 0.5, 0.9, 0.3, 0.1))
        for split in SPLITS
        for over in OVERS
        for method in ("RBF, 10 units", "GRNN")
    ]


def verdicts(explained: dict[tuple[str, str], float]) -> list[bool]:
    return [holds for _, holds, _ in claims(rows(explained))]


def test_claims_hold_where_the_numbers_say_so() -> None:
    assert verdicts({}) == [False, False, True, False]
    assert verdicts({(DENSE, "RBF, 10 units"): 0.95, (DENSE, "GRNN"): 0.3}) == [True, True, True, False]
    assert verdicts({(DENSE, "RBF, 10 units"): 0.2, (DENSE, "GRNN"): 0.6}) == [False, False, False, False]
    both = {("held-out speed", "GRNN"): 0.7, ("held-out clearance", "RBF, 10 units"): 0.6}
    assert verdicts(both) == [False, False, True, True]
    assert verdicts({("held-out speed", "GRNN"): 0.7}) == [False, False, True, False]


def test_of_settings_that_were_not_there_nothing_is_claimed() -> None:
    few = [row for row in rows({}) if row.split not in ("held-out speed", "held-out clearance")]
    assert len(claims(few)) == 3


def test_page_and_json_have_every_row() -> None:
    table = rows({(DENSE, "GRNN"): 0.64})
    text = page("Surrogates", [], [("What holds", parts(table))])
    assert "Does not hold: the RBF network is ahead of the GRNN" in text
    assert "GRNN 64%" in text
    record = json.loads(document(table, [Path("a.mcap")]))
    assert len(record["rows"]) == len(table)
    assert cells(table[0])[3:] == ["1.00", "1.11", "0.30", "3.00"]


def test_what_was_judged_is_not_judged_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    logs = write_recordings(tmp_path / "logs", SETTINGS, 1.0)
    done: list[tuple[str, str]] = []

    def compared(paths: tuple[Path, ...], split: str, over: str) -> list[Row]:
        done.append((split, over))
        if len(done) == 4:
            raise KeyboardInterrupt
        return [row for row in rows({}) if (row.split, row.over) == (split, over)]

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
    judged(logs[:1], tmp_path, None, heard.append)  # other logs
    assert len(done) == 2 * PIECES + 2
