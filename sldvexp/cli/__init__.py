"""Commands of the terminal: what they take, do and print."""
