"""Thousands of runs of a twin in one call: drawn, simulated in chunks on any executor, summed up."""
