"""Effects: what a nominal twin leaves out or has wrong, each one object in a catalogue of its rig."""

from sim_twin.effects.catalogue import IMPACT_BEAM, apply_effects
from sim_twin.effects.effect import Effect, Parameter, ParameterValues

__all__ = ["IMPACT_BEAM", "Effect", "Parameter", "ParameterValues", "apply_effects"]
