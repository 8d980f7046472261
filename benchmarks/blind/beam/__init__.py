"""The impact beam for the blind check: finite elements, motion by Exudyn, and a measuring chain of its own.

Nothing of the twin is used.
"""
