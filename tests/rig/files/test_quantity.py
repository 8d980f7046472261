from __future__ import annotations

import contextlib
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rig.files.quantity import _USUAL, QuantityError, _by_pint, _named, si_unit, si_value

# by definition: standard gravity 9.80665 m/s2, pound-force 4.4482216152605 N, inch 25.4 mm
EXACT = [
    ("0.127 mm", "mm", 0.127e-3),
    ("127 µm", "mm", 127e-6),
    ("127 μm", "mm", 127e-6),
    ("0.005 in", "mm", 0.127e-3),
    ("51.2kHz", "Hz", 51200.0),
    ("2 lbf", "N", 8.896443230521),
    ("20 N s/m", "N s/m", 20.0),
    ("20 N*s/m", "N s/m", 20.0),
    ("20 N·s/m", "N s/m", 20.0),
    ("1 kN/mm", "N/m", 1e6),
    ("3 m/s^2", "m/s2", 3.0),
    ("3 m/s²", "m/s2", 3.0),
    ("3 m/s/s", "m/s2", 3.0),
    ("5 g", "m/s2", 49.03325),
    ("5 g", "kg", 0.005),
    ("100 mV/N", "mV/N", 0.1),
    ("4 pC/N", "pC/N", 4e-12),
    ("25 mV/pC", "mV/pC", 25e9),
    ("98.0665 mV/g", "mV/(m/s2)", 0.01),
    ("10 mV/(m/s^2)", "mV/(m/s2)", 0.01),
    ("1 min", "s", 60.0),
    ("1 %", "", 0.01),
    ("0.01", "", 0.01),
    ("80 degC", "degC", 80.0),
    ("-5.5 °C", "degC", -5.5),
    ("10 mV/degC", "mV/K", 0.01),
    ("10 mV/K", "mV/°C", 0.01),
    ("-1e-3 m", "mm", -1e-3),
]


@pytest.mark.parametrize(("text", "unit", "value"), EXACT)
def test_quantity_becomes_its_si_value(text: str, unit: str, value: float) -> None:
    # a few roundings of double precision on the way through prefixes and products
    assert math.isclose(si_value(text, unit), value, rel_tol=1e-13)


@pytest.mark.parametrize(
    ("text", "unit", "reason"),
    [
        ("20", "Hz", "the unit is missing"),
        ("1200 rpm", "Hz", "rpm is not a unit of this kind"),
        ("6.28 rad/s", "Hz", "not a unit of this kind"),
        ("20 Hz", "rpm", "not a unit of this kind"),
        ("3 V", "N", "not a unit of this kind"),
        ("50 kS/s", "Hz", "not a unit of this kind"),
        ("51,2 kHz", "Hz", "not a unit"),
        ("3 dB", "", "not a plain ratio"),
        ("10 furlongz", "m", "not a known unit"),
        ("nan m", "m", "not a number"),
        ("20 degC", "K", "degC is not a unit of this kind"),
        ("293 K", "degC", "K is not a unit of this kind"),
        ("68 degF", "degC", "degF is no multiple of a unit"),
        ("68 degF", "K", "degF is no multiple of a unit"),
        ("1 mV/degF", "mV/K", "degF is no multiple of a unit"),
        ("94 dB", "Pa", "dB is no multiple of a unit"),
        ("mm", "m", "not a number"),
        ("", "m", "not a number"),
        ("1 m//s", "m/s", "m//s is not a unit"),
        ("1 m/", "m", "not a unit"),
        ("1 (m", "m", "not a unit"),
        ("1 m)", "m", "not a unit"),
        ("9 m" + " m" * 60, "m", "not a number with a unit"),
        ("1 m**9**9**9**9", "m", "not a unit"),
    ],
)
def test_text_of_another_kind_is_refused_with_the_reason(text: str, unit: str, reason: str) -> None:
    with pytest.raises(QuantityError) as caught:
        si_value(text, unit)
    assert reason in str(caught.value)


@pytest.mark.parametrize(
    ("unit", "si"),
    [
        *(("Pa", "Pa"), ("kPa", "Pa"), ("bar", "Pa"), ("°C", "degC"), ("degC", "degC"), ("K", "K")),
        *(("g_0", "m/s2"), ("m/s²", "m/s2"), ("rpm", "rad/s"), ("deg", "rad"), ("N m", "N m"), ("J", "J")),
        *(("kN m", "N m"), ("mm/s", "m/s"), ("l/min", "m3/s"), ("mA", "A"), ("mV", "V"), ("g", "m/s2")),
    ],
)
def test_the_si_unit_of_a_kind_has_one_name(unit: str, si: str) -> None:
    assert si_unit(unit) == si


@pytest.mark.parametrize("unit", ["", "%", "degF", "dB", "V/Hz", "furlongz"])
def test_what_is_of_no_kind_with_a_unit_has_no_si_unit(unit: str) -> None:
    with pytest.raises(QuantityError, match="unit"):
        si_unit(unit)


@pytest.mark.parametrize("unit", _USUAL)
def test_the_usual_units_are_what_pint_says_to_the_last_bit(unit: str) -> None:
    assert _named(unit) == _by_pint(unit)


# the first example loads the unit registry, which takes longer than hypothesis's deadline
@settings(deadline=None)
@given(
    number=st.floats(-1e12, 1e12), prefix=st.sampled_from([("n", 1e-9), ("m", 1e-3), ("", 1.0), ("k", 1e3)])
)
def test_every_float_with_a_prefix_is_read_exactly(number: float, prefix: tuple[str, float]) -> None:
    name, factor = prefix
    assert math.isclose(si_value(f"{number!r} {name}N", "N"), number * factor, rel_tol=1e-14)


@settings(deadline=None)
@given(text=st.text(max_size=60))
def test_any_text_is_a_number_or_a_quantity_error(text: str) -> None:
    with contextlib.suppress(QuantityError):
        assert isinstance(si_value(text, "mm"), float)
