"""Effects: what they are, how they are applied; those of sensors and clocks. Each rig has its own besides."""
