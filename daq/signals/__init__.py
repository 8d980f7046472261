"""Pure functions on arrays of samples: spectra, responses, orders, mean cycles, impacts, envelopes.

What makes sense while a rig runs has an object beside the function, which takes the same samples in blocks
of any size and finds the same, to the bit: `SpectrumAverage`, `FrfAverage`, `AngleSampler`, `CycleAverage`,
`ImpactDetector` and `BounceGrouper`. Samples that are missing are NaN, samples that must not
count are flagged.
"""

from daq.signals.envelope import Envelope, envelope
from daq.signals.even_angles import AngleSampler, EvenAngles, angle_turns, smooth_turns, turns_at
from daq.signals.frf import Frf, FrfAverage, frf
from daq.signals.impact_events import (
    BounceGrouper,
    ImpactDetector,
    ImpactEvents,
    impact_events,
)
from daq.signals.impacts import (
    HalfCycles,
    Impacts,
    Levels,
    contacts_above,
    find_impacts,
    half_cycles,
    levels_of,
)
from daq.signals.orders import OrderMap, OrderTracks, order_map, order_tracks
from daq.signals.segments import Segmenting
from daq.signals.sine import SineFit, fit_sine
from daq.signals.spectrum import (
    Autospectrum,
    AveragedSpectrum,
    SpectrumAverage,
    ThirdOctaves,
    autospectrum,
    averaged_spectrum,
    log_bands,
    third_octaves,
)
from daq.signals.synchronous import CycleAverage, SynchronousAverage, synchronous_average

__all__ = [
    "AngleSampler",
    "Autospectrum",
    "AveragedSpectrum",
    "BounceGrouper",
    "CycleAverage",
    "Envelope",
    "EvenAngles",
    "Frf",
    "FrfAverage",
    "HalfCycles",
    "ImpactDetector",
    "ImpactEvents",
    "Impacts",
    "Levels",
    "OrderMap",
    "OrderTracks",
    "Segmenting",
    "SineFit",
    "SpectrumAverage",
    "SynchronousAverage",
    "ThirdOctaves",
    "angle_turns",
    "autospectrum",
    "averaged_spectrum",
    "contacts_above",
    "envelope",
    "find_impacts",
    "fit_sine",
    "frf",
    "half_cycles",
    "impact_events",
    "levels_of",
    "log_bands",
    "order_map",
    "order_tracks",
    "smooth_turns",
    "synchronous_average",
    "third_octaves",
    "turns_at",
]
