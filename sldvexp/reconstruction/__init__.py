"""The velocity vector from line-of-sight velocities: one strategy a file, one shared estimator."""
