"""Finds the offset of the drive that holds a beam's tip in the middle between its stops."""
