"""What there is to choose from: `sldvexp list` and `sldvexp show`."""
