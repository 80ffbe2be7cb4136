"""Configuration: its schema, its plugins by name, its files and its mistakes."""
