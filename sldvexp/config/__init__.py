"""Configuration: its schema, its plugins by name, its files and its mistakes."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
