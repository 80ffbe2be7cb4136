"""Means of tests to make an instrument, or the power, fail."""
