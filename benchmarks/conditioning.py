"""How well conditioned is what twin and diagnosis solve: every call of linear algebra, by the line of it.

`as it stands` is the largest condition number of the matrices that a line handed over. `scaled` is that of
the same with rows and columns brought to one size, which is what hurts: LAPACK's factorisations do not mind
displacements in m beside velocities in m/s. An eigenproblem K x = lambda M x has two lines, K and M: its
small eigenvalues lose what K has. A least squares has that of its columns. The logarithm bounds the digits
that may be lost.

Usage: python -m benchmarks.conditioning [LOG.mcap]
"""

from __future__ import annotations

import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import Any

import numpy as np
import scipy.linalg

_WATCHED = {
    np.linalg: ("solve", "inv", "pinv", "lstsq", "eig", "eigvals", "eigh", "eigvalsh", "svd", "qr"),
    scipy.linalg: ("solve", "eigh", "cho_factor", "qr", "expm"),
}
_LARGEST = 800
"""Rows of a matrix whose condition is still looked at; finding it takes the cube of it."""
_EQUILIBRATIONS = 4
_SOURCE = ("sim_twin", "rig", "daq")


@dataclass(slots=True)
class Line:
    """What was seen of one line of the source."""

    calls: int = 0
    plain: float = 0.0
    scaled: float = 0.0
    size: int = 0


LINES: dict[tuple[str, str], Line] = {}


def _equilibrated(matrix: np.ndarray) -> np.ndarray:
    scaled = matrix
    for _ in range(_EQUILIBRATIONS):
        for axis in (1, 0):
            size = np.sqrt(np.abs(scaled).max(axis=axis, keepdims=True))
            scaled = scaled / np.where(size > 0, size, 1.0)
    return scaled


def _seen(name: str, matrix: Any) -> None:
    a = np.asarray(matrix)
    caller = next((frame for frame in reversed(traceback.extract_stack()) if _place(frame)), None)
    if caller is None or a.ndim != 2 or not a.size or not np.isfinite(a).all():
        return
    line = LINES.setdefault(("/".join(_place(caller)) + f":{caller.lineno}", name), Line())
    line.calls += 1
    if max(a.shape) <= _LARGEST and line.calls <= 20:
        plain, scaled = (_condition(each) for each in (a, _equilibrated(a)))
        line.plain, line.scaled = max(line.plain, plain), max(line.scaled, scaled)
        line.size = max(line.size, min(a.shape))


def _place(frame: traceback.FrameSummary) -> list[str]:
    parts = list(Path(frame.filename).parts)
    return next((parts[parts.index(top) :] for top in _SOURCE if top in parts), [])


def _condition(matrix: np.ndarray) -> float:
    values = scipy.linalg.svdvals(matrix)
    return float(values[0] / values[-1]) if values[-1] > 0 else float("inf")


def _watch(module: Any, name: str) -> None:
    function: Callable[..., Any] = getattr(module, name)

    @wraps(function)
    def watched(*args: Any, **kwargs: Any) -> Any:
        of = f"{module.__name__.split('.')[0]} {name}"
        if name == "eigh" and module is scipy.linalg and len(args) > 1:
            _seen(f"{of}, K", args[0])
            _seen(f"{of}, M", args[1])
        else:
            _seen(of, args[0])
        return function(*args, **kwargs)

    setattr(module, name, watched)


def _ask(log: Path | None) -> None:
    """Go through structures and first contacts of all rigs, a resonance, a clock, a diagnosis of `log`."""
    from benchmarks.processors import diagnosis, first_peaks, structures
    from daq.time_base.model import robust_line
    from sim_twin.linear_filter import oscillator
    from sim_twin.rigs.impact_beam.model import nominal
    from sim_twin.rigs.impact_beam.structure import resting

    structures()
    first_peaks()
    resting(nominal())
    for hertz in (0.5, 2e4):
        omega = 2 * np.pi * hertz
        oscillator(omega, 0.04 * omega, 1.0, (1.0, 0.0), 0.0, 51200.0)
    x = np.linspace(0.0, 600.0, 600)
    for steps in (1, 3):
        robust_line(x, np.sin(x), np.arange(600) * steps // 600, np.ones(600))
    if log is not None:
        diagnosis(log, budget_s=10.0)


def main() -> None:
    """Print the lines, the worst conditioned first."""
    for module, names in _WATCHED.items():
        for name in names:
            _watch(module, name)
    _ask(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
    print("as it stands  scaled   size  calls  line")
    for (place, name), line in sorted(LINES.items(), key=lambda item: -item[1].scaled):
        print(f"{line.plain:10.1e} {line.scaled:9.1e} {line.size:6d} {line.calls:6d}  {place} ({name})")


if __name__ == "__main__":
    main()
