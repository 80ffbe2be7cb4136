"""Modes of a structure: natural frequencies, damping and shapes, from lines of all pixels at once.

`estimate_modes` finds them in the images of a run, for `modal=own`. `Responses` are the lines of
all views, `compress` keeps what stands out of their noise, `ModalProjection` makes modal images:
velocity images with a mode in the place of each line, which every reconstruction takes.

A new method is a file with one dataclass that extends `ModalMethod` and is registered under
``modal``.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
