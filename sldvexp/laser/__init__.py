"""The instrument as a projective camera: two offset mirrors, their boards and calibration."""
