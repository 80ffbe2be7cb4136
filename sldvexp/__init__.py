"""3-D vibration velocity fields, with bounds, from one scanning laser Doppler vibrometer."""
