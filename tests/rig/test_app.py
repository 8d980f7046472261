"""The devices of a run."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from daq.channel import Channel
from daq.errors import ConfigurationError
from rig.app import check_names


def test_two_instruments_do_not_record_one_name() -> None:
    sound, heat = Channel("room.sound", "V"), Channel("room.heat", "V")
    devices: Any = SimpleNamespace(card=SimpleNamespace(channels=(sound, heat)), logged=(sound,))
    with pytest.raises(ConfigurationError, match=r"room\.sound = \(twice\)"):
        check_names(devices, "bench.toml")
    devices.logged = (Channel("room.damp", "V"),)
    check_names(devices, "bench.toml")
