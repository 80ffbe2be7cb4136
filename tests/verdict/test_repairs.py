"""Repairs are proposed, done only where they are named, and undo the mistake; poses are refined."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.dataset import Severity, verdict_of
from sldvexp.errors import UserError
from sldvexp.geometry import vector_from_rotation
from sldvexp.verdict import examine_views
from sldvexp.verdict.beams import PixelBeams

from .simulated_views import LASER, LOOSE, TIGHT, groups, poses, session, surface


def examined(made, **options):
    return examine_views(groups(made.views), LASER, surface(), **options)


@pytest.mark.whole
@pytest.mark.parametrize("mistake", ["sign", "conjugate", "rms"])
def test_repair_undoes_the_mistake(mistake):
    spoiled = session(np.random.default_rng(1), mistakes={2: mistake})
    clean = session(np.random.default_rng(1))
    found = examined(spoiled)
    assert verdict_of(found.findings) == "void"
    assert found.findings[0].remedy == f"use_repair=[view_v3.{mistake}]"
    assert "image/v3" not in found.groups, "nothing is repaired in silence"
    repaired = examined(spoiled, use_repair=[f"view_v3.{mistake}"])
    assert verdict_of(repaired.findings) == "trusted"
    assert repaired.groups["image/v3"].attrs["repaired"] == f"view_v3.{mistake}"
    good = clean.views[2].usable
    left = repaired.groups["image/v3"]["velocity"].values[good] - clean.views[2].velocity[good]
    assert np.abs(left).max() < 2e-3, "but for noise, the image without the mistake"


@pytest.mark.whole
def test_two_wrong_views_are_void_and_said_to_be_more_than_one():
    made = session(np.random.default_rng(4), views=6, mistakes={1: "sign", 4: "sign"})
    found = examined(made).findings
    assert verdict_of(found) == "void"
    assert "more than one view is wrong" in found[0].text


@pytest.mark.whole
def test_view_of_another_field_is_left_out_if_asked():
    made = session(np.random.default_rng(5), mistakes={3: "other"})
    found = examined(made, use_repair=["view_v4.left_out"])
    assert verdict_of(found.findings) == "trusted"
    assert found.groups["image/v4"].attrs["left_out"] == 1


def test_repair_that_nothing_proposes_is_refused():
    with pytest.raises(UserError, match=r"proposes view_v1.sign"):
        examined(session(np.random.default_rng(6), pixels=17), use_repair=["view_v1.sign"])


def rotation_error(pose, made, view):
    """Error of a view's rotation: a rotation vector in the laser frame, rad."""
    stated, _ = poses(len(made.views))[view]
    off = made.turned[view]
    found = pose["rotation"].values[view]
    return vector_from_rotation(found @ (off @ stated).T)


@pytest.mark.whole
@pytest.mark.parametrize("seed", [0, 1])
def test_turned_view_with_a_known_origin_is_turned_back(seed):
    """Across the beam; the roll about it hardly moves where beams hit."""
    made = session(np.random.default_rng(seed), std=TIGHT, mistakes={2: "turned"}, size=2.5e-3)
    found = examined(made, use_repair=["view_v3.pose"])
    assert verdict_of(found.findings) == "trusted"
    error = rotation_error(found.groups["pose"], made, 2)
    bound = 4 * np.sqrt(np.diag(found.groups["pose"]["covariance"].values[2]))[:3]
    assert np.all(np.abs(error) < bound)
    assert np.abs(error[:2]).max() < 5e-4


def hits_off(pose, made):
    """Distance by which beams hit beside where they are said to, r.m.s. over views, m."""
    squares = []
    for k, view in enumerate(made.views):
        beams = PixelBeams.trace(view, made.surface, np.flatnonzero(view.usable)[::7])
        error = rotation_error(pose, made, k)
        origin = pose["origin"].values[k] - view.origin - made.truth[k, 3:]
        moves = beams.point_by_pose @ np.r_[error, origin]
        squares.append(np.mean(np.sum(moves**2, axis=1)))
    return float(np.sqrt(np.mean(squares)))


@pytest.mark.whole
def test_refined_poses_hit_nearer_to_the_truth_and_say_how_well():
    before, after, stated = [], [], []
    for seed in range(4):
        made = session(np.random.default_rng(seed), std=LOOSE)
        found = examined(made, refined=True)
        (told,) = [f for f in found.findings if f.kind == "poses_refined"]
        before.append(hits_off(groups(made.views)["pose"], made))
        after.append(hits_off(found.groups["pose"], made))
        stated.append(told.size)
    assert np.mean(np.square(after)) < np.mean(np.square(before))
    # Sixty places, but a handful of independent numbers a session.
    ratio = np.sqrt(np.mean(np.square(after)) / np.mean(np.square(stated)))
    assert 0.6 < ratio < 1.5


@pytest.mark.whole
def test_poses_are_not_refined_where_views_disagree():
    made = session(np.random.default_rng(2), mistakes={1: "gain"}, size=0.03)
    found = examined(made, refined=True)
    assert "pose" not in found.groups
    (told,) = [f for f in found.findings if f.kind == "poses_not_refined"]
    assert told.severity is Severity.doubtful
