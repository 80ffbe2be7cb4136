"""Ways to go through more velocities than fit into memory."""
