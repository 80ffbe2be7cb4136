"""Where the instrument stood: its pose from points, by one strategy a file."""
