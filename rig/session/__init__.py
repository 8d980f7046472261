"""One run on the rig: from connecting to the safe state, and everything that is recorded on the way."""

from rig.session.run import run_scenario
from rig.session.signals import Stopped

__all__ = ["Stopped", "run_scenario"]
