"""Instruments are let go at the end, and one that hangs there keeps nobody."""

from __future__ import annotations

import threading
import time
from types import SimpleNamespace
from typing import Any

import pytest

from rig.session import devices
from rig.session.devices import Devices


class Part(SimpleNamespace):
    """Notes that it was closed; hangs there if it is to."""

    def __init__(self, name: str, told: list[str], hangs: threading.Event | None = None) -> None:
        super().__init__(name=name, told=told, hangs=hangs)

    def close(self) -> None:
        self.told.append(self.name)
        if self.hangs is not None:
            self.hangs.wait()


def test_one_that_hangs_at_the_end_keeps_neither_the_others_nor_the_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(devices, "JOIN_S", 0.2)
    told, goes_on = list[str](), threading.Event()
    motion: Any = None
    held = SimpleNamespace(close=lambda: told.append("lock"))
    opened: Any = {
        "actuator": Part("generator", told),
        "encoder": Part("encoder", told, goes_on),
        "card": Part("card", told, goes_on),
        "loggers": {"thermometer": Part("thermometer", told)},
        "locks": [held],
    }
    since_s = time.monotonic()
    Devices(spare=None, motion=motion, **opened).close()
    assert time.monotonic() - since_s < 1.0
    assert told == ["generator", "thermometer", "encoder", "card", "lock"]
    goes_on.set()
