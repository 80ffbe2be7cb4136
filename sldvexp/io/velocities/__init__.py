"""Measured line-of-sight velocities with their directions: one checked table, several formats."""
