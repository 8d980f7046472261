"""The card driver, over the real nidaqmx, against the emulated card in another process."""

from __future__ import annotations

import math
import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from datetime import date

import numpy as np
import pytest
from nidaqmx import _grpc_interpreter as interpreter
from nidaqmx._stubs import nidaqmx_pb2 as messages
from nidaqmx.errors import DaqNotFoundError
from numpy.typing import NDArray

from daq.block import Flag
from daq.errors import (
    ConfigurationError,
    DeviceLost,
    InstrumentAbsent,
    InstrumentRefused,
    RecorderFailed,
)
from drivers.emulator_process import DriveLink, EmulatedInstrument
from drivers.ni_daq.card import NiDaqCard
from drivers.ni_daq.channels import CardChannel, CardSettings
from drivers.ni_daq.emulator.process import start_daq_card
from drivers.ni_daq.emulator.wiring import CardWiring, Wire
from drivers.ni_daq.session import copy_at_once
from drivers.protocols.generator import DriveSettings
from drivers.scpi.emulator.process import start_function_generator
from drivers.scpi.generator import GeneratorSettings, ScpiGenerator
from tests.drivers.conftest import ACCELERATION, CONSTANT, FORCE, OPEN, WIRING, card_settings
from tests.drivers.plants import BrokenPlant, NotFinitePlant, RampPlant, SinePlant

RATE = 51200.0
LSB_V = 5.0 / 2**23
GAIN_N_PER_V = SinePlant().gain_n_per_v


@contextmanager
def opened(settings: CardSettings) -> Iterator[NiDaqCard]:
    card = NiDaqCard(settings)
    card.open()
    try:
        yield card
    finally:
        card.close()


def acquired(card: NiDaqCard) -> int:
    """Samples per channel that the device has taken since its start, read or not."""
    return int(card._opened().stream.total_samp_per_chan_acquired)


def fitted_sine(values: NDArray[np.float64], frequency_hz: float) -> tuple[float, float]:
    """Return amplitude and phase at the first sample (rad) of the sine in `values`, by least squares."""
    angle = math.tau * frequency_hz / RATE * np.arange(len(values))
    basis = np.stack([np.sin(angle), np.cos(angle), np.ones_like(angle)], axis=1)
    sine, cosine, _ = np.linalg.lstsq(basis, values, rcond=None)[0]
    return math.hypot(sine, cosine), math.atan2(cosine, sine)


def test_reads_what_the_plant_makes_in_the_units_of_the_bench(card_emulator: EmulatedInstrument) -> None:
    with opened(card_settings(card_emulator.address)) as card:
        assert card.sample_rate == RATE
        assert card.identity == "cDAQ1Mod1: NI 9234, serial 1E24000, simulated"
        card.start()
        first, second = card.read(5120), card.read(1000)
        assert (first.first_sample, second.first_sample) == (0, 5120)
        assert first.values.shape == (3, 5120)
        assert first.values[2] == pytest.approx(1.0, abs=LSB_V / 0.5)
        assert first.flags == (Flag.GOOD,) * 3
        card.stop()


@pytest.mark.parametrize(
    ("read", "kind", "dtype"),
    [
        ("read_analog_f64", "ReadAnalogF64", np.float64),
        ("read_counter_u32", "ReadCounterU32", np.uint32),
        ("read_binary_i16", "ReadBinaryI16", np.int16),
    ],
)
def test_a_reading_copied_at_once_is_that_of_nidaqmx(read: str, kind: str, dtype: type[np.generic]) -> None:
    copy_at_once()
    assert "_assign_numpy_array" in getattr(interpreter.GrpcStubInterpreter, read).__code__.co_names
    for came in (12, 5, 0):
        values = getattr(messages, f"{kind}Response")(read_array=range(came)).read_array
        for mine in (np.full((3, 4), 9, dtype), np.full((4, 3), 9, dtype).T):
            expected = mine.copy()
            expected.flat[:came] = values
            interpreter._assign_numpy_array(mine, values)
            assert mine.tolist() == expected.tolist()


def test_channels_say_what_they_are() -> None:
    channel = replace(FORCE, serial="SN1", location="drive", quantity="force")
    described = NiDaqCard(card_settings(None, channel, ACCELERATION)).channels
    assert described[0].metadata() == {
        "unit": "N",
        "quantity": "force",
        "location": "drive",
        "sensor": "voltage",
        "serial": "SN1",
        "scale": "50.0",
        "raw_unit": "V",
    }
    assert described[1].scale is None


def test_charge_amplifier_scales_by_sensitivity_and_gain(card_emulator: EmulatedInstrument) -> None:
    # 4 pC/N into 0.125 V/pC is the 0.5 V/N that hang on this input.
    charge = CardChannel("c", "cDAQ1Mod1/ai2", "charge_amplifier", 4e-12, 8.0, gain=0.125e12, unit="N")
    with opened(card_settings(card_emulator.address, charge)) as card:
        card.start()
        assert card.read(100).values == pytest.approx(1.0, abs=LSB_V / 0.5)


@pytest.mark.parametrize("factor", [0.5, 2.0])
@pytest.mark.parametrize("kind", ["voltage", "force_iepe", "acceleration_iepe"])
def test_a_wrong_sensitivity_shows_as_a_wrong_amplitude(
    card_emulator: EmulatedInstrument, kind: str, factor: float
) -> None:
    unit = "m/s2" if kind == "acceleration_iepe" else "N"
    wrong = replace(CONSTANT, kind=kind, sensitivity=0.5 * factor, range=4.0, unit=unit)
    with opened(card_settings(card_emulator.address, wrong)) as card:
        card.start()
        # Standard gravity goes in and out again: a few units in the last place of a double.
        assert card.read(100).values == pytest.approx(1.0 / factor, abs=2 * LSB_V, rel=1e-12)


def test_the_generator_drives_the_plant_at_the_time_of_its_change() -> None:
    frequency_hz, amplitude_v = 100.0, 2.0
    with DriveLink.new() as link:
        generator_emulator = start_function_generator(link.sender)
        card_emulator = start_daq_card(SinePlant, WIRING, link.receiver)
    with generator_emulator, card_emulator, opened(card_settings(card_emulator.address)) as card:
        generator = ScpiGenerator(GeneratorSettings(1.0, 5.0, resource=generator_emulator.address))
        generator.open()
        generator.arm_sine(frequency_hz, amplitude_v, 0.0, triggered=True)
        before_s = time.monotonic()
        card.start()
        started_s = time.monotonic()
        assert not card.read(2560).values[:2].any()
        trigger_s = time.monotonic()
        generator.start()
        triggered_s = time.monotonic()
        values = np.concatenate([card.read(5120).values for _ in range(4)], axis=1)
        generator.off()
        generator.close()
        first = int(np.flatnonzero(values[0])[0])
        run = values[:, first : first + 10240]
        force_n, phase = fitted_sine(run[0], frequency_hz)
        acceleration, _ = fitted_sine(run[1], frequency_hz)
        # Quantisation alone: half an LSB a sample, averaged; a tenth of an LSB is beyond it.
        assert force_n == pytest.approx(GAIN_N_PER_V * amplitude_v, abs=0.1 * LSB_V / 0.02)
        assert acceleration == pytest.approx(force_n / SinePlant().mass_kg, abs=0.2 * LSB_V / 0.01)
        assert 0.0 <= phase <= 2 * math.tau * frequency_hz / RATE  # starts at zero, one sample to be seen
        start_s = (2560 + first - phase / math.tau * RATE / frequency_hz) / RATE
        assert trigger_s - started_s <= start_s <= triggered_s - before_s


def test_initial_settings_drive_a_plant_without_an_emulated_generator() -> None:
    on = DriveSettings(True, 50.0, 1.5, 0.25, started_s=time.monotonic() - 3.3, phase_rad=0.4)
    with (
        start_daq_card(SinePlant, WIRING, initial=on) as emulator,
        opened(card_settings(emulator.address)) as card,
    ):
        for _ in range(2):  # and it is still on when the task starts again
            card.start()
            values = card.read(5120).values
            card.stop()
            assert fitted_sine(values[0], 50.0)[0] == pytest.approx(
                1.5 * GAIN_N_PER_V, abs=0.1 * LSB_V / 0.02
            )
            assert values[0].mean() == pytest.approx(0.25 * GAIN_N_PER_V, abs=0.1 * LSB_V / 0.02)


def test_open_sensor_and_idle_input(card_emulator: EmulatedInstrument) -> None:
    idle = CardChannel("idle", "cDAQ1Mod1/ai3", "voltage", 1.0, 5.0, unit="N")
    for channel, flag in ((OPEN, Flag.OPEN_SENSOR), (idle, Flag.GOOD)):
        with opened(card_settings(card_emulator.address, CONSTANT, channel)) as card:
            card.start()
            reading = card.read(5120)
            assert reading.flags == (Flag.GOOD, flag)
            volts = reading.values[1] * channel.sensitivity
            assert np.std(volts) == pytest.approx(50e-6, rel=0.05)  # 5120 samples: 1 % standard error


def test_overload_clips_and_is_flagged_on_its_channel_only() -> None:
    wiring = CardWiring({"cDAQ1Mod1/ai0": Wire("ramp", 1e-3), "cDAQ1Mod1/ai1": Wire("ramp", 1e-6)})
    clipped = CardChannel("clipped", "cDAQ1Mod1/ai0", "voltage", 1e-3, 5000.0, unit="N")
    fine = CardChannel("fine", "cDAQ1Mod1/ai1", "voltage", 1e-6, 5e6, unit="N")
    with (
        start_daq_card(RampPlant, wiring) as emulator,
        opened(card_settings(emulator.address, clipped, fine)) as card,
    ):
        card.start()
        readings = [card.read(1280) for _ in range(6)]
        assert [reading.flags[1] for reading in readings] == [Flag.GOOD] * 6
        # The ramp passes 5000 N in the fourth block; the device's own flag may come a block or so early.
        assert [reading.flags[0] for reading in readings[3:]] == [Flag.OVERLOAD] * 3
        assert readings[0].flags[0] == Flag.GOOD
        assert readings[5].values[0] == pytest.approx(5000.0, abs=1e3 * LSB_V)


def test_value_beyond_the_sensor_range_is_flagged(card_emulator: EmulatedInstrument) -> None:
    with opened(card_settings(card_emulator.address, replace(CONSTANT, range=0.9))) as card:
        card.start()
        assert card.read(100).flags == (Flag.OVERLOAD,)


def test_not_finite_is_kept_and_flagged() -> None:
    wiring = CardWiring({"cDAQ1Mod1/ai0": Wire("ramp", 0.5)})
    with (
        start_daq_card(NotFinitePlant, wiring) as emulator,
        opened(card_settings(emulator.address, replace(CONSTANT, physical="cDAQ1Mod1/ai0"))) as card,
    ):
        card.start()
        first, second = card.read(101), card.read(101)
        assert first.flags == (Flag.NOT_FINITE,)
        assert np.flatnonzero(np.isnan(first.values[0])).tolist() == [100]
        assert second.flags == (Flag.GOOD,)


def test_unread_samples_that_are_overwritten_end_the_run(card_emulator: EmulatedInstrument) -> None:
    with opened(card_settings(card_emulator.address, buffer_s=0.1)) as card:
        card.start()
        card.read(100)
        deadline = time.monotonic() + 5.0
        while acquired(card) < 100 + 2 * 5120:
            assert time.monotonic() < deadline
        with pytest.raises(RecorderFailed, match=r"samples were overwritten .*-200279"):
            card.read(100)


def test_a_plant_that_fails_is_a_lost_device(capfd: pytest.CaptureFixture[str]) -> None:
    wiring = CardWiring({"cDAQ1Mod1/ai0": Wire("ramp", 1e-6)})
    with start_daq_card(BrokenPlant, wiring) as emulator:
        channel = CardChannel("ramp", "cDAQ1Mod1/ai0", "voltage", 1e-6, 1e6, unit="N")
        with opened(card_settings(emulator.address, channel)) as card:
            card.start()
            with pytest.raises(DeviceLost, match="-201003") as caught:
                card.read(10000)
            assert caught.value.code == "-201003"
    assert "a fault of the plant" in capfd.readouterr().err


def test_every_missing_input_is_named_at_once(card_emulator: EmulatedInstrument) -> None:
    channels = [
        replace(FORCE, name=str(index), physical=physical)
        for index, physical in enumerate(["cDAQ1Mod1/ai0", "cDAQ1Mod1/ai9", "cDAQ1Mod7/ai0", "Dev1/ai2"])
    ]
    with pytest.raises(InstrumentAbsent, match="missing") as caught:
        NiDaqCard(card_settings(card_emulator.address, *channels)).open()
    for text in (
        "cDAQ1Mod1/ai9 (no such input)",
        "cDAQ1Mod7/ai0 (no device",
        "Dev1/ai2 (no device",
        "present: cDAQ1Mod1",
    ):
        assert text in str(caught.value)
    assert "cDAQ1Mod1/ai0" not in str(caught.value)


def test_dies_in_the_middle_of_a_read() -> None:
    with (
        start_daq_card(SinePlant, WIRING) as emulator,
        opened(card_settings(emulator.address)) as card,
    ):
        card.start()
        card.read(100)
        died: list[float] = []

        def kill() -> None:
            died.append(time.monotonic())
            os.kill(emulator.pid, signal.SIGKILL)

        killer = threading.Timer(0.2, kill)
        killer.start()
        with pytest.raises(DeviceLost, match="reading samples 100 to 102500: the device server is gone"):
            card.read(102400)
        assert time.monotonic() - died[0] < 1.0
        killer.join()


@pytest.mark.parametrize(
    ("rate", "near"), [(50000.0, "25600, 51200"), (10000.0, "8533.333, 10240"), (51201.0, "-200077")]
)
def test_a_rate_that_the_card_has_not(card_emulator: EmulatedInstrument, rate: float, near: str) -> None:
    with pytest.raises(InstrumentRefused, match=near):
        NiDaqCard(card_settings(card_emulator.address, rate=rate)).open()


@pytest.mark.parametrize("divisor", [1, 3, 31])
def test_rates_of_the_card_are_taken(card_emulator: EmulatedInstrument, divisor: int) -> None:
    with opened(card_settings(card_emulator.address, rate=RATE / divisor)) as card:
        assert card.sample_rate == pytest.approx(RATE / divisor, rel=1e-12)


def test_a_range_beyond_the_input_is_refused(card_emulator: EmulatedInstrument) -> None:
    told = (
        r"drive\.force on cDAQ1Mod1/ai0: its range, 251 N, is 5\.02 V, and an input of the NI 9234 takes 5 V"
    )
    with pytest.raises(InstrumentRefused, match=told):
        NiDaqCard(card_settings(card_emulator.address, replace(FORCE, range=251.0))).open()


def test_an_excitation_that_the_card_has_not(card_emulator: EmulatedInstrument) -> None:
    with pytest.raises(InstrumentRefused, match="excitation of 4 mA"):
        NiDaqCard(card_settings(card_emulator.address, replace(ACCELERATION, excitation_a=0.004))).open()


def test_a_card_in_use_is_refused(card_emulator: EmulatedInstrument) -> None:
    settings = card_settings(card_emulator.address)
    with opened(settings) as first, opened(settings) as second:
        first.start()
        with pytest.raises(InstrumentRefused, match="in use") as caught:
            second.start()
        assert caught.value.code == "-50103"


def test_everything_wrong_with_the_settings_at_once() -> None:
    channels = (
        FORCE,
        replace(FORCE, kind="encoder"),
        CardChannel("a", "cDAQ1Mod1/ai1", "charge_amplifier", -1.0, 0.0, unit="V"),
        CardChannel("b", "cDAQ1Mod1/ai2", "thermocouple", 1.0, 1.0),
        CardChannel("c", "cDAQ1Mod1/ai3", "voltage", math.nan, 1.0, gain=2.0, unit="N"),
    )
    with pytest.raises(ConfigurationError, match="DAQ card") as caught:
        NiDaqCard(CardSettings(sample_rate_hz=-1.0, buffer_s=math.inf, channels=channels)).open()
    assert {problem.key for problem in caught.value.problems} == {
        "sample_rate_hz",
        "buffer_s",
        "channels.name",
        "channels.physical",
        "channels[drive.force].kind",
        "channels[a].sensitivity",
        "channels[a].range",
        "channels[a].unit",
        "channels[a].gain",
        "channels[b].kind",
        "channels[c].sensitivity",
        "channels[c].gain",
    }
    assert "on an analog input (.../ai0) one of voltage" in str(caught.value)


@pytest.mark.parametrize(
    "address",
    [
        "192.168.1.20:31763",
        "example.org:31763",
        "0.0.0.0:31763",
        "127.0.0.1",
        "127.0.0.1:0",
        "127.0.0.1:x",
        "",
    ],
)
def test_only_this_machine_over_an_open_channel(address: str) -> None:
    with pytest.raises(ConfigurationError, match="the connection is not protected"):
        NiDaqCard(card_settings(address)).open()


def test_a_machine_without_the_ni_driver() -> None:
    card = NiDaqCard(card_settings(None))
    with pytest.raises(
        InstrumentAbsent, match="NI-DAQmx is installed, or name a gRPC device server"
    ) as caught:
        card.open()
    assert isinstance(caught.value.__cause__, DaqNotFoundError)


def test_expired_calibration_is_a_warning(card_emulator: EmulatedInstrument) -> None:
    class NewYear:
        def unix_ns(self) -> int:
            return 1_798_761_600 * 10**9  # 2027-01-01

        def monotonic_s(self) -> float:
            return 0.0

        def sleep(self, seconds: float) -> None:
            raise NotImplementedError

    good = replace(FORCE, valid_until=date(2027, 1, 1))
    old = replace(CONSTANT, serial="SN7", valid_until=date(2026, 12, 31))
    card = NiDaqCard(card_settings(card_emulator.address, good, old), NewYear())
    assert card.warnings == ("constant: the calibration of sensor SN7 expired on 2026-12-31",)
    card.open()
    card.close()


def test_sixteen_channels_at_51200_hz_without_loss() -> None:
    wires = {f"cDAQ1Mod{1 + i // 4}/ai{i % 4}": Wire("ramp", 4.5 / 2**20) for i in range(16)}
    channels = [
        CardChannel(f"channel_{i}", physical, "voltage", 4.5 / 2**20, 2.0**20, unit="N")
        for i, physical in enumerate(wires)
    ]
    with (
        start_daq_card(RampPlant, CardWiring(wires)) as emulator,
        opened(card_settings(emulator.address, *channels)) as card,
    ):
        card.start()
        cpu = time.process_time()
        values = np.concatenate([card.read(5120).values for _ in range(20)], axis=1)
        busy = time.process_time() - cpu
        late = acquired(card) - values.shape[1]
    # A step is 7 codes high, so that rounding brings each sample back exactly.
    assert (np.rint(values) == np.arange(20 * 5120)).all()
    assert late < RATE / 4, "the driver must keep up"
    assert busy < 0.5 * 2.0, f"{busy:.2f} s of CPU for 2 s of samples"
    assert os.getpid() != emulator.pid
