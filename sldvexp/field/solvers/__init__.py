"""Ways to solve a field's normal equations."""
