"""Autospectra, measured and of the twin or twins."""

from __future__ import annotations

from daq.signals.spectrum import autospectrum, log_bands
from rig.pages.content import Part, Sentence
from rig.pages.plots import Plots
from rig.report.record import ORIGINS, RunRecord

_ROW_PX = 190
_BANDS = 500
_COLUMNS = 2


def parts(run: RunRecord) -> list[Part]:
    """One plot for each channel that vibrates, both axes logarithmic."""
    if not run.traces:
        return [Sentence("The log holds no samples.")]
    channels = {name: run.channels[name] for name in run.roles.vibration}
    grid = Plots(rows=-(-len(channels) // _COLUMNS), columns=_COLUMNS, row_px=_ROW_PX)
    empty = []
    for cell, (name, channel) in enumerate(channels.items()):
        unit = channel.unit if channel.unit.isalpha() else f"({channel.unit or '-'})"
        y = {"type": "log", "exponentformat": "power", "nticks": 6}
        x = {"type": "log", "dtick": 1}
        grid.axes(cell, f"{name}, {unit}²/Hz", "frequency, Hz", x_axis=x, y_axis=y, share_x_with=0)
        for origin in ORIGINS:
            trace = run.traces.get((origin, name))
            if trace is None:
                continue
            spectrum = log_bands(autospectrum(trace.values, trace.sample_rate), _BANDS)
            heard = spectrum.density > 0
            grid.line(
                cell, run.whose(origin), spectrum.frequency_hz[heard], spectrum.density[heard], subject=name
            )
            if not heard.any():
                empty.append(f"{name} ({run.whose(origin)})")
    text = "Welch: Hann window, 0.5 s segments, half overlap, mean removed; averaged over narrow bands."
    missing = [Sentence(f"Too few samples, or nothing but zeros: {', '.join(empty)}.")] if empty else []
    return [
        Sentence(text),
        *missing,
        grid.figure("spectra", "Drag to zoom. The frequency axes move together."),
    ]
