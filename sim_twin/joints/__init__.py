"""Joints with clearance: their geometry and the forces in them, for kernels."""
