"""Universal files (SDRC, "UFF"): an index of their data sets first, functions on demand."""
