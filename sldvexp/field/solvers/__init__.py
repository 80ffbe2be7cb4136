"""Solvers of a field's normal equations, one strategy a file."""
