"""A measure of the gap that shares nothing with the diagnosis's: energy distances of features of cycles."""
