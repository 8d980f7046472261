"""Mechanisms with intermittent contacts: one adaptive integrator for all of them."""
