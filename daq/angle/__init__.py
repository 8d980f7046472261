"""Crank angle: counters unwrapped, marks followed, encoder and marker checked against each other."""
