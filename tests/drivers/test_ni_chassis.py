"""Several modules on one clock, the rate that a chassis really takes, and what it says of the sensors."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from nidaqmx.error_codes import DAQmxErrors

from daq.errors import InstrumentAbsent, InstrumentRefused
from drivers.ni_daq.channels import CardChannel, Pulses
from drivers.ni_daq.emulator.servicer import CardServicer
from drivers.ni_daq.emulator.wiring import CardWiring, CounterWire, DaqmxError, Teds, Wire, chassis_of
from tests.drivers.in_process import RowsPlant, opened, served

PLANT = RowsPlant({"x": np.arange(2000) % 100.0, "angle": np.zeros(2000)})
FORCE = CardChannel("yoke.force", "cDAQ1Mod1/ai0", "force_iepe", 0.0224, 200.0, unit="N")
ACCELERATION = CardChannel(
    "base.acceleration", "cDAQ1Mod2/ai0", "acceleration_iepe", 0.01, 400.0, unit="m/s2"
)
VOLTAGE = CardChannel("drive.force", "cDAQ1Mod4/ai1", "voltage", 0.02, 200.0, unit="N")
ENCODER = CardChannel("crank.angle", "cDAQ1Mod3/ctr0", "encoder", unit="rad", pulses=Pulses(1024))


def wired(*channels: CardChannel, **changes: Any) -> CardWiring:
    return CardWiring(
        {channel.physical: Wire("x", channel.sensitivity, **changes) for channel in channels},
        counters={ENCODER.physical: CounterWire("angle")},
    )


def test_modules_of_one_chassis_share_its_clock() -> None:
    channels = (FORCE, ACCELERATION, VOLTAGE)
    with opened(PLANT, wired(*channels), *channels, ENCODER, rate=51200.0) as card:
        assert card.identity == (
            "cDAQ1Mod1: NI 9234, serial 1E24000, simulated; cDAQ1Mod2: NI 9234, serial 1E24001, simulated;"
            " cDAQ1Mod4: NI 9234, serial 1E24002, simulated; cDAQ1Mod3: NI 9401, serial 1E24003, simulated"
        )
        values = np.concatenate([card.read(500).values for _ in range(4)], axis=1)
    # A step of 1 is far above the resolution of the coarsest (5 V / 2^23 over 0.01 V per m/s2).
    assert (np.rint(values[:3]) == PLANT.rows["x"]).all()


@pytest.mark.parametrize(
    ("device", "chassis"), [("cDAQ1Mod1", "cDAQ1"), ("cDAQ9185-1A2BMod8", "cDAQ9185-1A2B"), ("Dev1", None)]
)
def test_a_module_is_in_the_chassis_of_its_name(device: str, chassis: str | None) -> None:
    assert chassis_of(device) == chassis


def test_another_chassis_is_refused_by_name() -> None:
    away = replace(ACCELERATION, physical="cDAQ2Mod1/ai0")
    card = replace(VOLTAGE, physical="Dev1/ai0")
    with (
        served(PLANT, wired(FORCE, away, card), FORCE, away, card) as opening,
        pytest.raises(InstrumentRefused, match=r"base\.acceleration on cDAQ2Mod1/ai0") as caught,
    ):
        opening.open()
    assert "cDAQ2Mod1 is in cDAQ2, which does not share the sample clock of cDAQ1" in str(caught.value)
    assert "drive.force on Dev1/ai0: Dev1 is in Dev1" in str(caught.value)


def test_a_device_that_is_no_module_clocks_itself() -> None:
    alone = replace(VOLTAGE, physical="Dev1/ai0")
    counter = replace(ENCODER, physical="Dev1/ctr0")
    wiring = CardWiring({"Dev1/ai0": Wire("x", 0.02)}, counters={"Dev1/ctr0": CounterWire("angle")})
    with opened(PLANT, wiring, alone, counter) as card:
        assert card.read(100).values.shape == (2, 100)


def test_a_range_beyond_its_module_is_told_by_name() -> None:
    wide = [replace(FORCE, range=250.0), replace(VOLTAGE, range=260.0)]
    with (
        served(PLANT, wired(FORCE, VOLTAGE), *wide) as card,
        pytest.raises(InstrumentRefused, match=r"its range, 250 N, is 5\.6 V, and an input") as caught,
    ):
        card.open()
    assert "drive.force on cDAQ1Mod4/ai1: its range, 260 N, is 5.2 V" in str(caught.value)
    assert "an input of the NI 9234 takes 5 V" in str(caught.value)


def test_a_microphone_that_the_card_feeds_is_in_pascals() -> None:
    heard = CardChannel("room.sound", "cDAQ1Mod1/ai0", "microphone_iepe", 0.05, 100.0, unit="Pa")
    with opened(PLANT, wired(heard), heard) as card:
        assert card.read(500).values[0] == pytest.approx(PLANT.rows["x"][:500], abs=1e-3)
    loud = replace(heard, range=100.01)
    with served(PLANT, wired(heard), loud) as card, pytest.raises(InstrumentRefused, match="5 V"):
        card.open()


def test_a_rate_a_little_off_is_taken_and_named() -> None:
    with served(PLANT, wired(FORCE), FORCE, rate=25500.0) as card:
        for _ in range(2):
            card.open()
            assert card.sample_rate == 25600.0
            assert card.warnings == ("DAQ card samples at 25600 Hz instead of 25500 Hz (+3922 ppm)",)
            card.close()


@pytest.mark.parametrize("rate", [25600.0 * (1 - 9e-6), 51200.0 / 3])
def test_a_rate_within_ten_ppm_is_not_worth_a_word(rate: float) -> None:
    with opened(PLANT, wired(FORCE), FORCE, rate=rate) as card:
        assert card.warnings == ()


def test_a_rate_more_than_a_percent_off_is_refused() -> None:
    with (
        served(PLANT, wired(FORCE), FORCE, rate=25300.0) as card,
        pytest.raises(
            InstrumentRefused, match=r"no sample rate of 25300 Hz; near it are 17066\.67, 25600 Hz"
        ),
    ):
        card.open()


def test_an_absent_counter_is_named_with_everything_else() -> None:
    wrong = replace(ENCODER, physical="cDAQ1Mod3/ctr7")
    away = replace(ACCELERATION, physical="cDAQ2Mod1/ai0")
    with (
        served(PLANT, wired(FORCE, away), FORCE, wrong, away) as card,
        pytest.raises(InstrumentAbsent, match=r"cDAQ1Mod3/ctr7 \(no such input\)") as caught,
    ):
        card.open()
    assert "cDAQ2Mod1 is in cDAQ2" in str(caught.value)
    assert "present: cDAQ1Mod1, cDAQ1Mod3, cDAQ2Mod1" in str(caught.value)


def with_teds(channel: CardChannel, serial: int, factor: float = 1.0) -> CardWiring:
    return wired(channel, teds=Teds(serial, channel.sensitivity * factor))


@pytest.mark.parametrize("channel", [FORCE, ACCELERATION])
@pytest.mark.parametrize("factor", [1.0, 1.009, 0.991])
def test_a_data_sheet_that_agrees_is_taken(channel: CardChannel, factor: float) -> None:
    named = replace(channel, serial="SN0123")
    with opened(PLANT, with_teds(channel, 123, factor), named) as card:
        assert card.channels[0].serial == "SN0123"
        # The bench file's calibration counts, and the reading works after all that.
        assert card.read(100).values[0] == pytest.approx(PLANT.rows["x"][:100], abs=1e-3)


def test_a_serial_that_the_bench_leaves_open_is_taken_from_the_sheet() -> None:
    with opened(PLANT, with_teds(FORCE, 4711), FORCE) as card:
        assert card.channels[0].metadata()["serial"] == "4711"


def test_every_difference_from_the_data_sheets_is_told_at_once() -> None:
    channels = (replace(FORCE, serial="SN0124"), replace(ACCELERATION, serial="A-9"), ENCODER)
    wires = {
        FORCE.physical: Wire("x", 0.0224, teds=Teds(123, 0.0112)),
        ACCELERATION.physical: Wire("x", 0.01, teds=Teds(9, 0.0102)),
    }
    wiring = CardWiring(wires, counters={ENCODER.physical: CounterWire("angle")})
    with (
        served(PLANT, wiring, *channels) as card,
        pytest.raises(
            InstrumentRefused, match=r"yoke\.force on cDAQ1Mod1/ai0: serial 123 by its TEDS"
        ) as caught,
    ):
        card.open()
    for text in (
        "SN0124 in the bench file",
        "yoke.force on cDAQ1Mod1/ai0: sensitivity 0.0112 V per N by its TEDS, 0.0224 V per N in the bench",
        "base.acceleration on cDAQ1Mod2/ai0: sensitivity 0.0102 V per m/s2 by its TEDS, 0.01 V",
    ):
        assert text in str(caught.value)
    assert "serial 9" not in str(caught.value)


def test_a_voltage_channel_has_a_serial_and_no_sensitivity_to_compare() -> None:
    wiring = wired(VOLTAGE, teds=Teds(55, 99.0))
    with opened(PLANT, wiring, replace(VOLTAGE, serial="55")) as card:
        assert card.channels[0].serial == "55"


class WithoutTeds(CardServicer):
    """A card that knows no TEDS."""

    def GetDeviceAttributeBool(self, request: Any, context: Any) -> Any:  # noqa: N802
        if request.attribute_raw == 0x2FD6:
            raise DaqmxError(DAQmxErrors.ATTR_NOT_SUPPORTED, "no such attribute")
        return super().GetDeviceAttributeBool(request, context)


class BadSheet(CardServicer):
    """A sensor whose sheet is of another kind than the channel."""

    def CreateTEDSAIForceIEPEChan(self, request: Any, context: Any) -> Any:  # noqa: N802
        raise DaqmxError(DAQmxErrors.TEDS_INCOMPATIBLE_SENSOR_AND_MEAS_TYPE, "an accelerometer")


class BrokenSheet(CardServicer):
    """A sensor whose memory is damaged."""

    def ConfigureTEDS(self, request: Any, context: Any) -> Any:  # noqa: N802
        raise DaqmxError(DAQmxErrors.CORRUPTED_TEDS_MEMORY, "damaged")


class OtherError(CardServicer):
    """Something else goes wrong while the sheet is read."""

    def ConfigureTEDS(self, request: Any, context: Any) -> Any:  # noqa: N802
        raise DaqmxError(DAQmxErrors.PAL_RESOURCE_RESERVED, "reserved")


@pytest.mark.parametrize("servicer", [CardServicer, WithoutTeds])
def test_no_data_sheet_is_no_matter(servicer: type[CardServicer]) -> None:
    with served(PLANT, wired(FORCE), replace(FORCE, serial="SN1"), servicer=servicer) as card:
        card.open()
        assert card.warnings == ()
        assert card.channels[0].serial == "SN1"


@pytest.mark.parametrize(
    ("servicer", "match"),
    [
        (BadSheet, r"its TEDS cannot be read \(DAQmx -200756"),
        (BrokenSheet, r"its TEDS cannot be read \(DAQmx -200742"),
        (OtherError, "looking for its devices: DAQmx -50103"),
    ],
)
def test_a_data_sheet_that_cannot_be_read_is_told(servicer: type[CardServicer], match: str) -> None:
    with (
        served(PLANT, with_teds(FORCE, 1), FORCE, servicer=servicer) as card,
        pytest.raises(InstrumentRefused, match=match),
    ):
        card.open()
