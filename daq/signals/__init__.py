"""Pure functions on arrays of samples: spectra, impacts, envelopes."""

from daq.signals.envelope import Envelope, envelope
from daq.signals.impacts import HalfCycles, Impacts, find_impacts, half_cycles
from daq.signals.sine import SineFit, fit_sine
from daq.signals.spectrum import Autospectrum, autospectrum, log_bands

__all__ = [
    "Autospectrum",
    "Envelope",
    "HalfCycles",
    "Impacts",
    "SineFit",
    "autospectrum",
    "envelope",
    "find_impacts",
    "fit_sine",
    "half_cycles",
    "log_bands",
]
