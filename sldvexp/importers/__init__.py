"""Plugins that make datasets of files from other instruments and programs."""
