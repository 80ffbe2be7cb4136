"""Plugins as the command installs them, for tests that compose without it."""

from __future__ import annotations

from sldvexp.config import hydra_plugin

hydra_plugin.install()
