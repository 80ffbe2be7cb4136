"""Figures of a page, against the same figures on axes of matplotlib.

The ratio is asserted with ``SLDVEXP_BENCHMARK=1``; otherwise only that both say the same.
"""

from __future__ import annotations

import html
import os
import re
import time

import matplotlib
import numpy as np
from matplotlib.axes import Axes

from sldvexp.plot import style
from sldvexp.plot.paper import SETTINGS
from sldvexp.report.html.slim import slim

FULL_SIZE = os.environ.get("SLDVEXP_BENCHMARK") == "1"
#: The shortest of each counts, the one that others disturbed least.
ROUNDS = 7 if FULL_SIZE else 1
ROWS, COLUMNS = (5, 4) if FULL_SIZE else (2, 2)
#: Of the time of matplotlib's own axes, at most.
SHARE = 0.8


@style.styled
def curves():
    """A sheet of panels with curves, numbers and names."""
    made, axes = style.sheet(ROWS, COLUMNS, 0.8, "curves", beside=style.NUMBERS)
    place = np.linspace(0.0, 1.0, 20)
    for k, panel in enumerate(axes.ravel()):
        panel.plot(place, place**k)
        panel.set(xlabel="place, m", ylabel="velocity, m/s")
    return made


def written() -> str:
    settings = {name: SETTINGS[name] for name in ("svg.hashsalt", "svg.fonttype")}
    with matplotlib.rc_context(settings):
        return slim(curves())


def test_figure_against_axes_of_matplotlib(monkeypatch):
    shortest, said = {}, {}
    for name in ("matplotlib", "own") * ROUNDS:
        with monkeypatch.context() as patch:
            if name == "matplotlib":
                patch.setattr(style, "SharedTickAxes", Axes)
            begin = time.process_time()
            said[name] = written()
            shortest[name] = min(shortest.get(name, np.inf), time.process_time() - begin)
    texts, marks = (
        {name: sorted(re.findall(of, html.unescape(svg))) for name, svg in said.items()}
        for of in (r"<text[^>]*>[^<]*", r"<use [^>]*(?= x=)")
    )
    assert texts["own"] == texts["matplotlib"]
    assert len(marks["own"]) == len(marks["matplotlib"])
    share = shortest["own"] / shortest["matplotlib"]
    print(f"own {shortest['own']:.3f} s, matplotlib {shortest['matplotlib']:.3f} s: {share:.2f}")
    if FULL_SIZE:
        assert share < SHARE
