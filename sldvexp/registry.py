"""Old place of `register`, from which packages of others import it."""

from sldvexp.config.registry import register

__all__ = ["register"]
