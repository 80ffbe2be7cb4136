"""What each view sees of the volume's samples."""
