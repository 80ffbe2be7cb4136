"""Circles that do not fit the object: what is wrong is named, sized, and in the bounds or void."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from sldvexp.dataset import Severity, views_without_pose
from sldvexp.errors import UserError
from sldvexp.pose import misfit
from sldvexp.pose.bitangent import Bitangent
from sldvexp.pose.edge import Edge
from sldvexp.pose.misfit import TOO_SMALL
from sldvexp.virtual_lab.scene import MirrorError, MirrorErrors

METHODS = [Edge(), Bitangent()]
#: Stated errors as those of a real scan, with little pointing noise.
SCANNED = {"std": 0.05, "uneven": 70.0, "pointing": 0.1}
INCH, ROUGH = 0.0254, 0.0012


def estimate(lab, method, target=None, seed=1):
    """Poses of a session with its own object and noise."""
    rng = np.random.default_rng(seed)
    lab.machine(rng)
    return method.estimate(lab.laser, target or lab.target, lab.tree(rng))


def calibration(found):
    """The finding on the calibration; there is one."""
    (one,) = [f for f in found.findings if f.kind == "calibration"]
    return one


def farthest(lab, found):
    """Largest distance of an origin from its true place, over its standard error."""
    true = np.array([lab.truth(v)[1] for v in found.views])
    return np.max(np.abs(found.origin - true) / found.pose["origin_std"].values)


def with_circle(target, number, **changes):
    """The target with other numbers for a circle."""
    changed = replace(target.circles[number], **changes)
    return replace(target, circles={**target.circles, number: changed})


@pytest.mark.whole
@pytest.mark.parametrize("method", METHODS, ids=lambda m: m.name)
def test_a_circle_beside_its_place_is_named_and_sized(edge_lab, method):
    lab = edge_lab(views=2, **SCANNED)
    own = lab.target.circles[3]
    told = with_circle(lab.target, 3, x=own.x - 0.001 / INCH, diameter=own.diameter - 0.0005 / INCH)
    wrong = calibration(estimate(lab, method, told))
    assert (wrong.subject, wrong.severity) == ("circle 3", Severity.void)
    assert "circle 3, 1 mm beside its place and 0.5 mm wider than the target tells" in wrong.text
    assert "views a and b" in wrong.text


@pytest.mark.whole
@pytest.mark.parametrize("method", METHODS, ids=lambda m: m.name)
def test_a_wrong_gain_is_named_and_its_remedy_repairs_it(edge_lab, method):
    lab = edge_lab(views=2, mirrors=MirrorErrors(up_down=MirrorError(gain=0.02)), **SCANNED)
    found = estimate(lab, method)
    wrong = calibration(found)
    assert (wrong.subject, wrong.severity) == ("gain_up_down", Severity.void)
    assert "gain_up_down, +2 %, explains that" in wrong.text
    assert wrong.remedy == "pose.shared={gain_up_down:0.1}"
    assert farthest(lab, found) > 20
    repaired = estimate(lab, replace(method, shared={"gain_up_down": 0.1}))
    assert not [f for f in repaired.findings if f.kind == "calibration"]
    assert farthest(lab, repaired) < 4


@pytest.mark.whole
def test_an_object_of_another_size_is_told_with_the_mirror_offset(edge_lab):
    """Scaled poses and a scaled offset fit a scaled object exactly."""
    lab = edge_lab(views=3, nominal=0.03, **SCANNED)
    lab.laser = replace(lab.laser, mirror_offset=0.015)
    wrong = calibration(estimate(lab, Edge()))
    assert "mirror_offset" in wrong.subject.split(" or ")
    size = re.search(r"or an object that is (\d+) % smaller", wrong.text)
    assert float(size[1]) == pytest.approx(50, abs=3)


@pytest.mark.whole
def test_a_misfit_that_nothing_explains_multiplies_the_bounds(edge_lab, make_circles, monkeypatch):
    """All circles are worse than the target tells."""
    lab, told = edge_lab(views=2, target=make_circles(ROUGH), **SCANNED), make_circles(ROUGH / 6)
    found = estimate(lab, Edge(), told, seed=5)
    wrong = calibration(found)
    assert (wrong.subject, wrong.severity) == ("views a and b", Severity.doubtful)
    assert 1 < wrong.statistic < TOO_SMALL**2
    monkeypatch.setattr(misfit, "FALSE_ALARM", 0.0)
    without = estimate(lab, Edge(), told, seed=5)
    assert not [f for f in without.findings if f.kind == "calibration"]
    for name in ("covariance", "joint_covariance"):
        larger = wrong.statistic * without.pose[name].values
        np.testing.assert_allclose(found.pose[name].values, larger, rtol=1e-9)


@pytest.mark.whole
@pytest.mark.parametrize("method", METHODS, ids=lambda m: m.name)
def test_bounds_with_their_cause_in_them_hold_the_true_poses(edge_lab, method, monkeypatch):
    """As wide as the text of a void pose says that they would be."""
    monkeypatch.setattr(misfit, "TOO_SMALL", np.inf)
    lab = edge_lab(views=2, mirrors=MirrorErrors(up_down=MirrorError(gain=0.005)), **SCANNED)
    each = [estimate(lab, method, seed=s) for s in range(3)]
    assert {calibration(f).severity for f in each} == {Severity.doubtful}
    assert max(farthest(lab, f) for f in each) < 4
    assert all("gain_up_down" in calibration(f).subject for f in each)


def test_conics_in_dac_steps_are_told_from_wrong_circles(edge_lab):
    found = estimate(edge_lab(std=0.002), Bitangent(pinhole=False))
    wrong = calibration(found)
    assert (wrong.subject, wrong.severity) == ("view a", Severity.void)
    assert wrong.remedy == "pose.pinhole=true"


@pytest.mark.whole
@pytest.mark.parametrize("method", METHODS, ids=lambda m: m.name)
def test_a_view_that_fails_does_not_end_the_others(edge_lab, method):
    lab, rng = edge_lab(views=3, **SCANNED), np.random.default_rng(2)
    tree = lab.tree(rng)
    good = {k: g for k, g in tree.items() if k != "edge/b"}
    tree["edge/b"] = tree["edge/b"].isel(edge=slice(0, 132))
    found, without = (method.estimate(lab.laser, lab.target, t) for t in (tree, good))
    assert found.views == ["a", "c"]
    assert views_without_pose({"pose": found.pose}) == ["b"]
    (lost,) = [f for f in found.findings if f.kind == "no_pose"]
    assert (lost.subject, lost.severity) == ("view b", Severity.void)
    assert lost.text.startswith("view b has no pose, and its images are left out: view b: ")
    np.testing.assert_array_equal(found.origin, without.origin)
    with pytest.raises(UserError, match=r"^view b: "):
        method.estimate(lab.laser, lab.target, {"edge/b": tree["edge/b"]})


def test_a_mirror_offset_of_nothing_does_not_tell_the_size_of_the_object(edge_lab):
    """A part of nothing is nothing; a small gain looks like an offset as well."""
    mirrors = MirrorErrors(up_down=MirrorError(gain=0.002))
    lab = edge_lab(views=2, nominal=0.0, mirrors=mirrors, **SCANNED)
    wrong = calibration(estimate(lab, Edge()))
    assert "mirror_offset, " in wrong.text
    assert "an object that is" not in wrong.text
