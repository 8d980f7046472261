"""Frequency responses of daq.signals against those of sdypy-FRF: the largest relative difference of each.

Three resonators under one random force, noise on force and responses, Hann window, overlap by half. The last
figure has an overloaded stretch: ours is told so, the peer gets the segments around it one by one.

Usage: python -m benchmarks.frf_peer      (needs sdypy-FRF, of the extra `peers`)
Returns 1 if a difference is above 1e-10.
"""

from __future__ import annotations

import sys

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from daq.signals.frf import Frf, frf
from daq.signals.spectrum import Segmenting

RATE = 4096
SEGMENT = 2048
SECONDS = 30
RESONATORS = ((120.0, 0.01), (430.0, 0.02), (900.0, 0.05))  # Hz and damping ratio
BAR = 1e-10
OVERLOAD = slice(10 * SEGMENT + 100, 10 * SEGMENT + 140)


def record() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Force, shape (n,), and responses, shape (3, n)."""
    rng = np.random.default_rng(1)
    force = rng.normal(size=RATE * SECONDS)
    responses = []
    for frequency, damping in RESONATORS:
        pole = np.exp(2 * np.pi * frequency / RATE * (-damping + 1j * np.sqrt(1 - damping**2)))
        responses.append(signal.lfilter([0.0, 0.2], [1, -2 * pole.real, abs(pole) ** 2], force))
    noise = 0.05 * rng.normal(size=(4, len(force)))
    return force + noise[0], np.stack(responses) + noise[1:]


def peer(force: NDArray[np.float64], responses: NDArray[np.float64]) -> dict[str, NDArray[np.complex128]]:
    """The peer's estimates, shape (3, lines), of measurements: force (k, n) and responses (k, 3, n)."""
    from sdypy import FRF

    theirs = FRF.FRF(
        RATE, force, responses, exc_type="f", resp_type="d", window="hann",
        fft_len=SEGMENT, nperseg=SEGMENT, noverlap=SEGMENT // 2,
    )  # fmt: skip
    found = {name: theirs.get_FRF(name)[:, 0, 1:] for name in ("H1", "H2", "Hv")}
    return found | {"coherence": theirs.get_coherence()[:, 1:]}


def ours(found: Frf) -> dict[str, NDArray[np.complex128] | NDArray[np.float64]]:
    return {"H1": found.h1, "H2": found.h2, "Hv": found.hv(), "coherence": found.coherence}


def main() -> int:
    """Print the differences."""
    force, responses = record()
    # The peer's Hann window is the symmetric one.
    segmenting = Segmenting(SEGMENT, overlap=0.5, window=np.hanning(SEGMENT))
    plain = ours(frf(force, responses, RATE, segmenting)), peer(force[None], responses[None])

    flagged = np.zeros(len(force), dtype=bool)
    flagged[OVERLOAD] = True
    spoilt = np.where(flagged, 1e3, responses)
    starts = np.arange(0, len(force) - SEGMENT + 1, SEGMENT // 2)
    good = [slice(start, start + SEGMENT) for start in starts if not flagged[start : start + SEGMENT].any()]
    alone = peer(np.stack([force[part] for part in good]), np.stack([responses[:, part] for part in good]))
    overloaded = ours(frf(force, spoilt, RATE, segmenting, flagged)), alone

    worst = 0.0
    for case, (mine, theirs) in (("all segments", plain), ("overload left out", overloaded)):
        for name in mine:
            difference = float(np.max(np.abs(mine[name] - theirs[name]) / np.abs(theirs[name])))
            worst = max(worst, difference)
            print(f"{case:18s} {name:10s} largest relative difference {difference:.1e}")
    print(f"largest of all {worst:.1e}, bar {BAR:.0e}")
    return int(worst > BAR)


if __name__ == "__main__":
    sys.exit(main())
