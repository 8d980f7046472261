"""What cycles are known by: closed forms of energies, courses, fifths and coherences."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from sim_twin.diagnosis.fingerprint import (
    FIGURES,
    OF_A_SINE,
    SLICES,
    Cell,
    Columns,
    CycleTable,
    Layout,
    NarrowColumns,
)

Array = NDArray[np.float32]
RATE, FREQUENCY = 25_600.0, 20.0
LENGTH = round(RATE / FREQUENCY)
CYCLES = 40
STARTS = np.arange(CYCLES) * LENGTH


def columns(*names: str) -> Columns:
    return Columns(names, names, FREQUENCY, RATE)


def noise(seed: int, cycles: int = CYCLES) -> Array:
    count = (cycles + 1) * LENGTH
    return np.random.default_rng(seed).standard_normal(count).astype(np.float32)


def table(*records: Array) -> CycleTable:
    names = tuple(f"channel.{k}" for k in range(len(records)))
    return columns(*names).numbers(records, STARTS, LENGTH)


def named(found: Array, name: str, seen: Columns) -> Array:
    """Numbers of the first channel's cells of that name, shape (cells, SLICES)."""
    layout = Layout(seen.cells(0))
    kept = [
        k for k, cell in enumerate(layout.cells) if cell.what == name and cell.channel == seen.channels[0]
    ]
    return np.array([found[layout.starts[k] : layout.starts[k + 1]] for k in kept])


def test_every_number_has_a_cell() -> None:
    seen = columns("one", "two", "three")
    found = seen.numbers([noise(k) for k in range(3)], STARTS, LENGTH).fingerprint()
    layout = Layout(seen.cells(0))
    assert len(found) == layout.size
    assert found.dtype == np.float32
    assert np.isfinite(found).all()
    assert [cell.what for cell in layout.cells if cell.channel == "two"].count("peak") == 1


def test_bands_join_up_from_the_drive_to_0_4_of_the_rate() -> None:
    edges = columns("one").harmonics
    assert edges[0] == 1
    assert edges[-1] * FREQUENCY == pytest.approx(0.4 * RATE, rel=FREQUENCY / (0.4 * RATE))
    assert np.all(np.diff(edges) >= 1)
    # third octaves where there is more than one harmonic in each
    assert np.diff(np.log2(edges[edges > 20])) == pytest.approx(1 / 3, abs=0.08)
    bands = [cell.band for cell in columns("one").cells(0) if cell.band is not None]
    assert [low for low, _ in bands[1:]] == [high for _, high in bands[:-1]]


@pytest.mark.parametrize("gain", [0.5, 0.98, 2.0])
def test_a_gain_shifts_the_logarithm_of_every_energy_by_twice_its_own(gain: float) -> None:
    seen, record = columns("one"), noise(1)
    before = seen.numbers([record], STARTS, LENGTH).fingerprint()
    after = seen.numbers([np.float32(gain) * record], STARTS, LENGTH).fingerprint()
    for name, shift in (("energy", 2.0), ("rms", 2.0), ("peak", 1.0), ("crest", 0.0), ("share of time", 0.0)):
        moved = named(after, name, seen) - named(before, name, seen)
        assert moved == pytest.approx(np.full_like(moved, shift * np.log(gain)), abs=1e-3)  # float32
    assert named(after, "mean", seen) == pytest.approx(gain * named(before, "mean", seen), abs=1e-4)


@pytest.mark.parametrize(
    ("second", "third", "phase"), [(0.08, 0.0, 0.0), (0.05, 0.12, 0.7), (0.0, 0.2, -2.0)]
)
def test_harmonics_of_a_sine_are_told_as_shares_of_it_whatever_its_size_and_begin(
    second: float, third: float, phase: float
) -> None:
    seen = Columns(("drive",), (), FREQUENCY, RATE, sine="drive")
    p = 2 * np.pi * FREQUENCY * np.arange(len(noise(0))) / RATE + phase
    for size, scatter in ((9.0, 0.0), (0.3, 1e-3)):
        record = size * (np.cos(p) + second * np.cos(2 * p) + third * np.sin(3 * p)) + scatter * noise(2)
        found = seen.numbers([record.astype(np.float32)], STARTS, LENGTH).fingerprint()
        shares = [named(found, part, seen).mean() for part in OF_A_SINE]
        assert shares == pytest.approx([second, 0.0, 0.0, -third], abs=1e-3)


def test_only_of_a_driving_sine_harmonics_are_told() -> None:
    seen = Columns(("drive", "force"), ("force",), FREQUENCY, RATE, sine="drive")
    told = [(cell.channel, cell.what) for cell in seen.cells(0) if cell.what in OF_A_SINE]
    assert told == [("drive", part) for part in OF_A_SINE]
    found = seen.numbers([noise(0), noise(1)], STARTS, LENGTH).fingerprint()
    assert len(found) == Layout(seen.cells(0)).size


def test_energy_lies_in_the_band_of_the_sine_that_makes_it() -> None:
    seen = columns("one")
    times = np.arange(len(noise(0))) / RATE
    # in the middle of a band of several harmonics, so that the window's neighbours lie in it too
    bands = [cell.band for cell in seen.cells(0) if cell.what == "energy" and cell.band is not None]
    at = next(k for k, (low, high) in enumerate(bands) if high - low > 6 * FREQUENCY)
    middle = FREQUENCY * round(sum(bands[at]) / 2 / FREQUENCY)
    tone = np.sin(2 * np.pi * middle * times).astype(np.float32)
    energies = named(seen.numbers([tone], STARTS, LENGTH).fingerprint(), "energy", seen).mean(axis=1)
    assert int(np.argmax(energies)) == at
    # float32 of a cycle's spectrum: 1e-7 of its amplitude at every other harmonic, 1e-12 of its energy
    assert np.delete(energies, at).max() < energies[at] - np.log(1e8)


def test_an_impact_lies_in_its_phase() -> None:
    seen, record = columns("one"), np.zeros(len(noise(0)), np.float32)
    for start in STARTS:
        record[start + 5 * LENGTH // 16 + 10 : start + 5 * LENGTH // 16 + 30] = 7.0
    found = seen.numbers([record], STARTS, LENGTH).fingerprint()
    assert int(np.argmax(named(found, "rms", seen).mean(axis=1))) == 5
    part = LENGTH // 16
    assert named(found, "mean", seen)[5] == pytest.approx(np.full(SLICES, 7 * 20 / part))
    assert named(found, "peak", seen)[0] == pytest.approx(np.full(SLICES, np.log(7)), abs=1e-6)
    assert named(found, "contacts", seen)[0] == pytest.approx(np.ones(SLICES))
    assert named(found, "share of time", seen)[0] == pytest.approx(np.full(SLICES, 20 / LENGTH), rel=1e-5)
    early, half = (named(found, what, seen)[0, 0] for what in FIGURES[4:])
    assert np.angle(early + 1j * half) == pytest.approx(2 * np.pi * 5.5 / 16, abs=1e-5)


def test_fifths_are_means_of_the_sorted_parts_and_their_mean_is_the_mean() -> None:
    rng = np.random.default_rng(4)
    for count in (5, 7, 12, 23):
        values = rng.normal(size=(count, 3)).astype(np.float32)
        empty = np.zeros((0, 0, 0), np.complex64), np.zeros((0, 0, 0), np.float32)
        fifths = CycleTable(values, *empty).fingerprint().reshape(3, SLICES)
        assert fifths.mean(axis=1) == pytest.approx(values.mean(axis=0), abs=1e-6)
        assert np.all(np.diff(fifths, axis=1) >= -1e-6)
        fine = np.sort(np.repeat(values, SLICES, axis=0), axis=0).reshape(SLICES, count, 3)
        assert fifths == pytest.approx(fine.mean(axis=1).T, abs=1e-6)


def test_a_fingerprint_of_some_cycles_sees_no_others() -> None:
    record = noise(5)
    loud = record.copy()
    loud[20 * LENGTH :] *= 10
    one, other = (table(each).fingerprint(slice(0, 18)) for each in (record, loud))
    layout = Layout(columns("channel.0").cells(0))
    # what counts as a contact is told by the median peak of the whole record
    common = [k for k, cell in enumerate(layout.cells) if cell.what in ("share of time", "contacts")]
    apart = np.flatnonzero(one != other)
    assert set(np.searchsorted(layout.starts, apart, side="right") - 1) <= set(common)
    assert len(table(record)) == CYCLES


@pytest.mark.parametrize("delay", [0, 3, 10])
def test_coherence_of_a_delayed_noise_turns_with_frequency(delay: int) -> None:
    source = noise(6)
    late = np.roll(source, delay)
    seen = columns("one", "late")
    found = seen.numbers([source, late], STARTS, LENGTH).fingerprint()
    octaves = seen.octaves
    bands = len(octaves) - 1
    coherence = found[-2 * bands : -bands] + 1j * found[-bands:]
    # the spectrum of what comes later is exp(-i 2 pi f tau) times as large, so the product of one and the
    # conjugate of the other turns the other way; white noise weighs all harmonics in a band alike
    turn = np.exp(2j * np.pi * np.arange(octaves[-1]) * delay / LENGTH)
    exact = np.array([turn[low:high].mean() for low, high in pairwise(octaves)])
    # each harmonic is weighed by the noise's own power in 40 cycles (two halves of each), some 1 / sqrt(80)
    # of it; and a delay of 10 of 1280 samples brings 0.8 % of other noise into the window
    allowed = np.abs(exact - np.exp(1j * np.angle(exact))) / np.sqrt(20) + 0.02
    assert np.all(np.abs(coherence - exact) < allowed + (0 if delay else 1e-5))


def test_unrelated_noises_have_no_coherence_and_a_sign_turns_it() -> None:
    one, other = noise(7), noise(8)
    unrelated = table(one, other).fingerprint()
    seen = columns("channel.0", "channel.1")
    bands, widths = len(seen.octaves) - 1, np.diff(seen.octaves)
    # a mean over so many independent harmonics and cycles, 1.5 neighbours sharing a window
    allowed = 4 * np.sqrt(1.5 / (CYCLES * widths))
    assert np.all(np.abs(unrelated[-2 * bands : -bands]) < allowed)
    turned = table(one, -one).fingerprint()[-2 * bands : -bands]
    assert turned == pytest.approx(-np.ones(bands), abs=1e-4)


def test_narrow_bands_tell_the_response_of_a_filter_and_the_spectra_before_and_behind_it() -> None:
    cycles, names = 400, ("in", "out")
    starts, source = np.arange(cycles) * LENGTH, noise(10, cycles)
    behind = source.copy()
    behind[2:] -= np.float32(0.7) * source[:-2]
    alone = NarrowColumns(names, names, FREQUENCY, RATE, alone=True)
    found, cells = alone.numbers([source, behind], starts, LENGTH).fingerprint(), alone.cells(0)
    gain = 1 - 0.7 * np.exp(-2j * np.pi * 2 * np.arange(alone.narrow[-1]) / LENGTH)
    bands, lines = [*pairwise(alone.narrow.tolist())], np.diff(alone.narrow)
    powers = np.array([lines, [np.sum(np.abs(gain[low:high]) ** 2) for low, high in bands]])
    # of white noise of variance 1 every line has the sum of the squared window
    energy = np.log(np.sum(np.hanning(LENGTH) ** 2) * powers)
    response = np.log([np.abs(gain[low:high].mean()) for low, high in bands])
    told = np.array([cell.what for cell in cells])
    spectra = found[told == "spectrum"].reshape(2, -1)
    # means of as many independent squares as cycles and lines, half as many by the window; five deviations
    assert np.all(np.abs(spectra - energy) < 5 * np.sqrt(2 / (cycles * lines)))
    # behind the filter the window sees two other samples of 1280: up to 1.3 % of a line, where least passes,
    # of which 400 cycles leave a twentieth; and they weigh the lines of a band alike to some per cent
    assert found[told == "response"] == pytest.approx(response, abs=0.01)
    assert (cells[-1].channel, cells[-1].partner) == ("in", "out")
    beside = NarrowColumns(names, names, FREQUENCY, RATE)
    both = beside.numbers([source, behind], starts, LENGTH).fingerprint()
    plain = columns(*names).numbers([source, behind], starts, LENGTH).fingerprint()
    assert np.array_equal(both, np.concatenate([plain, spectra.ravel()]))
    assert (len(found), len(both)) == (Layout(cells).size, Layout(beside.cells(0)).size)


def test_one_coupled_channel_has_nothing_to_be_coherent_with() -> None:
    cells = columns("one").cells(0)
    assert not [cell for cell in cells if cell.partner is not None]
    assert len(table(noise(9)).fingerprint()) == Layout(cells).size


def test_runs_are_laid_side_by_side() -> None:
    first, second = Layout(columns("one").cells(0)), Layout((Cell(1, "two", "height", 1),))
    both = Layout((*first.cells, *second.cells))
    assert both.size == first.size + 1
    assert [cell.run for cell in both.cells][-2:] == [0, 1]
    assert both.starts[-1] == both.size
