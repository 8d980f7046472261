"""The rigs that the twin knows, one folder each."""
