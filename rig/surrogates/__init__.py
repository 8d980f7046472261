"""Surrogates of recorded runs: how they are trained, and how far they may be trusted."""
