"""Pure geometry: rotations and rigid motions, circles and bitangents, cross-ratios."""
