"""Effects: what they are, how they are applied; those of sensors and clocks. Each rig has its own besides."""

from sim_twin.effects.effect import Catalogue, Effect, Parameter, ParameterValues, apply_effects, catalogue_of

__all__ = ["Catalogue", "Effect", "Parameter", "ParameterValues", "apply_effects", "catalogue_of"]
