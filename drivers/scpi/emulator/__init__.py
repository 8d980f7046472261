"""Sources that are not there, for VISA to talk to on TCP and on a pty: a 33220A, an N6954A."""
