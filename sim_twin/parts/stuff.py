"""What anything may be made of."""

from __future__ import annotations

from typing import Final

from daq.quantity import Quantity

MODULUS: Final = Quantity("GPa", 0.01, 1000, key="modulus")
DENSITY: Final = Quantity("kg/m^3", 10, 25_000, key="density")
POISSON: Final = Quantity("", 0, 0.5, key="poisson")
