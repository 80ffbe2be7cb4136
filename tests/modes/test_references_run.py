"""Two scans of the virtual lab with the exciter at two places, and their modes together."""

from __future__ import annotations

import numpy as np
import pytest

FREQUENCY = 545.0
SCAN = [
    *("experiment=plate_broadband", "report=none", "~check.truth", "~expect.truth"),
    *("~expect.spoilt", "scan.pixels=[9,10]", "scan.sampling.band=[400.0,700.0]"),
    *("scene.vibrometer.drop_out=0", "scan.sampling.records=4"),
    f"scene.plate.modes.bending_2_1.frequency={FREQUENCY}",
]
#: What each place drives the modes (2, 1) and (1, 2) of the plate with, m/s per V.
DRIVEN = {"corner": (0.020, -0.015), "edge": (0.008, 0.015)}


@pytest.mark.whole
def test_scans_with_the_exciter_at_two_places_tell_two_modes_of_one_frequency(sldvexp):
    runs = []
    for seed, (first, second) in enumerate(DRIVEN.values()):
        done = sldvexp(
            *SCAN,
            f"seed={seed}",
            f"scene.plate.modes.bending_2_1.velocity={first}",
            f"scene.plate.modes.bending_1_2.velocity={second}",
        )
        assert done.status == 0, done.err
        runs.append(done.folder)
    images = ["~experiment", "instrument=images", f"instrument.path={runs[0]}", "modal=own"]
    once = sldvexp(*images)
    assert once.status == 0, once.err
    assert once.tree["modes"].sizes["mode"] == 1
    both = sldvexp(*images, f"instrument.further={{edge: {runs[1]}}}")
    assert both.status == 0, both.err
    found = both.tree["modes"]
    assert found["exciter"].values.tolist() == ["first", "edge"]
    error = found["natural_frequency"].values - FREQUENCY
    assert np.abs(error / found["natural_frequency_std"].values).max() < 3
    assert found["natural_frequency"].values == pytest.approx([FREQUENCY] * 2, rel=1e-4)
    # Both true shapes lie in the plane of what the two places excite.
    seen = both.tree["modes/image/1"]["velocity"].values
    shares = np.array([DRIVEN["corner"], DRIVEN["edge"]])
    own = seen @ np.linalg.inv(shares).T  # the modes by themselves
    assert np.abs(np.vdot(*own.T)) < 0.1 * np.linalg.norm(own[:, 0]) * np.linalg.norm(own[:, 1])
    refused = sldvexp(*images, f"instrument.further={{edge: {runs[0]}}}")
    assert refused.status == 1
    assert "reference edge has the numbers of reference first" in refused.err
    missing = sldvexp(*images, "instrument.further={edge: nowhere}")
    assert missing.status == 1
    assert missing.err.count("\n") == 1
