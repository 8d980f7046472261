"""What a bench declares of its chains, on its way to the twin: directly, and through a log."""

from __future__ import annotations

import json
from math import inf, pi, radians
from pathlib import Path

import numpy as np
import pytest

from daq.errors import ConfigurationError, LogError
from drivers.ni_daq.emulator.converter import EdgeCount, PulseFrequency
from drivers.ni_daq.emulator.wiring import CounterWire, ResonanceStage
from drivers.ni_daq.sensors import MarkPulses
from rig.emulated_rig import drawn_rig
from rig.emulation import wiring_of
from rig.files.bench import Bench, embedded_bench, parse_bench
from rig.files.scenario import parse_scenario
from rig.rigs import RIGS
from rig.twin.alignment import Alignment, Mounting, reference_among
from rig.twin.chains import declared_by, mounted, mounting_of, with_chains
from rig.twin.prediction import AlignedTwin, settling_s
from rig.twin.scenario_twin import predicted_channels, twin_of
from sim_twin.sensors import Encoder, PulseTimer, SensorChain
from sim_twin.stages import Stages

RATE = 25_600.0
ACQUISITION = '[acquisition]\nsample_rate = "25.6 kHz"\nduration = "2 s"\n'
BEAM = parse_scenario(
    'name = "beam"\nrig = "impact_beam"\n[model]\nshaker_mass = "80 g"\nshaker_stiffness = "3 kN/m"\n'
    f'shaker_damping = "25 N s/m"\n[drive]\nfrequency = "20 Hz"\n{ACQUISITION}'
)
CRANK = parse_scenario(
    f'name = "crank"\nrig = "planar_slider_crank"\n[drive]\nspeed = "200 rpm"\n{ACQUISITION}'
)
SPATIAL = parse_scenario(
    f'name = "crank"\nrig = "spatial_slider_crank"\n[drive]\nspeed = "200 rpm"\n{ACQUISITION}'
)
UPPER = """\
delay = "1.2 ms"
resonance = "60 kHz"
[daq_card.channels.amplifier]
corner = "2 Hz"
output = "6 V"
[daq_card.channels.filter]
corner = "3 kHz"
order = 5
"""


def bench_of(rig: str, channel: str, more: str, old: str = "", new: str = "") -> Bench:
    """The embedded bench with more said of a channel."""
    head, name, tail = RIGS[rig].bench.partition(f'name = "{channel}"\n')
    own, rest, others = tail.partition("[[")
    assert old in own
    text = f"{head}{name}{own.replace(old, new)}{more}\n{rest}{others}"
    return parse_bench(text, "test", Path(), rig)


def test_what_is_declared_is_what_the_twin_has() -> None:
    bench = bench_of("impact_beam", "contact.force_upper", UPPER)
    twin = twin_of(BEAM, (), declared_by(bench, RATE))
    volts = 4e-12 * 6e9
    upper = twin.sensors["contact.force_upper"]
    assert upper == SensorChain(
        noise=0.05,
        stages=Stages(
            (60e3, 0.02), (2.0,), pytest.approx(6 / volts), (3e3, 5), 1.2e-3, pytest.approx(50e-6 / volts)
        ),
        limit=pytest.approx(5 / volts),
    )
    lower = twin.sensors["contact.force_lower"]
    assert lower == SensorChain(noise=0.05, limit=pytest.approx(5 / volts))
    assert settling_s(twin, 0.0) == pytest.approx(1.0)
    slow = with_chains(twin_of(BEAM), {"chain.yoke.force": json.dumps({"corner_hz": 0.2})})
    assert settling_s(slow, 0.0) == pytest.approx(5 / (2 * pi * 0.2))


def test_a_resonance_is_as_damped_as_the_bench_says_and_as_assumed_where_nobody_does() -> None:
    own = 'resonance = "28 kHz"\nresonance_damping = 0.05\n'
    bench = bench_of("impact_beam", "yoke.force", own)
    twin = twin_of(BEAM, (), declared_by(bench, RATE))
    assert twin.sensors["yoke.force"].stages == Stages((28e3, 0.05))
    (wire,) = [each for each in wiring_of(bench).wires.values() if each.plant_channel == "yoke.force"]
    assert wire.resonance == ResonanceStage(28e3, 0.05)
    of_before = with_chains(twin_of(BEAM), {"chain.yoke.force": json.dumps({"resonance_hz": 28e3})})
    assert of_before.sensors["yoke.force"].stages == Stages((28e3, 0.02))
    with pytest.raises(ConfigurationError, match=r"resonance = \(missing\): what is damped so"):
        bench_of("impact_beam", "yoke.force", "resonance_damping = 0.05\n")


@pytest.mark.parametrize("rate", [25_600.0, 51_200.0])
def test_a_delay_in_samples_is_as_long_as_the_card_takes_for_them(rate: float) -> None:
    bench = bench_of("impact_beam", "contact.force_upper", 'delay = "39 samples"\n')
    stages = twin_of(BEAM, (), declared_by(bench, rate)).sensors["contact.force_upper"].stages
    assert stages == Stages(late=pytest.approx(39 / rate))


@pytest.mark.parametrize("delay", ["101 samples", "-1 sample", "39 sampels", "39", "0.3 s", "3 mm"])
def test_what_no_delay_can_be_is_refused(delay: str) -> None:
    with pytest.raises(ConfigurationError, match=r"0 ms to 200 ms, or 0 samples to 100 samples"):
        bench_of("impact_beam", "contact.force_upper", f'delay = "{delay}"\n')


def test_encoder_and_marker_of_a_crank() -> None:
    own = 'direction = "backwards"\ninitial_angle = "10 deg"\n'
    bench = bench_of("planar_slider_crank", "crank.angle", own, "1024", "360")
    angle = twin_of(CRANK, (), declared_by(bench, RATE)).sensors["crank.angle"]
    assert angle == Encoder(1440, backwards=True, zero=pytest.approx(radians(10)))
    mark = bench_of("planar_slider_crank", "crank.marker", 'angle = "37 deg"\npolarity = "falling"\n')
    twin = twin_of(CRANK, (), declared_by(mark, RATE))
    assert twin.rig.marker_angle == pytest.approx(radians(37))
    assert twin.sensors["crank.marker"].limit == inf  # turned round, it has no such end
    assert mounted(twin_of(CRANK), declared_by(mark, RATE)).rig == twin.rig
    found = mounting_of(declared_by(mark, RATE), RIGS["planar_slider_crank"].channels)
    assert found == Mounting(gauged=False, mark_rad=pytest.approx(radians(37)))


def test_a_marker_on_a_counter_is_predicted_as_the_counter_shows_it() -> None:
    old = 'physical = "cDAQ1Mod1/ai3"\nkind = "marker"\nrange = "10 V"'
    new = 'physical = "cDAQ1Mod3/ctr1"\nkind = "marker"\nrange = "5 V"'
    bench = bench_of("planar_slider_crank", "crank.marker", 'angle = "37 deg"\n', old, new)
    record = declared_by(bench, RATE)
    counted, seen = twin_of(CRANK, (), record), mounted(twin_of(CRANK), record)
    assert counted.sensors["crank.marker"].edges == 5.0
    rows = []
    for twin in (counted, seen):
        stream = twin.model.stream(twin, RATE)
        stream.drive(twin.drive, 1.0)
        rows.append(stream.advance(25_600)[twin.channels.index("crank.marker")])
    predicted, mark = rows
    counter, card = EdgeCount(CounterWire("crank.marker")), MarkPulses(5.0)
    shown = card(counter(mark))
    assert set(predicted.tolist()) == set(shown.tolist()) == {0.0, 5.0}
    by_twin, by_card = np.flatnonzero(predicted), np.flatnonzero(shown)
    assert len(by_twin) == len(by_card) == 3
    assert np.abs(by_twin - by_card).max() <= 1  # the counter's comparator has a hysteresis
    reference = reference_among(counted.model.channels, ("crank.marker",), counted)
    # half a sample is 4e-4 rad, and three marks tell the speed
    assert reference.align(predicted, RATE, 0, counted.drive).phase == pytest.approx(1.0, abs=3e-3)


@pytest.mark.parametrize("pulses", [1, 60])
def test_a_tachometer_on_a_counter_is_predicted_as_the_counter_shows_it(pulses: int) -> None:
    own = f'physical = "cDAQ1Mod3/ctr0"\nkind = "tachometer"\npulses_per_revolution = {pulses}\n'
    text = embedded_bench("spatial_slider_crank").text
    old = next(part for part in text.split("[[daq_card.channels]]") if "motor.tachometer" in part)
    new = f'\nname = "motor.tachometer"\n{own}range = "400 rpm"\n\n'
    bench = parse_bench(text.replace(old, new), "bench", Path(), "spatial_slider_crank")
    twin = twin_of(SPATIAL, (), declared_by(bench, RATE))
    sensor = twin.sensors["motor.tachometer"]
    assert isinstance(sensor, SensorChain)
    assert (sensor.pulses, sensor.noise) == (pulses, 0.0)
    tolerances = {each.name for each in twin.model.healthy_spread(twin)}
    assert "motor.tachometer.gain" not in tolerances  # pulses have none
    assert "slider.force_1.gain" in tolerances
    stream = twin.model.stream(twin, RATE)
    stream.drive(twin.drive)
    told = stream.advance(25_600)[twin.channels.index("motor.tachometer")]
    assert len(np.unique(told[-12_800:])) <= 4 * pulses  # of 1.7 revolutions
    speed = 20.0 + np.sin(np.arange(25_600) / 900.0)
    shown, timer = PulseFrequency(CounterWire("speed", pulses), RATE)(speed), PulseTimer(pulses, RATE)
    seen = np.concatenate([timer(part) for part in np.array_split(speed, 7)])
    settled = slice(round(2 * RATE * 2 * pi / 19.0 / pulses), None)
    by_card = shown[settled] * 2 * pi / pulses
    # a pulse may fall into the sample before by one of the two, and their mean of a sample differs
    assert np.quantile(np.abs(seen[settled] - by_card), 0.98) < 1e-3
    assert len(np.unique(seen[settled])) <= 4 * pulses  # of 3.2 revolutions


def test_a_record_that_cannot_be_read_is_told() -> None:
    for text in ("{", "[1]", "[" * 100_000, "[" * 500 + "]" * 500):
        with pytest.raises(LogError, match=r"chain of contact.force_upper cannot be read"):
            with_chains(twin_of(BEAM), {"chain.contact.force_upper": text})


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("contact.force_upper", '{"amplifier": []}', None),
        ("contact.force_upper", '{"amplifier": [1]}', r"cannot be read: \[1\]"),
        (
            "contact.force_upper",
            '{"filter": {"corner_hz": 1e3, "order": 1000000000}}',
            "order = 1000000000",
        ),
        ("contact.force_upper", '{"filter": {"corner_hz": 1e3, "order": Infinity}}', "order = inf"),
        (
            "contact.force_upper",
            '{"resonance_hz": NaN}',
            r"resonance_hz = nan \(at least 100, at most 1e\+06\)",
        ),
        ("contact.force_upper", f'{{"delay_s": {"9" * 400}}}', "delay_s = 999"),
        ("contact.force_upper", '{"delay_s": 1e300}', r"delay_s = 1e\+300 \(at least 0, at most 0.2\)"),
        ("crank.angle", '{"pulses": [1]}', r"cannot be read: \[1\]"),
        ("crank.angle", '{"pulses": {"per_revolution": Infinity, "decoding": 4}}', "per_revolution = inf"),
        ("crank.angle", '{"pulses": {"per_revolution": 1024, "decoding": 5}}', "decoding = 5"),
        ("crank.angle", '{"pulses": {"per_revolution": 1024, "decoding": 4}}', None),
        ("encoder.angle", '{"mounting_rad": 1e300}', r"mounting_rad = 1e\+300"),
        ("encoder.angle", '{"mounting_rad": 1.0, "counts": 0}', "counts = 0"),
    ],
)
def test_a_number_that_no_bench_may_declare_is_told(name: str, text: str, words: str | None) -> None:
    twin = twin_of(BEAM if name == "contact.force_upper" else CRANK)
    record = {f"chain.{name}": text, f"sensitivity.{name}": "0.02"}
    if words is None:
        with_chains(twin, record)
        return
    with pytest.raises(LogError, match=f"chain of {name} .*{words}"):
        with_chains(twin, record)


def test_only_a_drive_is_felt_in_a_stinger() -> None:
    with pytest.raises(ConfigurationError, match=r"yoke.*senses.*only the force of a drive"):
        bench_of("impact_beam", "yoke.force", 'senses = "stinger"\n')


@pytest.mark.parametrize(
    "more",
    [
        '[daq_card.channels.filter]\ncorner = "1 kHz"\n',
        'delay = "2 ms"\n',
        'delay = "51.2 samples"\n',
        'senses = "stinger"\n',
    ],
)
def test_the_phase_is_the_coils_whatever_shows_the_drive(more: str) -> None:
    bench = bench_of("impact_beam", "drive.force", more)
    twin = twin_of(BEAM, (), declared_by(bench, RATE))
    stream = twin.model.stream(twin, 25_600.0, np.random.default_rng(1))
    stream.drive(twin.drive, 0.7)
    shown = stream.advance(76_800)[0, 25_600:]
    reference = reference_among(twin.model.channels, twin.channels, twin)
    found = reference.align(shown, 25_600.0, 25_600, twin.drive)
    plain = reference_among(twin.model.channels, twin.channels).align(shown, 25_600.0, 25_600, twin.drive)
    assert found.trusted
    assert found.phase == pytest.approx(0.7, abs=0.01)
    assert abs(plain.phase - 0.7) > 0.03


def test_a_marker_anywhere_tells_the_cranks_angle() -> None:
    bench = bench_of("planar_slider_crank", "crank.marker", 'angle = "200 deg"\ndelay = "1.5 ms"\n')
    twin = twin_of(CRANK, (), declared_by(bench, RATE))
    stream = twin.model.stream(twin, 25_600.0)
    stream.drive(twin.drive, 1.0)
    marker = stream.advance(51_200)[twin.channels.index("crank.marker")]
    reference = reference_among(twin.model.channels, ("crank.marker",), twin)
    found = reference.align(marker, 25_600.0, 0, twin.drive)
    assert found.phase == pytest.approx(1.0, abs=2e-3)


def test_an_emulated_encoder_counts_the_angle_and_not_the_counts_of_another() -> None:
    other = drawn_rig(CRANK, bench_of("planar_slider_crank", "crank.angle", "", "1024", "777"), 1, 2)
    usual = drawn_rig(CRANK, embedded_bench("planar_slider_crank"), 1, 2)
    counts = [rig.plant.args[1].sensors["crank.angle"].counts for rig in (other, usual)]  # type: ignore[attr-defined]
    assert counts[0] > 1e9
    assert counts[1] == 4096


ENCODER = """
[encoder]
emulated = true
interface = "socketcand"
channel = "can0"
node = 7
mounting = "123 deg"
"""


@pytest.mark.parametrize("way", [1, -1])
def test_an_encoder_beside_the_card_is_predicted_by_its_mounting(way: int) -> None:
    said = "" if way > 0 else 'direction = "backwards"\n'
    counts = "[encoder.identity]\ncounts_per_revolution = 3600\n"
    text = RIGS["planar_slider_crank"].bench + ENCODER + said + counts
    twin = twin_of(CRANK, (), declared_by(parse_bench(text, "test", Path(), "planar_slider_crank"), RATE))
    assert [each.name for each in predicted_channels(twin)][-1] == "encoder.angle"
    aligned = AlignedTwin(twin, Alignment(200 / 60, 0.4), 25_600.0, 0.0)
    blocks = list(aligned.blocks(2560, 0))
    (sent,) = [each for each in blocks if each.channel == "encoder.angle"]
    wanted = radians(123) + way * (0.4 + 2 * pi * 200 / 60 * np.arange(2560) / 25_600)
    assert len(sent) == 2560
    assert np.abs(sent.values - wanted + pi / 3600).max() <= pi / 3600 + 1e-9


def test_without_its_mounting_nobody_predicts_it() -> None:
    text = RIGS["planar_slider_crank"].bench + ENCODER.replace('mounting = "123 deg"\n', "")
    twin = twin_of(CRANK, (), declared_by(parse_bench(text, "test", Path(), "planar_slider_crank"), RATE))
    assert twin == twin_of(CRANK, (), declared_by(embedded_bench("planar_slider_crank"), RATE))
