"""Contact: normal force laws, sliding friction, and the stiffness of a pair of surfaces."""
