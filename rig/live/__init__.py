"""The live view: measured over predicted while the rig runs, and the same picture of a finished log."""
