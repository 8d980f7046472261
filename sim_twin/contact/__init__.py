"""Contact: normal force laws, sliding friction, and the stiffness of a pair of surfaces."""

from sim_twin.contact.laws import (
    ContactLaw,
    Friction,
    friction_share,
    hertz,
    hunt_crossley,
    lankarani_nikravesh,
    linear,
    normal_force,
    stored_energy,
)
from sim_twin.contact.stiffness import Elastic, generalised_stiffness

__all__ = [
    "ContactLaw",
    "Elastic",
    "Friction",
    "friction_share",
    "generalised_stiffness",
    "hertz",
    "hunt_crossley",
    "lankarani_nikravesh",
    "linear",
    "normal_force",
    "stored_energy",
]
