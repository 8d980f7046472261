"""The commands of `rattle`, one file each."""
