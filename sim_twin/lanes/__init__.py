"""Ensembles of linear structures between two stops: many runs in the lanes of vector registers."""
