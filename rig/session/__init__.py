"""One run on the rig: from connecting to the safe state, and everything that is recorded on the way."""
