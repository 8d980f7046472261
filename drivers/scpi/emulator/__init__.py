"""A 33220A that is not there, for VISA to talk to on TCP and on a pty."""
