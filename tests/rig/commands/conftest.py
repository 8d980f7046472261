from __future__ import annotations

import pytest

from tests.rig.commands.cli import Call, caller


@pytest.fixture
def call(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Call:
    return caller(monkeypatch, capfd)
