"""How large a page is: what is sent by mail, and opened on a phone."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp import dataset
from sldvexp.report.html import run_page

MOST, MOST_OF_MANY = 1.5e6, 3e6


@pytest.mark.whole
def test_page_of_the_default_run_is_small_with_one_frequency_and_with_256(sldvexp, pages):
    done = sldvexp()
    assert done.status == 0, done.err
    page = done.folder / "report.html"
    assert 0.5e6 < page.stat().st_size <= MOST

    tree = done.tree
    around, poses, few = (tree[name].to_dataset() for name in ("volume", "pose", "field"))
    hertz = np.linspace(50.0, 690.0, 256)
    rng = np.random.default_rng(3)
    share = 1 / (1 + ((hertz - 197) / 20) ** 2) + 0.3 / (1 + ((hertz - 520) / 20) ** 2)
    many = few.isel(frequency=[0] * len(hertz)).assign_coords(frequency=hertz)
    noise = rng.normal(size=(2, *many["velocity"].shape)) * many["velocity_std"].values
    many["velocity"] = many["velocity"] * share + (noise[0] + 1j * noise[1])
    path = done.folder / "many.nc"
    dataset.save({"volume": around, "pose": poses, "field": many}, tree.attrs, path)
    size = run_page.write(path, done.folder / "many.html").stat().st_size
    assert 1e6 < size <= MOST_OF_MANY
