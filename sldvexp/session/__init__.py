"""A measuring session: scan lines through an instrument, kept one by one, and what they show."""
