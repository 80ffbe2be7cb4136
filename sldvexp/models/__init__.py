"""Finite element models put to the test: mapped on pixels, compared, corrected, expanded.

`FiniteElementModel` holds nodes, surface elements and shapes; `map_shapes` tells what the pixels of
a view would see of them; the tests say whether that is what was measured, and what they could not
tell. A new source of models is a file with one dataclass that extends `ModelSource` and is
registered under ``model``.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
