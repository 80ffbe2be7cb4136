"""Statistics that several rooms share: quantiles of bounds and tests of hypotheses."""
