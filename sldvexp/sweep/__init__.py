"""Many runs of one command: planned, done once each, collected into one dataset.

`Sweep` is a call of the command with ``-m``; `Store` shares the steps that runs have in common.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
