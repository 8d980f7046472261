"""What predicts a rig's channels from recordings alone, without its physics."""
