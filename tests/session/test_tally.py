"""Pixels of a session are counted with those that search circles, which nobody knows beforehand."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.session import LineDone, PartAhead, ViewAhead
from sldvexp.session.tally import PixelTally

CIRCLES = PartAhead("circles", 10, 1000, 0, 20.0, searches=True)
IMAGE = PartAhead("image", 20, 2000, 0, 40.0)
VIEWS = [ViewAhead(name, k, 3, (CIRCLES, IMAGE)) for k, name in enumerate("abc", 1)]


def line(view, lines, pixels, kind="circles", again=False):
    dac = np.zeros((pixels, 2), np.int64)
    return LineDone(view, kind, lines, 1, 1, dac, None, False, again, None, None)


def test_search_counts_as_it_comes_and_is_expected_of_the_views_to_come():
    tally = PixelTally(VIEWS)
    assert tally.total.total() == 9000
    tally.line_done(line("a", "search_001", 100))
    tally.line_done(line("a", "search_002", 200))
    assert (tally.done.total(), tally.total.total()) == (300, 9300)  # not over yet
    tally.line_done(line("a", "1_coarse", 50))
    assert (tally.done["circles"], tally.total.total()) == (350, 9000 + 3 * 300)
    tally.line_done(line("b", "search_001", 400))
    assert tally.total.total() == 9000 + 300 + 400 + 300  # more than expected
    tally.line_done(line("b", "1_coarse", 50))
    assert tally.total.total() == 9000 + 300 + 400 + 350


def test_everything_is_done_in_the_end_also_if_a_view_is_skipped():
    tally = PixelTally(VIEWS)
    for view in VIEWS:
        tally.line_done(line(view.name, "search_001", 170))
        tally.line_done(line(view.name, "1_coarse", 1000))
        if view.name != "b":
            tally.line_done(line(view.name, "image", 2000, "image"))
        tally.view_done(view)
    assert tally.done == tally.total
    assert tally.share == 1


def test_share_never_falls_and_lines_again_do_not_count():
    tally = PixelTally(VIEWS)
    tally.line_done(line("a", "search_001", 3000))
    before = tally.share
    tally.line_done(line("a", "1_coarse", 10))  # now as many are expected of the others
    assert tally.share == before
    tally.line_done(line("a", "1_coarse", 10, again=True))
    assert tally.done.total() == 3010
    assert before == pytest.approx(3000 / 12000)
