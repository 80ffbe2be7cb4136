"""Formats of files, which know no configuration and no plugin."""
