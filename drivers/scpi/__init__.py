"""Function generators that speak SCPI: Agilent 33210A, 33220A, 33500 and 33600 series."""

from drivers.scpi.generator import GeneratorSettings, ScpiGenerator

__all__ = ["GeneratorSettings", "ScpiGenerator"]
