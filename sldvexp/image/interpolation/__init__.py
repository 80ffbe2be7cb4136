"""Values between the pixels of a velocity image: linear in the pixels, hence sparse weights."""
