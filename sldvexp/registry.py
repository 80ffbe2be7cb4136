"""The old place of `register`, which packages of others import from here."""

from sldvexp.config.registry import register

__all__ = ["register"]
