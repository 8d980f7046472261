"""A subject of diagnosis whose truth is known: responses add up, scatter is normal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_twin.diagnosis.attribution import Attribution
from sim_twin.diagnosis.cause import Cause
from sim_twin.diagnosis.fingerprint import SLICES, Layout, of_cycles
from sim_twin.diagnosis.search import Ranked, Search
from sim_twin.diagnosis.subject import Draw, Named, Observed
from sim_twin.effects import Parameter

Blocks = NDArray[np.float32]
CELLS = 48
CHANNELS = ("one", "two", "three", "four")
SIZE = Parameter("size", "m", ((1.0, 4.0),))
WIDE = Parameter("size", "m", ((0.5, 8.0),))
LEFT = Cause("left", "here", (SIZE,))
RIGHT = Cause("right", "here", (WIDE,))
GAIN = Cause("gain", "sensor", (SIZE,), "one", sensing=True)
ASPECT = Cause("aspect", "there", (SIZE,))
LIKENESS = Cause("likeness", "elsewhere", (SIZE,))
LENGTH = Cause("model.length", "model", (SIZE,), entered=True)
CAUSES = (LEFT, RIGHT, GAIN, ASPECT, LIKENESS)
BLOCKS = 4
_OWN, _BLOCK = 0.5, 1.0
_SPREAD = np.linspace(-1.4, 1.4, SLICES)


def _directions() -> dict[str, NDArray[np.float64]]:
    """Of each cause, orthogonal; the two look-alikes share one. `strange` belongs to none but the length."""
    basis = np.linalg.qr(np.random.default_rng(11).normal(size=(CELLS, 5)))[0].T * np.sqrt(CELLS)
    left, right, gain, aspect, strange = basis
    return {
        "left": left, "right": right, "gain": gain,
        "aspect": aspect, "likeness": aspect, "strange": strange, LENGTH.name: strange,
    }  # fmt: skip


DIRECTIONS = _directions()


def healthy_rig(seed: int, blocks: int) -> NDArray[np.float64]:
    """What belongs to a rig, and what scatters from block to block, shape (blocks, CELLS)."""
    rng = np.random.default_rng(seed)
    return _OWN * rng.standard_normal(CELLS) + _BLOCK * rng.standard_normal((blocks, CELLS))


def response(effects: Sequence[Named], interplay: float = 0.0) -> NDArray[np.float64]:
    """In scatters, shape (CELLS,): straight but for a bend, and for what left and right do together."""
    total = np.zeros(CELLS)
    sizes = {name: float(values["size"]) for name, values in effects}
    for name, size in sizes.items():
        total += (size + 0.1 * size**2) * DIRECTIONS[name]
    if "left" in sizes and "right" in sizes:
        total += interplay * np.sqrt(sizes["left"] * sizes["right"]) * DIRECTIONS["strange"]
    return total


def shown(means: NDArray[np.float64]) -> Blocks:
    """Fingerprints of blocks: each cell a distribution about its mean."""
    return (means[:, :, None] + _SPREAD).reshape(len(means), CELLS * SLICES).astype(np.float32)


def spent(search: Search) -> tuple[Attribution, list[Ranked]]:
    """What a search comes to that spends what it may."""
    found = search.until_one_leads()
    return search.go_on() if search.may_go_on else found


def recording(effects: Sequence[Named], seed: int, blocks: int = BLOCKS, interplay: float = 0.0) -> Blocks:
    """Fingerprints of a rig with some effects in."""
    return shown(healthy_rig(seed, blocks) + response(effects, interplay))


@dataclass(frozen=True, slots=True)
class Toy:
    """Four channels of twelve cells; with `interplay`, left and right together are not the sum of both."""

    causes: tuple[Cause, ...] = CAUSES
    interplay: float = 0.0
    doubts: tuple[Cause, ...] = ()

    @property
    def layout(self) -> Layout:
        return Layout(tuple(of_cycles(0, CHANNELS[k % len(CHANNELS)], "height") for k in range(CELLS)))

    def observe(self, draws: Sequence[Draw]) -> list[Observed]:
        return [
            tuple(
                recording((*draw.effects, *extra), draw.seed, draw.blocks, self.interplay)
                for extra in draw.sensing
            )
            for draw in draws
        ]
