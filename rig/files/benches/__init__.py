"""The benches of runs without `--bench`, one file a rig: every instrument, emulated."""
