"""The velocity field over a volume: what each view sees of it, and the solution of all of it."""
