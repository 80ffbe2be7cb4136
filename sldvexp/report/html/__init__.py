"""Reports as one file that any browser opens offline: a section a module, each with one hook."""
