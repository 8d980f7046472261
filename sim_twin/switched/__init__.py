"""Systems that are linear between switches (contact, sticking), integrated exactly from switch to switch."""

from sim_twin.switched.simulation import Simulation, Trace
from sim_twin.switched.system import Event, Excitation, Output, Regime, Residual, Row, SwitchedSystem

__all__ = [
    "Event",
    "Excitation",
    "Output",
    "Regime",
    "Residual",
    "Row",
    "Simulation",
    "SwitchedSystem",
    "Trace",
]
