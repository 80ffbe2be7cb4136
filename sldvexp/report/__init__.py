"""Text and pages that a person reads at the end of a run.

`closing_table` is what a run prints, of the tables and lines that `tables` makes; `html` makes one
page that any browser opens offline. A `Report` is a plugin: another kind is a module that registers
one, and its line in `sldvexp.config.experiment`. Units in headings are those that
`sldvexp.dataset.VARIABLES` shows.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
