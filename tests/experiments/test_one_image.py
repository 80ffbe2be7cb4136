"""Strain of the plate from every one of the five registered images of bare sldvexp, alone (6.2)."""

from __future__ import annotations

import numpy as np
import pytest


@pytest.mark.long
@pytest.mark.parametrize("view", "12345")
def test_one_registered_image_tells_the_strain_of_the_resonance(sldvexp, view):
    scans = ("calibration", "structure")
    others = [f"~scan.{scan}.views.{v}" for scan in scans for v in "12345" if v != view]
    done = sldvexp("experiment=plate_strain", *others, "report=none")
    assert done.status == 2, done.err  # five views are expected to tell more
    tree = done.tree
    strain = tree["strain"].to_dataset()["strain"].values[..., 0].imag
    true = tree["truth"].to_dataset()["strain"].values[..., 0].imag
    error = np.linalg.norm(strain - true, axis=0) / np.linalg.norm(true, axis=0)
    print(view, error.round(4))
    assert np.all(error <= 0.03)
    assert "one view sees the face" in tree["field"].attrs["notes"]
