"""Velocity images of the views."""

from __future__ import annotations

import numpy as np

from sldvexp.report.field_tables import MOST_FREQUENCIES
from sldvexp.report.html.blocks import HtmlTable, Section, having
from sldvexp.report.html.figures import figures
from sldvexp.report.html.page_data import Subject
from sldvexp.report.numbers import number


def section(run: Subject) -> Section | None:
    """How large, how certain and how complete the images are, and the images themselves."""
    images = run.below("image")
    pictures = list(figures(run, "image"))
    if not images and not pictures:
        return None
    rows = []
    for view, image in images.items():
        good = image["flags"].values == 0  # read whole: to pick pixels out of the file takes longer
        size, std = (
            np.abs(image[name].transpose("pixel", ...).values[good]).reshape(good.sum(), -1)
            for name in ("velocity", "velocity_std")
        )
        hertz = (
            np.atleast_1d(image["frequency"].values) if "frequency" in image.coords else [np.nan]
        )
        grid = " × ".join(map(str, np.atleast_1d(image.attrs.get("shape", []))))
        largest = size.max(axis=0, initial=0.0)
        for i in np.sort(np.argsort(-largest, kind="stable")[:MOST_FREQUENCIES]):
            row = [view, grid or str(image.sizes["pixel"]), number(hertz[i], 6)]
            row += [number(1e3 * largest[i], 3), number(1e3 * _median(std[:, i]), 2)]
            rows.append([*row, str(image.attrs.get("summary", ""))])
    columns = ["view", "pixels", "Hz", "largest, mm/s", "median std, mm/s", "pixels of use"]
    table = HtmlTable(columns, rows, wide=(5,)) if rows else None
    return Section("Velocity images", having(table, pictures))


def _median(values: np.ndarray) -> float:
    return float(np.median(values)) if values.size else np.nan
