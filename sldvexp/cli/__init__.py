"""Commands of the terminal: what they take, do and print.

`main` reads the arguments and composes. Every command (`sldvexp list`, `sldvexp plot`) is a module
of its name with a function `run`; a new one is such a module, a name in `commands` and a line in
the page of `help`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
