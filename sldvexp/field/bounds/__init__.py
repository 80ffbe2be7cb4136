"""Variances of a field's nodes, and what the poses add to them."""
