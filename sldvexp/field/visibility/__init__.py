"""Visibility of a volume's samples: poses and images, projection, occlusion, coverage."""
