"""Velocity images: edges along scan lines, their conics, and which circle each one is."""
