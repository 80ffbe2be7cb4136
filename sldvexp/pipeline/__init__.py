"""One run: its steps in their order, and where its numbers come from."""
