"""The tables of rigs and instruments: every place that they name is there, and says the same of itself."""

from __future__ import annotations

from pkgutil import resolve_name

import pytest
import rerun  # noqa: F401 - it keeps what it opens when it is first imported, which is no test's leak

from daq.quantity import Quantity, settings_of
from rig.files.quantity import si_factor
from rig.instruments import INSTRUMENTS, actuator_of
from rig.rigs import RIGS


@pytest.mark.parametrize("name", RIGS)
def test_a_rig_is_what_the_table_calls_it(name: str) -> None:
    kind = RIGS[name]
    assert (kind.name, kind.nominal().model.name) == (name, name)
    assert kind.nominal().model.parameters is kind.parameters
    assert resolve_name(kind.picture).rig == name
    assert set(kind.set_up) | set(kind.by_hand) <= set(kind.model)
    assert actuator_of(kind.actuator).highest
    assert set(kind.extras) <= set(INSTRUMENTS)


@pytest.mark.parametrize("name", RIGS)
def test_a_default_may_stand_in_a_file(name: str) -> None:
    for setting in (*RIGS[name].model.values(), *settings_of(RIGS[name].drive).values()):
        if isinstance(setting.meaning, Quantity) and isinstance(setting.default, float):
            shown = setting.default / si_factor(setting.meaning.unit)
            assert setting.meaning.low * (1 - 1e-9) <= shown <= setting.meaning.high * (1 + 1e-9)


@pytest.mark.parametrize("table", INSTRUMENTS)
def test_every_place_of_an_instrument_is_there(table: str) -> None:
    instrument = INSTRUMENTS[table]
    assert callable(resolve_name(instrument.settings).place)
    assert all(callable(resolve_name(place)) for place in instrument.drivers.values())
    if instrument.emulator:
        assert callable(resolve_name(instrument.emulator))
    if instrument.actuator is not None:
        asked = instrument.actuator
        places = (asked.beyond, asked.hurried, asked.rig, asked.devices)
        assert all(callable(resolve_name(place)) for place in places)
        assert hasattr(resolve_name(instrument.settings), asked.highest)
