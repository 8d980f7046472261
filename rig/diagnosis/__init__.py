"""Reads recorded runs, has them diagnosed, and writes what came out."""
