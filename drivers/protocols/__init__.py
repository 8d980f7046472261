"""What the rig asks of its instruments, one file an instrument, and what emulators ask of their plant."""
