"""What the joints' forces lack: against displacement, velocity and time in the cycle."""

from __future__ import annotations

import numpy as np

from rig.diagnosis.report.before_and_after import LINES
from rig.diagnosis.report.case import Case
from rig.pages.content import Part, Sentence
from rig.pages.plots import Plots
from rig.pages.words import estimate
from sim_twin.diagnosis.latent_force import Curve, LatentForce

_SHOWN = 2
_ROW_PX = 230
_SHOWN_UNITS = {"m": ("mm", 1e3), "m/s": ("m/s", 1.0), "": ("", 1.0)}
_CLOSE = 1e-4
"""m; shorter ways are told in micrometres."""
_CAPTION = (
    "Mean force, reconstructed from the recorded channels and from twins' in the same way. What the measured "
    "line has beside the grey band (two standard deviations of healthy rigs) is the latent force: "
    "what acts there and is not in the twin."
)


def parts(case: Case) -> list[Part]:
    """A row of plots for each of the joints whose forces are furthest from the twin's."""
    shown = [each for each in case.forces if each.size > 0][:_SHOWN]
    if not shown:
        return []
    plots = Plots(len(shown), len(shown[0].curves), _ROW_PX, legend=True)
    for row, latent in enumerate(shown):
        for column, curve in enumerate(latent.curves):
            _draw(plots, row * len(latent.curves) + column, latent, curve)
    return [Sentence(_told(case, shown[0])), plots.figure("latent-force", _CAPTION)]


def _told(case: Case, latent: LatentForce) -> str:
    curve = max(latent.curves, key=lambda each: each.size)
    where = f" in {case.run_name(latent.run)}" if len(case.runs) > 1 else ""
    off = np.where(np.isfinite(curve.latent / curve.scatter), np.abs(curve.latent / curve.scatter), 0.0)
    at = int(np.argmax(off))
    unit, factor = _unit(curve)
    place = estimate(factor * float(curve.edges[at : at + 2].mean()), unit)
    force = estimate(abs(curve.latent[at]), "N")
    more = "more" if curve.latent[at] > 0 else "less"
    return (
        f"Furthest from the twin's is the mean force at the {latent.joint}{where}: {force} {more} "
        f"at a {curve.axis.name} of {place}, {off[at]:.1f} times the scatter of healthy rigs."
    )


def _unit(curve: Curve) -> tuple[str, float]:
    if curve.axis.unit == "m" and np.max(np.abs(curve.edges)) < _CLOSE:
        return "µm", 1e6
    return _SHOWN_UNITS[curve.axis.unit]


def _draw(plots: Plots, cell: int, latent: LatentForce, curve: Curve) -> None:
    unit, factor = _unit(curve)
    label = f"{curve.axis.name}, {unit}" if unit else curve.axis.name
    plots.axes(cell, latent.joint, label, "mean force, N")
    middles = factor * (curve.edges[:-1] + curve.edges[1:]) / 2
    known = np.isfinite(curve.twin)
    low, high = (curve.twin + sign * 2 * curve.scatter for sign in (-1, 1))
    plots.band(cell, middles[known], low[known], high[known], "linear")
    plots.line(cell, "measured", middles, curve.measured, LINES["measured"])
    plots.line(cell, "nominal twin", middles, curve.twin, LINES["nominal twin"])
