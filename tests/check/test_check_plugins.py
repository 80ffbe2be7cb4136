"""Checks on runs that they accept, and on runs where they must complain."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.check import Examination
from sldvexp.check.cross_ratio import CrossRatio
from sldvexp.check.pose_equivalence import PoseEquivalence
from sldvexp.check.pose_repeats import PoseRepeats
from sldvexp.errors import ConfigError, UserError
from sldvexp.geometry import KnownPose
from sldvexp.pose import Given, Registration


def rng():
    return np.random.default_rng(0)


def test_simulated_repeats_confirm_the_bounds_and_expose_false_ones():
    from sldvexp.laser import TwoMirror

    tree = Registration(path="conf://data/figure_4_28.reg").estimate(TwoMirror(), None, {}).groups()
    found = PoseRepeats(repeats=400).examine(Examination(tree, rng=rng()))
    # Four standard errors of a standard deviation, and of a share of 0.95, from 400 repeats.
    np.testing.assert_allclose(found["std_ratio"], 1, atol=4 / np.sqrt(800))
    np.testing.assert_allclose(found["coverage"], 0.95, atol=4 * np.sqrt(0.95 * 0.05 / 400))
    assert found.attrs["notes"] == ""
    tree["pose"]["covariance"] = tree["pose"]["covariance"] / 4
    found = PoseRepeats(repeats=400).examine(Examination(tree, rng=rng()))
    assert "they are not to be trusted" in found.attrs["notes"]


def test_poses_that_differ_are_rejected():
    def pose(x):
        known = KnownPose([0.1, 0.2, 0.3], [x, 0, 1], [0.01] * 3, [0.01] * 3, samples=16)
        return {"front": known}

    tree = {"pose": Given(views=pose(0.0)).read().pose}
    same = PoseEquivalence(views=pose(0.005)).examine(Examination(tree, rng=rng()))
    other = PoseEquivalence(views=pose(0.05)).examine(Examination(tree, rng=rng()))
    assert not same["reject"].any()
    assert other["reject"].sel(quantity="x").all()
    assert not other["reject"].drop_sel(quantity="x").any()


def test_checks_say_what_they_need():
    for check in (PoseRepeats(), PoseEquivalence(views={"a": KnownPose([0.0] * 3, [0.0] * 3)})):
        with pytest.raises(UserError, match="needs a pose"):
            check.examine(Examination({}, rng=rng()))
    with pytest.raises(ConfigError, match="4 x 3 numbers"):
        CrossRatio(up_down_points=[[1, 2]], left_right_points=None)


@pytest.mark.one_in(2)
@pytest.mark.parametrize("std", [float("inf"), 0.002])
def test_repeats_confirm_the_bounds_of_adjusted_intrinsics(std):
    from sldvexp.laser import TwoMirror

    path, adjust = "conf://data/figure_4_28.reg", {"mirror_offset": std}
    tree = Registration(path=path, adjust=adjust).estimate(TwoMirror(), None, {}).groups()
    found = PoseRepeats(repeats=400).examine(Examination(tree, rng=rng()))
    np.testing.assert_allclose(found["std_ratio"], 1, atol=4 / np.sqrt(800))
    np.testing.assert_allclose(found["coverage"], 0.95, atol=4 * np.sqrt(0.95 * 0.05 / 400))
