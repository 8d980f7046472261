"""An FR-D700 that is not there: its behaviour, the disturbances of its line, a server that speaks for it."""
