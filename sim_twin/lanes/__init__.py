"""Ensembles of linear structures between two stops: many runs in the lanes of vector registers."""

from sim_twin.lanes.lane import Harmonics, Lane, Stops
from sim_twin.lanes.lanes import Lanes

__all__ = ["Harmonics", "Lane", "Lanes", "Stops"]
