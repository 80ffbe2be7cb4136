"""Bounds of nodal values: noise, poses, and elements that cannot follow the field."""
