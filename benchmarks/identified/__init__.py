"""Whether `rattle identify` finds the values of rigs that lie far from what their scenarios say."""
