"""What a rig with a crank says of its channels, and what is found by the crank's angle."""
