"""The blind check: campaigns by programs that share nothing with the twin, diagnosed, then revealed."""
