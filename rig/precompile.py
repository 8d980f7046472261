"""Compiles the twins of all rigs ahead of their first use: `python -m rig.precompile`."""

from __future__ import annotations

from rig.files.scenario import parse_scenario
from rig.twin.scenario_twin import twin_of
from sim_twin.ensembles.clean_samples import clean_samples
from sim_twin.ensembles.variant import Variant
from sim_twin.rigs.catalogue import model_of
from sim_twin.sensors import oversampling

_RATE = 25_600.0
_DRIVES = {
    "impact_beam": 'frequency = "20 Hz"\namplitude = "9 N"',
    "planar_slider_crank": 'speed = "200 rpm"',
    "spatial_slider_crank": 'speed = "200 rpm"',
}


def compile_rig(rig: str) -> None:
    """Run the rig's twin as a stream, as an ensemble and for its figures, each for a moment."""
    twin = twin_of(parse_scenario(f'name = "{rig}"\nrig = "{rig}"\n[drive]\n{_DRIVES[rig]}\n' + _ACQUISITION))
    model = model_of(twin)
    stream = model.stream(twin, _RATE)
    stream.drive(twin.drive)
    stream.advance(64)
    clean_samples([Variant(twin, 0.0), Variant(twin, 1.0)], _RATE, 0.01, 64, oversampling(_RATE))
    model.solver_values(twin, 0.05, 0.05)


_ACQUISITION = '[acquisition]\nsample_rate = "25.6 kHz"\nsettle = "1 s"\nduration = "1 s"\n'

if __name__ == "__main__":
    for each in _DRIVES:
        compile_rig(each)
