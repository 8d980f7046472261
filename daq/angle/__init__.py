"""Crank angle: counters unwrapped, marks followed, encoder and marker checked against each other."""

from daq.angle.marker import CrankAngle, Marks, MarkTracker, SpeedChange, crank_angle
from daq.angle.skew import AtMark, RecordingSkew, Skew, angles_at_marks, fastest_rad_s, find_skew, late
from daq.angle.unwrap import Unwrapped, Unwrapper

__all__ = [
    "AtMark",
    "CrankAngle",
    "MarkTracker",
    "Marks",
    "RecordingSkew",
    "Skew",
    "SpeedChange",
    "Unwrapped",
    "Unwrapper",
    "angles_at_marks",
    "crank_angle",
    "fastest_rad_s",
    "find_skew",
    "late",
]
