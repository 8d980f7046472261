"""Encoder, marker and tachometer on the card's counters, in step with its analog inputs."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nidaqmx.error_codes import DAQmxErrors
from numpy.typing import NDArray

from daq.block import Flag
from daq.errors import ConfigurationError, InstrumentRefused, InstrumentSilent, RecorderFailed
from daq.quantity import Quantity, settings_of
from drivers.ni_daq.card import NiDaqCard
from drivers.ni_daq.channels import CardChannel, CardSettings, Pulses
from drivers.ni_daq.emulator.acquisition import CounterRun
from drivers.ni_daq.emulator.converter import AngleCount
from drivers.ni_daq.emulator.process import start_daq_card
from drivers.ni_daq.emulator.servicer import CardServicer
from drivers.ni_daq.emulator.wiring import CardWiring, CounterWire, DaqmxError, Wire
from drivers.ni_daq.sensors import COUNTER_STATES, MarkPulses, UnwrappedCount
from drivers.ni_daq.tasks import AnalogTask
from rig.files.scenario import AcquisitionSection
from sim_twin.rigs.crank_drive import SpeedDrive
from tests.drivers.in_process import BUFFER_S, RowsPlant, opened, served
from tests.drivers.plants import TurningPlant

RATE = 25600.0
COUNT = math.tau / 4096
ANALOG = CardChannel("index", "cDAQ1Mod1/ai0", "voltage", 1e-3, 4000.0, unit="N")
ENCODER = CardChannel("crank.angle", "cDAQ1Mod3/ctr0", "encoder", unit="rad", pulses=Pulses(1024))
WIRES = {"cDAQ1Mod1/ai0": Wire("index", 1e-3)}


def wiring(wire: CounterWire | None = None) -> CardWiring:
    return CardWiring(WIRES, counters={"cDAQ1Mod3/ctr0": wire or CounterWire("angle")})


def turning(
    speed_rad_s: float, first_rad: float = 0.0, samples: int = 25600
) -> dict[str, NDArray[np.float64]]:
    """A shaft at constant speed; the row `index` counts the samples modulo 1000."""
    n = np.arange(samples)
    return {"index": (n % 1000).astype(float), "angle": first_rad + speed_rad_s * n / RATE}


def counted(angle: NDArray[np.float64], count: float = COUNT) -> NDArray[np.float64]:
    return np.floor(angle / count + 1e-6) * count


@pytest.mark.parametrize("rpm", [200.0, -200.0, 12000.0])
def test_angle_is_the_plants_to_a_count_and_on_the_analog_samples(rpm: float) -> None:
    rows = turning(rpm * math.tau / 60.0)
    with opened(RowsPlant(rows), wiring(), ENCODER, ANALOG) as card:
        readings = [card.read(2560) for _ in range(8)]
    values = np.concatenate([reading.values for reading in readings], axis=1)
    assert [reading.first_sample for reading in readings] == list(range(0, 20480, 2560))
    assert {reading.flags for reading in readings} == {(Flag.GOOD, Flag.GOOD)}
    assert values.dtype == np.float64
    # Both rows show the same sample of the plant: no shift, no loss, whatever the block.
    assert (np.rint(values[1]) == rows["index"][:20480]).all()
    # Whole counts times one factor: equal up to the last place of a double.
    assert values[0] == pytest.approx(counted(rows["angle"][:20480]), rel=1e-14, abs=1e-12)
    assert 0.0 <= abs(values[0, 0]) < math.tau


def test_what_has_piled_up_comes_with_one_call_and_block_by_block(monkeypatch: pytest.MonkeyPatch) -> None:
    """A call takes its time, however few samples it is for: who fell behind would never catch up."""
    rows, fetched, whole = turning(20.0), list[int](), AnalogTask.read

    def read(task: AnalogTask, count: int, timeout_s: float) -> NDArray[np.float64]:
        fetched.append(count)
        return whole(task, count, timeout_s)

    monkeypatch.setattr(AnalogTask, "read", read)
    monkeypatch.setattr(NiDaqCard, "_status", lambda *_: [("overloaded_chans", 1)])
    with opened(RowsPlant(rows), wiring(), ENCODER, ANALOG) as card:
        readings = [card.read(1280)]
        time.sleep(0.55)  # 11 blocks
        readings += [card.read(1280) for _ in range(9)]
    assert fetched[:3] == [1280, 4 * 1280, 4 * 1280]
    assert [reading.first_sample for reading in readings] == list(range(0, 12800, 1280))
    assert len({reading.arrived_s for reading in readings[1:5]}) == 1
    assert readings[4].arrived_s < readings[5].arrived_s
    told = [Flag.OVERLOAD in reading.flags[1] for reading in readings[:9]]
    assert told == [True, *([False] * 3 + [True]) * 2]  # what the device says comes with the newest
    values = np.concatenate([reading.values for reading in readings], axis=1)
    assert (np.rint(values[1]) == rows["index"][:12800]).all()
    assert values[0] == pytest.approx(counted(rows["angle"][:12800]), rel=1e-14, abs=1e-12)


def test_clocks_that_differ_pile_up_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a host whose clock has gained on the card's, nothing waits: each call brings a block."""
    rows, asked = turning(20.0), list[AnalogTask]()

    def waiting(task: AnalogTask) -> int:
        asked.append(task)
        return 1280 + 17

    monkeypatch.setattr(AnalogTask, "waiting", waiting)
    with opened(RowsPlant(rows), wiring(), ENCODER, ANALOG) as card:
        card._least_lag_s -= 3600.0
        assert [card.read(1280).first_sample for _ in range(3)] == [0, 1280, 2560]
    assert len(asked) == 1


def test_an_angle_that_was_counted_before_comes_back_unchanged() -> None:
    rows = turning(200.0 * math.tau / 60.0, first_rad=1.0)
    rows["angle"] = np.floor(rows["angle"] / COUNT) * COUNT
    start = Pulses(1024, initial_angle=float(rows["angle"][0]))
    with opened(RowsPlant(rows), wiring(), ANALOG, replace(ENCODER, pulses=start)) as card:
        angle = card.read(25600).values[1]
    assert angle == pytest.approx(rows["angle"], rel=1e-14, abs=1e-12)


def test_a_card_in_a_process_of_its_own_counts_in_real_time() -> None:
    wiring = CardWiring(
        {"cDAQ1Mod1/ai0": Wire("ramp", 1e-6)}, counters={"cDAQ1Mod3/ctr0": CounterWire("angle")}
    )
    ramp = CardChannel("ramp", "cDAQ1Mod1/ai0", "voltage", 1e-6, 4e6, unit="N")
    with start_daq_card(TurningPlant, wiring) as emulator:
        card = NiDaqCard(
            CardSettings(
                grpc=emulator.address, sample_rate_hz=51200.0, buffer_s=BUFFER_S, channels=(ENCODER, ramp)
            )
        )
        card.open()
        card.start()
        values = np.concatenate([card.read(2048).values for _ in range(5)], axis=1)
        card.stop()
        card.close()
    n = np.rint(values[1])
    assert (n == np.arange(10240)).all()
    assert np.rint(values[0] / COUNT).tolist() == np.floor(np.where(n < 4096, n, 8192 - n) / 4.0).tolist()


@pytest.mark.parametrize("decoding", [1, 2, 4])
def test_decoding_sets_the_resolution(decoding: int) -> None:
    rows = turning(20.0)
    channel = replace(ENCODER, pulses=Pulses(1024, decoding))
    with opened(RowsPlant(rows), wiring(), ANALOG, channel) as card:
        angle = card.read(25600).values[1]
    assert np.unique(np.diff(np.rint(angle * 1024 * decoding / math.tau))).tolist() == [0.0, 1.0]
    assert angle == pytest.approx(counted(rows["angle"], math.tau / 1024 / decoding), rel=1e-14, abs=1e-12)


def test_wrong_pulses_in_the_bench_show_as_a_wrong_speed() -> None:
    rows = turning(20.0)
    with opened(RowsPlant(rows), wiring(), ANALOG, replace(ENCODER, pulses=Pulses(512))) as card:
        angle = card.read(25600).values[1]
    assert angle[-1] - angle[0] == pytest.approx(2.0 * rows["angle"][-1], abs=2 * COUNT)


@pytest.mark.parametrize("speed", [300.0, -300.0])
@pytest.mark.parametrize("preset", [COUNTER_STATES - 500, 500, COUNTER_STATES // 2 - 500])
def test_the_counters_rollover_leaves_no_trace(preset: int, speed: float) -> None:
    rows = turning(speed)
    with opened(RowsPlant(rows), wiring(CounterWire("angle", preset=preset)), ANALOG, ENCODER) as card:
        angle = np.concatenate([card.read(2560).values[1] for _ in range(10)])
    # 2^31 counts are 3.3e6 rad, of which a double resolves 5e-10.
    assert angle - angle[0] == pytest.approx(counted(rows["angle"]), abs=1e-9)
    assert angle[0] == pytest.approx(
        COUNT * ((preset + COUNTER_STATES // 2) % COUNTER_STATES - COUNTER_STATES // 2)
    )


@given(
    start=st.integers(-(2**31), 2**31 - 1),
    steps=st.lists(st.one_of(st.integers(-3, 3), st.integers(-(2**31) + 1, 2**31 - 1)), max_size=40),
    cut=st.integers(0, 40),
)
def test_unwrapping_is_exact_forwards_backwards_and_in_jitter(start: int, steps: list[int], cut: int) -> None:
    counts = np.cumsum([start, *steps], dtype=np.int64)
    raw = (counts % COUNTER_STATES).astype(np.uint32)
    unwrap = UnwrappedCount()
    blocks = [unwrap(raw[:cut]), unwrap(raw[cut:])]
    assert np.concatenate(blocks).tolist() == counts.tolist()


@given(st.lists(st.integers(-2047, 2047), min_size=1, max_size=40), st.integers(0, 4095))
def test_unwrapping_over_the_index_is_exact(steps: list[int], start: int) -> None:
    counts = np.cumsum([start, *steps], dtype=np.int64)
    raw = (counts % 4096 % COUNTER_STATES).astype(np.uint32)
    assert UnwrappedCount(4096, 0)(raw).tolist() == counts.tolist()


def test_no_shaft_turns_half_of_what_a_counter_can_tell_within_a_sample() -> None:
    """So that no reading is ambiguous: with an index mark it tells one revolution, else 2^32 counts."""
    slowest_hz = settings_of(AcquisitionSection)["sample_rate"].meaning
    fastest_rpm = settings_of(SpeedDrive)["speed"].meaning
    assert isinstance(slowest_hz, Quantity)
    assert isinstance(fastest_rpm, Quantity)
    runaway = 2.0  # the guard stops it at half as fast again
    assert runaway * fastest_rpm.high / 60.0 / slowest_hz.low < 0.25


@pytest.mark.parametrize("speed", [30.0, -30.0])
def test_the_index_mark_makes_the_angle_absolute(speed: float) -> None:
    # The shaft stands at 2 rad when the task starts, of which the counter knows nothing.
    rows = turning(speed, first_rad=2.0)
    channel = replace(ENCODER, pulses=Pulses(1024, index=True))
    with opened(RowsPlant(rows), wiring(CounterWire("angle", preset=77)), ANALOG, channel) as card:
        angle = np.concatenate([card.read(2560).values[1] for _ in range(10)])
    passed = int(np.flatnonzero(np.diff(np.floor(rows["angle"] / math.tau)))[0]) + 1
    off = (angle - counted(rows["angle"]))[passed:] / math.tau
    # Whole turns off, and always the same.
    assert off == pytest.approx(np.full(off.shape, np.rint(off[0])), abs=1e-9)
    before = np.diff(angle[: passed - 3])  # backwards the mark's own count comes before the turn's end
    assert np.abs(before).max() == pytest.approx(COUNT)


@pytest.mark.parametrize("sizes", [(1, 1, 4094), (7,) * 586])
def test_the_emulated_index_is_seen_whatever_the_block(sizes: tuple[int, ...]) -> None:
    walk = np.cumsum(np.random.default_rng(1).integers(-700, 701, sum(sizes)))
    angle = (walk + 0.5) * COUNT
    blocks = np.split(angle, np.cumsum(sizes)[:-1])
    count = AngleCount(CounterWire("angle"), 4, 0, 0)
    seen = np.concatenate([count(block) for block in blocks]).astype(np.int64)
    marked = np.flatnonzero(np.diff(walk // 4096))
    assert len(marked) > 10
    later = slice(int(marked[0]) + 1, None)
    assert (seen[later] % 4096 == walk[later] % 4096).all()


def test_marks_are_counted_however_short() -> None:
    volts = np.zeros(25600)
    marks = np.array([100, 101, 2559, 2560, 7000, 25000])
    volts[marks[marks != 101]] = 5.0
    rows = {"index": np.zeros(25600), "marker": volts}
    marker = CardChannel("crank.marker", "cDAQ1Mod3/ctr0", "marker", range=5.0)
    with opened(RowsPlant(rows), wiring(CounterWire("marker")), ANALOG, marker) as card:
        values = np.concatenate([card.read(2560).values[1] for _ in range(10)])
    # 2559 and 2560 are one long mark.
    assert np.flatnonzero(values).tolist() == [100, 2559, 7000, 25000]
    assert set(values.tolist()) == {0.0, 5.0}


def test_marks_over_the_rollover() -> None:
    pulses = MarkPulses(5.0)
    raw = np.array([COUNTER_STATES - 1, COUNTER_STATES - 1, 0, 0, 1], dtype=np.uint32)
    assert pulses(raw).tolist() == [0.0, 0.0, 5.0, 0.0, 5.0]
    assert pulses(raw[-1:]).tolist() == [0.0]


def test_marker_and_tachometer_on_analog_inputs() -> None:
    degrees = np.arange(25600) * 200.0 * 360.0 / 60.0 / RATE
    rows = {"marker": np.where(degrees % 360.0 < 5.0, 5.0, 0.0), "speed": np.linspace(20.0, 21.0, 25600)}
    wires = {"cDAQ1Mod1/ai0": Wire("marker", 1.0, 10.0), "cDAQ1Mod1/ai1": Wire("speed", 0.06685)}
    marker = CardChannel("crank.marker", "cDAQ1Mod1/ai0", "marker", 1.0, 10.0)
    tachometer = CardChannel("motor.tachometer", "cDAQ1Mod1/ai1", "tachometer", 0.06685, 60.0, unit="rad/s")
    with opened(RowsPlant(rows), CardWiring(wires), marker, tachometer) as card:
        reading = card.read(25600)
    assert reading.flags == (Flag.GOOD, Flag.GOOD)
    assert reading.findings == ()  # a marker may rest, and the tachometer does not
    assert reading.values[0] == pytest.approx(rows["marker"], abs=10.0 / 2**23)
    assert reading.values[1] == pytest.approx(rows["speed"], abs=5.0 / 2**23 / 0.06685)
    assert card.channels[1].metadata() == {
        "unit": "rad/s",
        "sensor": "tachometer",
        "scale": repr(1.0 / 0.06685),
        "raw_unit": "V",
    }


def test_tachometer_on_a_counter() -> None:
    rows = {"index": np.zeros(25600), "speed": np.linspace(20.0, 21.0, 25600)}
    channel = CardChannel(
        "motor.tachometer", "cDAQ1Mod3/ctr0", "tachometer", range=60.0, unit="rad/s", pulses=Pulses(60, 1)
    )
    with opened(RowsPlant(rows), wiring(CounterWire("speed", 60)), ANALOG, channel) as card:
        values = card.read(25600).values
    # the mean between two pulses, 5.2 ms apart at most, of a speed that grows by 1 rad/s each second
    assert np.all(np.abs(values[1] - rows["speed"]) < 0.01)
    counted_from = 150  # when the first has come
    assert len(np.unique(values[1, counted_from:])) == math.floor(20.5 * 60 / math.tau)


def test_a_second_start_begins_at_the_first_sample_again() -> None:
    rows = turning(20.0)
    with served(RowsPlant(rows), wiring(), ANALOG, ENCODER) as card:
        card.open()
        for _ in range(2):
            card.start()
            reading = card.read(100)
            assert reading.first_sample == 0
            assert reading.values[1] == pytest.approx(counted(rows["angle"][:100]), abs=1e-12)
            card.stop()


def test_a_counter_is_declared_in_the_log() -> None:
    described = NiDaqCard(
        CardSettings(sample_rate_hz=RATE, buffer_s=1.0, channels=(ANALOG, ENCODER))
    ).channels[1]
    assert (described.sensor, described.raw_unit, described.scale) == ("encoder", "count", COUNT)


class Recording(CardServicer):
    """Remembers which tasks were started, by their channels."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        started.clear()

    def StartTask(self, request: Any, context: Any) -> Any:  # noqa: N802
        started.append(self._task(request).channels)
        return super().StartTask(request, context)


started: list[list[str]] = []


def test_counters_wait_before_the_clock_starts() -> None:
    second = replace(ENCODER, name="second", physical="cDAQ1Mod3/ctr1")
    with served(RowsPlant(turning(20.0)), wiring(), ANALOG, ENCODER, second, servicer=Recording) as card:
        card.open()
        card.start()
    assert started == [["cDAQ1Mod3/ctr0"], ["cDAQ1Mod3/ctr1"], ["cDAQ1Mod1/ai0"]]


class Short(CardServicer):
    """Its counter has not everything yet."""

    def ReadCounterU32Ex(self, request: Any, context: Any) -> Any:  # noqa: N802
        request.num_samps_per_chan -= 40
        return super().ReadCounterU32Ex(request, context)


class ShortCard(CardServicer):
    """Its analog inputs have not everything yet, and it says so in no other way."""

    def ReadAnalogF64(self, request: Any, context: Any) -> Any:  # noqa: N802
        request.num_samps_per_chan -= 40
        return super().ReadAnalogF64(request, context)


class Late(CardServicer):
    """Its counter has lost its clock."""

    def ReadCounterU32Ex(self, request: Any, context: Any) -> Any:  # noqa: N802
        raise DaqmxError(DAQmxErrors.SAMPLES_NOT_YET_AVAILABLE, "no samples")


class Overrun(CardServicer):
    """Its counter's buffer has run over."""

    def ReadCounterU32Ex(self, request: Any, context: Any) -> Any:  # noqa: N802
        raise DaqmxError(DAQmxErrors.ACQ_STOPPED_TO_PREVENT_INPUT_BUFFER_OVERWRITE, "stopped")


@pytest.mark.parametrize(
    ("servicer", "error", "match"),
    [
        (ShortCard, RecorderFailed, "samples 0 to 100: only 60 of them came"),
        (Short, RecorderFailed, r"samples 0 to 100 of crank\.angle \(cDAQ1Mod3/ctr0\): only 60 of them came"),
        (Late, InstrumentSilent, r"samples 0 to 100 of crank\.angle \(cDAQ1Mod3/ctr0\): DAQmx -200284"),
        (Overrun, RecorderFailed, r"of crank\.angle \(cDAQ1Mod3/ctr0\): samples were overwritten .*-200222"),
    ],
)
def test_inputs_that_fall_behind_are_named(
    servicer: type[CardServicer], error: type[Exception], match: str
) -> None:
    with served(RowsPlant(turning(20.0)), wiring(), ANALOG, ENCODER, servicer=servicer) as card:
        card.open()
        card.start()
        with pytest.raises(error, match=match):
            card.read(100)


def test_a_counter_that_is_not_read_runs_over() -> None:
    run = CounterRun(AngleCount(CounterWire("angle"), 4, 0, None), 0, np.uint32, 100)
    run.take(np.zeros((1, 60)))
    assert run.buffer.read(10, 0.0).shape == (1, 10)
    for _ in range(2):
        run.take(np.zeros((1, 60)))
    with pytest.raises(DaqmxError, match="overwritten before they were read"):
        run.buffer.read(10, 0.0)


def test_a_counter_in_use_is_refused() -> None:
    with served(RowsPlant(turning(20.0)), wiring(), ANALOG, ENCODER) as card:
        card.open()
        card.start()
        other = NiDaqCard(card.settings)
        other.open()
        with pytest.raises(
            InstrumentRefused, match=r"starting crank\.angle \(cDAQ1Mod3/ctr0\): DAQmx -50103"
        ):
            other.start()
        other.close()


@pytest.mark.parametrize(
    ("channels", "key", "allowed"),
    [
        ((ENCODER,), "channels", "an analog input too, whose clock samples them"),
        ((ANALOG, replace(ENCODER, pulses=None)), "channels[crank.angle].pulses", "pulses of a counter"),
        (
            (ANALOG, replace(ENCODER, pulses=Pulses(0))),
            "channels[crank.angle].pulses.per_revolution",
            "at least 1",
        ),
        (
            (ANALOG, replace(ENCODER, pulses=Pulses(9, 3))),
            "channels[crank.angle].pulses.decoding",
            "1, 2 or 4",
        ),
        (
            (ANALOG, replace(ENCODER, pulses=Pulses(9, initial_angle=7.0))),
            "channels[crank.angle].pulses.initial_angle",
            "below one turn",
        ),
        (
            (ANALOG, replace(ENCODER, physical="cDAQ1Mod3/ai0")),
            "channels[crank.angle].kind",
            "on an analog input",
        ),
        ((replace(ANALOG, pulses=Pulses(60)),), "channels[index].pulses", "only for a channel on a counter"),
        (
            (ANALOG, replace(ENCODER, physical="cDAQ1Mod3/port0")),
            "channels[crank.angle].physical",
            "a counter",
        ),
    ],
)
def test_a_counter_that_cannot_be_is_told(channels: tuple[CardChannel, ...], key: str, allowed: str) -> None:
    with pytest.raises(ConfigurationError, match="DAQ card") as caught:
        NiDaqCard(CardSettings(sample_rate_hz=RATE, buffer_s=1.0, channels=channels)).open()
    (problem,) = caught.value.problems
    assert problem.key == key
    assert allowed in problem.allowed
