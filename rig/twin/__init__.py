"""Joins a scenario with the physics twin: its parameters, its phase, its effects, its emulated rig."""
