"""Count of a session's pixels, those that search circles among them.

How many pixels a search takes is not known before it ends. Those that it has taken count as they
come, and of views whose circles are still to be searched as many are expected as were taken in
each of the others so far.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from sldvexp.session.watching import LineDone, ViewAhead


class PixelTally:
    """Counts pixels of all views, done and in total, by the kind of their parts.

    Parameters
    ----------
    views : sequence of ViewAhead

    Attributes
    ----------
    done : Counter of str
        Pixels that are scanned, or were in the journal.

    Examples
    --------
    >>> from sldvexp.session import PartAhead
    >>> part = PartAhead("circles", lines=4, pixels=100, kept=0, seconds=2.0, searches=True)
    >>> tally = PixelTally([ViewAhead(name, k, 2, (part,)) for k, name in enumerate("ab", 1)])
    >>> tally.total
    Counter({'circles': 200})
    """

    def __init__(self, views: Sequence[ViewAhead]) -> None:
        self._views = views
        self.done: Counter[str] = Counter({p.kind: 0 for v in views for p in v.parts if p.pixels})
        self._searched: Counter[str] = Counter()  # by the views' names
        self._ended: set[str] = set()  # views whose circles are all found
        self._share = 0.0

    def line_done(self, line: LineDone) -> None:
        """Note a line."""
        if line.again:
            return
        pixels = len(line.dac)
        self.done[line.kind] += pixels
        if line.searches:
            self._searched[line.view] += pixels
        else:
            self._ended.add(line.view)

    def view_done(self, view: ViewAhead) -> None:
        """Note that the rest of a view will not come, if it was skipped."""
        self._ended.add(view.name)
        until = self._views[: view.number]
        for kind, pixels in self._planned(until).items():
            self.done[kind] = pixels

    @property
    def total(self) -> Counter[str]:
        """Pixels by kind: known beforehand, taken by searches, and expected of those to come."""
        return self._planned(self._views)

    @property
    def share(self) -> float:
        """Share of all pixels that are done, from 0 to 1; it never falls."""
        total = self.total.total()
        now = self.done.total() / total if total else 0.0
        self._share = max(self._share, now)
        return self._share

    def _planned(self, views: Sequence[ViewAhead]) -> Counter[str]:
        """Count the pixels of some views."""
        known = [self._searched[name] for name in self._ended if self._searched[name]]
        expected = round(sum(known) / len(known)) if known else 0
        found: Counter[str] = Counter()
        for view in views:
            for part in view.parts:
                found[part.kind] += part.pixels
                if part.searches:
                    so_far, over = self._searched[view.name], view.name in self._ended
                    found[part.kind] += so_far if over else max(so_far, expected)
        return found
