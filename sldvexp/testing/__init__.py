"""What tests need to make an instrument fail."""
