"""Means of tests to make an instrument fail."""
