"""Instruments: one folder for each family, each with its driver and an emulator that speaks the same wire."""
