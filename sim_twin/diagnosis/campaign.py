"""Runs of one rig as a subject of diagnosis: simulated and measured records become fingerprints alike."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from math import ceil, pi
from typing import TypeAlias

import numpy as np
from numpy.random import SeedSequence
from numpy.typing import NDArray

from sim_twin.diagnosis.cause import Cause
from sim_twin.diagnosis.chains import through_chains
from sim_twin.diagnosis.draw import Draw, Named, Observed, Values
from sim_twin.diagnosis.fingerprint.columns import Columns
from sim_twin.diagnosis.fingerprint.layout import Layout, joined
from sim_twin.effects.effect import Effect
from sim_twin.ensembles.clean_samples import clean_samples
from sim_twin.ensembles.variant import Variant
from sim_twin.rigs.cycles import Cycles
from sim_twin.sensors import Encoder
from sim_twin.twin import AnyTwin

Array = NDArray[np.floating]
Samples = NDArray[np.float32]
Records: TypeAlias = dict[str, Array]
"""One run's channels at the setting's rate, each (n,)."""
_GUARD_S = 4e-3
"""Cut from both ends of a simulated record: a skew shifts its end into its start."""
_SETTLE_S, _SETTLE_CYCLES = 0.5, 2.0


@dataclass(frozen=True, slots=True)
class RunSetting:
    """One run: the nominal `twin` in step with it, and how its records are looked at.

    `columns` say at which rate (Hz) and in which cycles; a block has `cycles` of them. The truth is computed
    at `oversampling` times the rate. `quiet` is the share of the noise's rms that resampling left.
    """

    twin: AnyTwin
    columns: Columns
    oversampling: int
    cycles: int
    quiet: float = 1.0

    def samples(self, blocks: int) -> int:
        """How many samples hold so many blocks, wherever the first cycle begins."""
        period = self.columns.rate / self.columns.frequency
        return ceil((self.cycles * blocks + 2.6) * period + 2 * self._guard)

    @property
    def settle(self) -> float:
        """Seconds that a simulated motion has to forget its start."""
        return max(_SETTLE_S, _SETTLE_CYCLES / self.columns.frequency)

    @property
    def _guard(self) -> int:
        return round(_GUARD_S * self.columns.rate)

    def blocks_of_simulated(self, records: Mapping[str, Array], blocks: int) -> Samples:
        """Fingerprints of simulated records, shape (blocks, numbers)."""
        return self.blocks_of(self.inner(records))[:blocks]

    def inner(self, records: Mapping[str, Array]) -> Records:
        """Simulated records without their ends."""
        cut = slice(self._guard, -self._guard)
        return {name: record[cut] for name, record in records.items()}

    def cycles_in(self, records: Mapping[str, Array]) -> Cycles:
        """The cycles of measured or simulated records."""
        model = self.twin.model
        return model.follow(records[model.reference], self.columns.rate, self.columns.frequency)

    def blocks_of(self, records: Mapping[str, Array], sound: NDArray[np.bool_] | None = None) -> Samples:
        """Fingerprints of all whole blocks in `records`, each (n,), without cycles that are not `sound`."""
        cycles = self.cycles_in(records)
        starts, length = cycles.starts(len(records[self.twin.model.reference])), cycles.length
        if sound is not None:
            starts = starts[[bool(sound[at : at + length + length // 2].all()) for at in starts]]
        signals = [_signal(self.twin, name, records[name], cycles) for name in self.columns.channels]
        table = self.columns.numbers(signals, starts, length)
        parts = range(0, len(table) - self.cycles + 1, self.cycles)
        return np.array([table.fingerprint(slice(first, first + self.cycles)) for first in parts])


def _signal(twin: AnyTwin, name: str, record: Array, cycles: Cycles) -> Samples:
    """An angle is told by how it swings about its mean line."""
    if not isinstance(twin.sensors.get(name), Encoder):
        return np.asarray(record, np.float32)
    line = cycles.phase + 2 * pi * cycles.frequency / cycles.rate * np.arange(len(record))
    return np.asarray(record - line, np.float32)


@dataclass(frozen=True, slots=True)
class Campaign:
    """Some runs of one rig."""

    runs: tuple[RunSetting, ...]

    @property
    def layout(self) -> Layout:
        """What the numbers of a fingerprint are."""
        return joined(tuple(Layout(run.columns.cells(k)) for k, run in enumerate(self.runs)))

    @property
    def causes(self) -> tuple[Cause, ...]:
        """Every effect that the rig can have, once for each channel in the records that it may sit on."""
        twins, shown = [run.twin for run in self.runs], set(self.runs[0].columns.channels)
        found = []
        for effect in twins[0].model.effects.values():
            if any(effect.refusal(twin) for twin in twins):
                continue
            channels = [name for name in effect.channels if name in shown] if effect.channels else [None]
            allows = partial(_fine_together, effect)
            found += [
                Cause(
                    effect.name,
                    effect.location,
                    effect.parameters,
                    channel,
                    effect.sensing,
                    allows,
                    effect.coordinates,
                )
                for channel in channels
            ]
        return tuple(found)

    def observe(self, draws: Sequence[Draw]) -> list[Observed]:
        """Simulate some draws side by side."""
        found = [self._observe_run(k, setting, draws) for k, setting in enumerate(self.runs)]
        return [_joined([run[number] for run in found]) for number in range(len(draws))]

    def records(self, draws: Sequence[Draw]) -> list[list[Records | None]]:
        """What the channels of each run show, (runs, draws); None for a run that failed."""
        return [self._records_of_run(k, setting, draws) for k, setting in enumerate(self.runs)]

    def _records_of_run(
        self, number: int, setting: RunSetting, draws: Sequence[Draw]
    ) -> list[Records | None]:
        variants, clean = self._simulated(number, setting, draws)
        return [
            None if one is None else setting.inner(_shown(setting, number, variant, draw, one, ()))
            for draw, variant, one in zip(draws, variants, clean, strict=True)
        ]

    def _observe_run(
        self, number: int, setting: RunSetting, draws: Sequence[Draw]
    ) -> list[list[Samples | None]]:
        variants, clean = self._simulated(number, setting, draws)
        return [
            [None] * len(draw.sensing)
            if one is None
            else [_observed(setting, number, variant, draw, one, extra) for extra in draw.sensing]
            for draw, variant, one in zip(draws, variants, clean, strict=True)
        ]

    def _simulated(
        self, number: int, setting: RunSetting, draws: Sequence[Draw]
    ) -> tuple[list[Variant], list[NDArray[np.float64] | None]]:
        """The rigs of some draws, and the clean signals of each; None for one that failed."""
        variants = [self._variant(number, setting, draw) for draw in draws]
        count = setting.samples(max(draw.blocks for draw in draws))
        clean = clean_samples(variants, setting.columns.rate, setting.settle, count, setting.oversampling)
        return variants, [None if one is None or not np.isfinite(one).all() else one for one in clean]

    def _variant(self, number: int, setting: RunSetting, draw: Draw) -> Variant:
        """The same rig in every run, set up anew in each."""
        model = setting.twin.model
        rig_rng = np.random.default_rng(SeedSequence(draw.seed, spawn_key=(0,)))
        run_rng = np.random.default_rng(SeedSequence(draw.seed, spawn_key=(1, number)))
        twin = model.draw_healthy(model.with_effects(setting.twin, draw.effects), rig_rng, run_rng)
        return Variant(twin, float(run_rng.uniform(0, 2 * pi)))


def _fine_together(effect: Effect, values: Values) -> bool:
    return not effect.together(values)


def _observed(
    setting: RunSetting, number: int, variant: Variant, draw: Draw, clean: NDArray[np.float64],
    extra: tuple[Named, ...],
) -> Samples | None:  # fmt: skip
    shown = _shown(setting, number, variant, draw, clean, extra)
    blocks = setting.blocks_of_simulated(shown, draw.blocks)
    return blocks if len(blocks) == draw.blocks and np.isfinite(blocks).all() else None


def _shown(
    setting: RunSetting, number: int, variant: Variant, draw: Draw, clean: NDArray[np.float64],
    extra: tuple[Named, ...],
) -> Records:  # fmt: skip
    twin = variant.twin.model.with_effects(variant.twin, extra)
    rng = np.random.default_rng(SeedSequence(draw.seed, spawn_key=(2, number)))
    stray = twin.model.stray(twin, clean, np.random.default_rng(SeedSequence(draw.seed, spawn_key=(3,))))
    sensors = [twin.sensors[name] for name in twin.channels]
    shown = through_chains(stray, sensors, setting.columns.rate, setting.quiet, rng)
    return dict(zip(twin.channels, shown, strict=True))


def _joined(runs: Sequence[Sequence[Samples | None]]) -> Observed:
    """Of each observation, the fingerprints of all runs side by side."""
    together = zip(*runs, strict=True)
    return tuple(
        None
        if any(one is None for one in each)
        else np.concatenate([one for one in each if one is not None], axis=1)
        for each in together
    )
