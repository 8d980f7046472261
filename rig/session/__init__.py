"""One run on the rig: from connecting to the safe state, and everything that is recorded on the way."""

from rig.session.outcome import RunOutcome, Stopped
from rig.session.run import run_scenario

__all__ = ["RunOutcome", "Stopped", "run_scenario"]
