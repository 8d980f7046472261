"""What the view adds for a rig with a crank: the mechanism, orders, impacts over crank angle, speed."""
