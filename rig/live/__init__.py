"""The live view: measured over predicted while the rig runs."""
