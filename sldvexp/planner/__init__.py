"""Planner: places for the instrument from which bounds are small, before anything is measured.

`plan` finds stands for an experiment, `next_stand` the one that helps most after those that are
there, `check_stands` says what given stands see and why not the rest. `criterion` has the closed
form, `place` the object and its room, `search` the way to good stands, `expected` the bounds that
the estimator will report.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
