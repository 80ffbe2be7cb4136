"""Reports as one file that any browser opens offline.

`run_page` and `sweep_page` list the sections of a page; `diagnostics`, `setup` and `results` make
those of a run from its dataset, of the pieces in `blocks`. Another section is a function that takes
a `RunData`, and its line in `run_page.SECTIONS`; `render` fills the template and escapes all that
comes from a run.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
