"""One rig, several runs: what belongs to the rig stays, what is set anew for each run does not."""

from __future__ import annotations

import numpy as np

from sim_twin.rigs.impact_beam.model import SineDrive, nominal
from sim_twin.rigs.impact_beam.rig import MODEL
from sim_twin.twin import Twin


def test_the_rig_stays_and_each_run_is_set_anew() -> None:
    twin = Twin(nominal(), SineDrive(9.0, 20.0))
    runs = [MODEL.draw_healthy(twin, np.random.default_rng(7), np.random.default_rng(run)) for run in (1, 2)]
    assert runs[0].rig.beam == runs[1].rig.beam
    assert runs[0].rig.contact_stiffness == runs[1].rig.contact_stiffness
    assert runs[0].sensors == runs[1].sensors
    assert runs[0].rig.clearance != runs[1].rig.clearance
    assert runs[0].drive != runs[1].drive
