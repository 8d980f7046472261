"""A series of runs: what would be done, doing it point by point, and what is done already."""
