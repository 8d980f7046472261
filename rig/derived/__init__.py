"""What is computed from the samples of a run while it is recorded, and again, to the bit, in a replay.

Speed of a crank, impacts, rms and peak of each cycle; measured and predicted by the same code.
"""

from rig.derived.background import InBackground
from rig.derived.settings import RECORD, from_record
from rig.derived.sink import DerivedSink, derived_channels

__all__ = ["RECORD", "DerivedSink", "InBackground", "derived_channels", "from_record"]
