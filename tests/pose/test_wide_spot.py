"""A spot that is too wide for a circle is told, with the circle, the view and what would do."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.dataset import Severity
from sldvexp.pose.bitangent import Bitangent
from sldvexp.pose.edge import Edge

SCANNED = {"std": 0.05, "uneven": 70.0, "pointing": 0.1}


@pytest.mark.whole
@pytest.mark.parametrize("method", [Edge(), Bitangent()], ids=lambda m: m.name)
def test_a_spot_too_wide_for_its_circle_is_told_and_in_the_bounds(edge_lab, method):
    lab = edge_lab(views=2, **SCANNED)
    tree = lab.tree(np.random.default_rng(1))
    right = method.estimate(lab.laser, lab.target, tree)
    assert not [f for f in right.findings if f.kind == "wide_spot"]
    group = tree["edge/a"]
    one = group["circle"].values == 1
    size = np.ptp(group["dac"].values[one], axis=0).min() / 2
    group["width"].values[one] = 0.45 * size
    wide = method.estimate(lab.laser, lab.target, tree)
    (found,) = [f for f in wide.findings if f.kind == "wide_spot"]
    assert (found.severity, found.views) == (Severity.doubtful, ("a",))
    assert "a larger circle, a beam focused nearer to it" in found.text
    assert np.all(wide.pose["origin_std"].values[0] >= right.pose["origin_std"].values[0])
