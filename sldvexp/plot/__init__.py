"""Figures of a run: functions that take its dataset and return a matplotlib figure.

>>> import sldvexp.plot
>>> sldvexp.plot.field("outputs/2026-11-22/10-00-00/run.nc")  # doctest: +SKIP

Each takes as ``source`` an opened run.nc, its path, or the groups of a run by their path; the
figure belongs to no window. What is missing for a figure is said in one sentence (`UserError`).
`figures_of` tells which figures a run can show, `save` writes one as PNG and SVG.

A module holds the figures of one stage; they are drawn in one style (`style`), of what `selection`
chooses. Another figure is a function, and its line in `catalogue.FIGURES`. Matplotlib is loaded
when a figure is asked for, not with this package.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
