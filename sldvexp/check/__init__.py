"""Examination of a run after its estimates: conventions, published numbers, tests of equality.

One check a module, chosen as ``check.<name>.plugin=...``; `base` has the contract that each keeps
and says how to add one. `evaluate` compares a run with what its configuration expects; `lookup`
finds the numbers that an expression such as ``pose/origin[axis=x]`` stands for.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
