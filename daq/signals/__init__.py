"""Pure functions on arrays of samples: spectra, responses, orders, mean cycles, impacts, envelopes.

What makes sense while a rig runs has an object beside the function, which takes the same samples in blocks
of any size and finds the same, to the bit: `SpectrumAverage`, `FrfAverage`, `AngleSampler`, `CycleAverage`,
`CycleMeter`, `ImpactDetector` and `BounceGrouper`. Samples that are missing are NaN, samples that must not
count are flagged.
"""
