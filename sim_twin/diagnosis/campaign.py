"""Runs of one rig as a subject of diagnosis: simulated and measured records become fingerprints alike."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import ceil, inf, pi
from typing import TypeAlias

import numpy as np
from numpy.random import SeedSequence
from numpy.typing import NDArray
from scipy import fft

from sim_twin.diagnosis.cause import Cause
from sim_twin.diagnosis.discrepancy import Discrepancy, drawn
from sim_twin.diagnosis.fingerprint import Columns, Crossed, Layout, Look
from sim_twin.diagnosis.subject import Draw, Named, Observed
from sim_twin.ensembles.clean_samples import clean_samples
from sim_twin.ensembles.simulate import Variant
from sim_twin.rigs.cycles import Cycles, turning
from sim_twin.sensors import Encoder, PulseTimer, Sensor, SensorChain, counted_edges, source_of
from sim_twin.stages import Stages, responses
from sim_twin.twin import AnyTwin

Array = NDArray[np.floating]
Samples = NDArray[np.float32]
Records: TypeAlias = dict[str, Array]
"""One run's channels at the setting's rate, each (n,)."""
_GUARD_S = 4e-3
"""Cut from both ends of a simulated record: a skew shifts its end into its start."""
_SETTLE_S, _SETTLE_CYCLES = 0.5, 2.0
_APART = 1e-7
"""Rad between the two starts: less than any measurement tells, and no visible shift in time."""
_PARTED = 0.1
_LONGEST_S = 2.0


@dataclass(frozen=True, slots=True)
class RunSetting:
    """One run: the nominal `twin` in step with it, and how its records are looked at.

    `columns` say at which rate (Hz) and in which cycles; a block has `cycles` of them. The truth is computed
    at `oversampling` times the rate. `quiet` is the share of each channel's rms of noise that resampling left
    (else 1). `reference` tells the cycles; empty: the rig's own.
    """

    twin: AnyTwin
    columns: Columns
    oversampling: int
    cycles: int
    quiet: Mapping[str, float] = field(default_factory=dict)
    reference: str = ""

    def samples(self, blocks: int) -> int:
        """How many samples hold so many blocks, wherever the first cycle begins."""
        period = self.columns.rate / self.columns.frequency
        return ceil((self.cycles * blocks + 2.6) * period + 2 * self._guard)

    def motion_s(self, blocks: int) -> float:
        """Seconds that have to be simulated for so many blocks, those in which it settles among them."""
        return self.samples(blocks) / self.columns.rate + self.settle

    @property
    def settle(self) -> float:
        """Seconds that a simulated motion has to forget its start."""
        return max(_SETTLE_S, _SETTLE_CYCLES / self.columns.frequency)

    @property
    def _guard(self) -> int:
        chains = (each for each in self.twin.sensors.values() if isinstance(each, SensorChain))
        latest = max((each.stages.delay for each in chains if each.stages is not None), default=0.0)
        return round(_GUARD_S * self.columns.rate) + int(latest * self.columns.rate)

    def inner(self, records: Mapping[str, Array]) -> Records:
        """Simulated records without their ends."""
        cut = slice(self._guard, -self._guard)
        return {name: record[cut] for name, record in records.items()}

    def cycles_in(self, records: Mapping[str, Array]) -> Cycles:
        name = self.reference or self.twin.model.reference
        return self.twin.model.followed(name)(records[name], self.columns.rate, self.columns.frequency)

    def blocks_of(
        self,
        records: Mapping[str, Array],
        sound: NDArray[np.bool_] | None = None,
        known: Known | None = None,
    ) -> Samples:
        """Fingerprints of all whole blocks in `records`, each (n,), without cycles that are not `sound`.

        What records that are `known` have in common with these is not looked at again.
        """
        reference = records[self.reference or self.twin.model.reference]
        if known is None or known.reference is not reference:
            known = Known(reference)
        if known.cycles is None:
            known.cycles = self.cycles_in(records)
        cycles = known.cycles
        starts, length = cycles.starts(len(reference)), cycles.length
        if sound is not None:
            starts = starts[[bool(sound[at : at + length + length // 2].all()) for at in starts]]
        if len(starts) < self.cycles:
            return np.empty((0, 0), np.float32)
        looks = []
        for name in self.columns.channels:
            record = records[name]
            if id(record) not in known.looks:
                signal = record
                if isinstance(self.twin.sensors.get(name), Encoder):  # by how it swings about its mean line
                    signal = record - cycles.phases(len(record))
                look = self.columns.look(name, np.asarray(signal, np.float32), starts, length)
                known.looks[id(record)] = record, look
            looks.append(known.looks[id(record)][1])
        table = self.columns.table(looks, known.crossed)
        parts = range(0, len(table) - self.cycles + 1, self.cycles)
        return np.array([table.fingerprint(slice(first, first + self.cycles)) for first in parts])


@dataclass(slots=True)
class Known:
    """What was made of records that one `reference` cuts: of each by its id, and of each two."""

    reference: Array
    cycles: Cycles | None = None
    looks: dict[int, tuple[Array, Look]] = field(default_factory=dict)
    crossed: dict[tuple[int, int], Crossed] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Campaign:
    """Some runs of one rig; `numbers` are theirs among those of a larger campaign, for what is drawn.

    `discrepancies` are what healthy rigs show otherwise than any twin.
    """

    runs: tuple[RunSetting, ...]
    numbers: tuple[int, ...] = ()
    discrepancies: tuple[Discrepancy, ...] = ()

    def only(self, numbers: tuple[int, ...]) -> Campaign:
        """Some of the runs: what is observed of them is the same bits."""
        among = tuple(self.numbers[k] for k in numbers) if self.numbers else numbers
        return replace(self, runs=tuple(self.runs[k] for k in numbers), numbers=among)

    @property
    def layout(self) -> Layout:
        """What the numbers of a fingerprint are."""
        return Layout(tuple(cell for k, run in enumerate(self.runs) for cell in run.columns.cells(k)))

    @property
    def causes(self) -> tuple[Cause, ...]:
        """Every effect that the rig can have, once for each channel in the records that it may sit on."""
        twins = [run.twin for run in self.runs]
        shown = {name for run in self.runs for name in run.columns.channels}
        found = []
        for effect in twins[0].model.effects.values():
            if any(effect.refusal(twin) for twin in twins):
                continue
            channels = [name for name in effect.channels if name in shown] if effect.channels else [None]
            found += [
                Cause(
                    effect.name,
                    effect.location,
                    effect.parameters,
                    channel,
                    effect.sensing,
                    effect.allows,
                    effect.coordinates,
                )
                for channel in channels
            ]
        return tuple(found)

    def observe(self, draws: Sequence[Draw]) -> list[Observed]:
        """Simulate some draws side by side."""
        if not draws:
            return []
        if any(draw.runs for draw in draws) or len({draw.blocks for draw in draws}) > 1:
            return self._of_each_kind(draws)
        found = [
            [
                [None if motion is None else motion.blocks(extra, draw.blocks) for extra in draw.sensing]
                for draw, motion in zip(draws, self._simulated(k, setting, draws), strict=True)
            ]
            for k, setting in enumerate(self.runs)
        ]
        together = [joined([run[number] for run in found]) for number in range(len(draws))]
        return self.as_they_differ(draws, together)

    def as_they_differ(self, draws: Sequence[Draw], observed: Sequence[Observed]) -> list[Observed]:
        """What simulated rigs show, with what is otherwise in real ones."""
        if not self.discrepancies:
            return list(observed)
        layout, numbers = self.layout, self.numbers or tuple(range(len(self.runs)))
        apart = [drawn(layout, self.discrepancies, draw.seed, numbers) for draw in draws]
        return [
            tuple(None if blocks is None else blocks + off for blocks in each)
            for off, each in zip(apart, observed, strict=True)
        ]

    def _of_each_kind(self, draws: Sequence[Draw]) -> list[Observed]:
        """Those that ask for as many blocks of the same runs side by side."""
        found: list[Observed] = [() for _ in draws]
        for runs, blocks in dict.fromkeys((draw.runs, draw.blocks) for draw in draws):
            at = [k for k, draw in enumerate(draws) if (draw.runs, draw.blocks) == (runs, blocks)]
            part = self.only(runs) if runs else self
            for k, each in zip(at, part.observe([replace(draws[k], runs=()) for k in at]), strict=True):
                found[k] = each
        return found

    def records(self, draws: Sequence[Draw]) -> list[list[Records | None]]:
        """What the channels show in draws of as many blocks, (runs, draws); None for a run that failed."""
        return [
            [None if motion is None else motion.records(()) for motion in self._simulated(k, setting, draws)]
            for k, setting in enumerate(self.runs)
        ]

    def changed(self, number: int, effects: tuple[Named, ...]) -> AnyTwin:
        """The twin of a run with the effects of a draw in."""
        setting = self.runs[number]
        changed: AnyTwin = setting.twin.model.with_effects(setting.twin, _shown_in(setting, effects))
        return changed

    def _simulated(self, number: int, setting: RunSetting, draws: Sequence[Draw]) -> Iterator[_Motion | None]:
        """Each of some draws of as many blocks; None for one that failed."""
        variants, model = [], setting.twin.model
        drawn = self.numbers[number] if self.numbers else number
        for draw in draws:
            # the same rig in every run, set up anew in each
            rig_rng = np.random.default_rng(SeedSequence(draw.seed, spawn_key=(0,)))
            run_rng = np.random.default_rng(SeedSequence(draw.seed, spawn_key=(1, drawn)))
            twin = model.draw_healthy(self.changed(number, draw.effects), rig_rng, run_rng)
            variants.append(Variant(twin, float(run_rng.uniform(0, 2 * pi))))
        count = setting.samples(draws[0].blocks)
        clean = clean_samples(variants, setting.columns.rate, setting.settle, count, setting.oversampling)
        for draw, variant, one in zip(draws, variants, clean, strict=True):
            if one is None or not np.isfinite(one).all():
                yield None
            else:
                yield _Motion(setting, variant.twin, draw.seed, drawn, one)


class _Motion:
    """A simulated run; what one observation of it shows is worked out once for all that show the same."""

    def __init__(
        self, setting: RunSetting, twin: AnyTwin, seed: int, number: int, clean: NDArray[np.float64]
    ) -> None:
        self._setting, self._twin = setting, twin
        rng = np.random.default_rng(SeedSequence(seed, spawn_key=(3,)))
        self._rows = dict(zip(twin.channels, twin.model.stray(twin, clean, rng), strict=True))
        rng = np.random.default_rng(SeedSequence(seed, spawn_key=(2, number)))
        self._noises = {name: _noise(twin.sensors[name], clean.shape[1], rng) for name in twin.channels}
        self._plain = self._through({name: twin.sensors[name] for name in twin.channels})
        self._known = Known(self._plain[setting.reference or twin.model.reference])

    def records(self, extra: tuple[Named, ...]) -> Records:
        """What its channels show with what else is wrong with its sensors, without their ends."""
        sensors = self._twin.model.with_effects(self._twin, _shown_in(self._setting, extra)).sensors
        other = {name: sensors[name] for name in self._plain if sensors[name] != self._twin.sensors[name]}
        return {**self._plain, **self._through(other)}

    def blocks(self, extra: tuple[Named, ...], blocks: int) -> Samples | None:
        """Fingerprints of them, shape (blocks, numbers); None where they tell no such."""
        found = self._setting.blocks_of(self.records(extra), known=self._known)[:blocks]
        return found if len(found) == blocks and np.isfinite(found).all() else None

    def _through(self, sensors: Mapping[str, Sensor]) -> Records:
        rate, quiet = self._setting.columns.rate, self._setting.quiet
        shown = {
            name: _through_chain(
                self._rows[source_of(name, sensor)], sensor, rate, quiet.get(name, 1.0), self._noises[name]
            )
            for name, sensor in sensors.items()
        }
        return self._setting.inner(shown)


def _shown_in(setting: RunSetting, effects: Sequence[Named]) -> list[Named]:
    """Effects without those on channels that were not measured in this run."""
    return [
        (name, values)
        for name, values in effects
        if values.get("channel", "") in ("", *setting.twin.channels)
    ]


def through_chains(
    clean: NDArray[np.float64], sensors: Sequence[Sensor], rate: float, quiet: float, rng: np.random.Generator
) -> list[Array]:
    """Samples of `clean` signals, shape (channels, n), as their sensors show them.

    Of the noise that they were recorded with, the share `quiet` (rms) is left at this `rate`. Each record is
    taken as one period, so that a high-pass is in its steady state.
    """
    return [
        _through_chain(row, sensor, rate, quiet, _noise(sensor, len(row), rng))
        for row, sensor in zip(clean, sensors, strict=True)
    ]


_Noise: TypeAlias = tuple[NDArray[np.float32], ...]


def _noise(sensor: Sensor, count: int, rng: np.random.Generator) -> _Noise:
    """Of rms 1: the sensor's, and that of the input behind its stages."""
    sources = 0 if isinstance(sensor, Encoder) else 1 if sensor.stages is None else 2
    return tuple(rng.standard_normal(count, np.float32) for _ in range(sources))


def _through_chain(row: Array, sensor: Sensor, rate: float, quiet: float, noises: _Noise) -> Array:
    if isinstance(sensor, Encoder):
        return sensor.shown(np.asarray(row, np.float64))
    noise = np.float32(quiet * sensor.noise) * noises[0]
    if sensor.stages is not None:
        own = np.float32(quiet * sensor.stages.floor) * noises[1]
        noise = _staged(row, noise, sensor, sensor.stages, rate) + own
    elif row.any():
        turned, length = _periodic(row)
        turned *= _response(sensor, len(turned), rate / length)
        noise = np.asarray(fft.irfft(turned, length)[: len(row)] + noise)
    limited = noise if sensor.limit == inf else np.clip(noise, -sensor.limit, sensor.limit)
    if sensor.pulses is not None:
        limited = PulseTimer(sensor.pulses, rate)(limited).astype(np.float32)
    shown = limited if sensor.factor == 1 else np.float32(sensor.factor) * limited
    if sensor.edges is None:
        return shown
    return counted_edges(np.concatenate([shown[:1], shown]), sensor.edges)


def _periodic(row: Array) -> tuple[NDArray[np.complex64], int]:
    """The spectrum of a record that leads back to its start, and how long that is."""
    length = fft.next_fast_len(len(row), real=True)
    padded = np.empty(length, np.float32)
    padded[: len(row)] = row
    padded[len(row) :] = np.linspace(row[-1], row[0], length - len(row))
    return fft.rfft(padded), length


def _staged(
    row: Array, noise: NDArray[np.float32], sensor: SensorChain, stages: Stages, rate: float
) -> NDArray[np.float32]:
    """Signal and noise, which is the sensor's own, through what a bench declares behind it."""
    turned, length = _periodic(row)
    turned *= _response(sensor, len(turned), rate / length)
    turned += _periodic(noise)[0]
    before, after = responses(stages, len(turned), rate / length)
    turned *= before
    if stages.output < inf:
        given = fft.irfft(turned, length)
        if max(given.max(), -given.min()) > stages.output:
            turned[:] = fft.rfft(np.clip(given, -stages.output, stages.output))
    turned *= after
    return np.asarray(fft.irfft(turned, length)[: len(row)])


def _response(chain: SensorChain, count: int, resolution: float) -> NDArray[np.complex64]:
    """At multiples of `resolution` (Hz)."""
    response = chain.gain * turning(-2 * np.pi * chain.skew * resolution, count)
    if chain.bandwidth_corner is None and chain.droop_corner is None:
        return response.astype(np.complex64)
    frequency = resolution * np.arange(count)
    if chain.bandwidth_corner is not None:
        x = 1j * frequency / chain.bandwidth_corner
        response /= 1 + np.sqrt(2) * x + x**2
    if chain.droop_corner is not None:
        response *= 1j * frequency / (chain.droop_corner + 1j * frequency)
    return response.astype(np.complex64)


def joined(runs: Sequence[Sequence[Samples | None]]) -> Observed:
    """Of each observation, the fingerprints of all runs side by side."""
    together = zip(*runs, strict=True)
    return tuple(
        None
        if any(one is None for one in each)
        else np.concatenate([one for one in each if one is not None], axis=1)
        for each in together
    )


def horizon_s(setting: RunSetting, response: int) -> float | None:
    """Seconds after which two motions from starts that nobody can tell apart differ by a tenth of their rms.

    `response` is the row of the channel that is compared. 2 s are the longest that is looked at; None where
    the motion could not be simulated.
    """
    columns = setting.columns
    starts = [Variant(setting.twin, pi / 3), Variant(setting.twin, pi / 3 + _APART)]
    pair = clean_samples(starts, columns.rate, 0.0, round(_LONGEST_S * columns.rate), setting.oversampling)
    if pair[0] is None or pair[1] is None:
        return None
    one, other = (rows[response] for rows in (pair[0], pair[1]))
    size = float(np.sqrt(np.mean(one**2)))
    length = max(1, round(columns.rate / columns.frequency / 8))
    count = len(one) // length
    apart = np.sqrt(np.mean((one - other)[: count * length].reshape(count, length) ** 2, axis=1))
    parted = np.flatnonzero(apart > _PARTED * size)
    return float(parted[0] * length / columns.rate) if len(parted) else _LONGEST_S
