"""The volume: a family of surfaces around the real one, and where in it velocities are sampled."""
