"""The command line inside the test's process: the same code, without waiting for Python to start."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass

import pytest

from rig.commands.cli import main


@dataclass(frozen=True, slots=True)
class Answer:
    """What a command printed and how it ended."""

    code: int
    out: str
    err: str


Call = Callable[..., Answer]


def caller(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Call:
    """Return a function that runs a command to its end."""

    def call(*arguments: object) -> Answer:
        monkeypatch.setattr(sys, "argv", ["rattle", *map(str, arguments)])
        monkeypatch.setenv("COLUMNS", "200")
        capfd.readouterr()
        with pytest.raises(SystemExit, match=r"^\d+$") as ended:
            main()
        captured = capfd.readouterr()
        return Answer(int(str(ended.value)), captured.out, captured.err)

    return call
