"""Compiles twins ahead of their first use: `python -m rig.precompile SCENARIO.toml...`."""

from __future__ import annotations

import sys
from pathlib import Path

from daq.signals import even_angles, running_figures
from rig.files.scenario import load_scenario
from rig.twin.scenario_twin import twin_of
from sim_twin.ensembles.clean_samples import clean_samples
from sim_twin.ensembles.simulate import Variant
from sim_twin.sensors import oversampling

_SAMPLES = 64
_STARTS_RAD = (0.0, 1.0)


def precompile(scenario: Path) -> None:
    """Run a scenario's twin as a stream, in an ensemble, for its figures, and derive from it, for a moment.

    Raises ConfigurationError for a scenario that is none.
    """
    read = load_scenario(scenario)
    twin, rate = twin_of(read), read.acquisition.sample_rate
    model = twin.model
    stream = model.stream(twin, rate)
    stream.drive(twin.drive)
    stream.advance(_SAMPLES)
    variants = [Variant(twin, start) for start in _STARTS_RAD]
    clean_samples(variants, rate, _SAMPLES / rate, _SAMPLES, oversampling(rate))
    model.solver_values(twin, _SAMPLES / rate, _SAMPLES / rate)
    running_figures.warm_up()
    even_angles.warm_up()


if __name__ == "__main__":
    for file in sys.argv[1:]:
        precompile(Path(file))
