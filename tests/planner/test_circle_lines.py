"""Planned stands get scan lines that reach across their circles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sldvexp.geometry import KnownPose
from sldvexp.planner.circle_lines import fit_stride, too_short
from sldvexp.planner.images import half_chords_of, known_stand
from sldvexp.planner.place import Place
from sldvexp.scan.calibration import Centres
from tests.composing import experiment
from tests.planner.planned_experiments import SMALL

VIEWS = {
    "near": KnownPose(origin=[0.3, 0.1, 0.6], look_at=[0.3, 0.1, 0.0]),
    "far": KnownPose(origin=[0.3, 0.1, 1.9], look_at=[0.3, 0.1, 0.0]),
}


def two_stands(stride, rough):
    """Two stands, one of them near, on a 16-bit board; their place, and a scan with that stride."""
    e = experiment("experiment=plate", *SMALL, "laser.board=bits_16")
    e.scan.calibration.coarse.stride = stride
    parts = {
        name: replace(getattr(e.scan, name), views={}) for name in ("calibration", "structure")
    }
    scan = replace(e.scan, poses=VIEWS if rough else {}, **parts)
    place = Place.from_experiment(e)
    stands = [
        known_stand(name, p.place, np.array(p.look_at), p.rotation, place)
        for name, p in VIEWS.items()
    ]
    return stands, place, scan


@pytest.mark.one_in(3)
@pytest.mark.parametrize(("stride", "rough"), [(4, True), (4, False), (2, True)])
def test_lines_that_do_not_reach_an_edge_are_told_with_what_is_needed(stride, rough):
    stands, place, scan = two_stands(stride, rough)
    said = list(too_short(stands, place, scan))
    assert len(said) == (2 if stride == 2 else 1)
    assert said[0].startswith(f"stand near: scan lines of {150 * stride} steps to each side")
    needed = int(said[0].partition("coarse.stride=")[2].partition(",")[0])
    widest = half_chords_of(stands[0], place, 3).max()
    assert needed == np.ceil(1.5 * widest / 150)
    assert not list(too_short(*two_stands(needed, rough)))


@pytest.mark.whole
def test_rough_poses_without_a_stride_need_none():
    assert not list(too_short(*two_stands(None, True)))


def test_marks_with_numbers_need_no_stride():
    stands, place, scan = two_stands(None, False)
    assert list(too_short(stands, place, scan))
    marks = Centres([[0, 0], [0, 9], [9, 0], [9, 9]], circles=[1, 2, 3, 4])
    calibration = replace(scan.calibration, views={"near": marks})
    structure = replace(scan.structure, views={})
    marked = replace(scan, calibration=calibration, structure=structure)
    assert not any(told.startswith("stand near") for told in too_short(stands, place, marked))


@pytest.mark.one_in(4)
@pytest.mark.parametrize(
    ("views", "stride", "expected"),
    [
        ({}, 2, "none"),  # with rough poses: the scan chooses it
        ({"near": {}}, 2, "more"),
        ({"near": {}}, 40, "same"),
        ({}, None, "same"),
    ],
)
def test_a_plan_sets_a_stride_only_where_the_given_one_is_too_small(views, stride, expected):
    stands, place, _ = two_stands(None, True)
    coarse = {"lines": 3, "pixels": 300, "window": 25, "stride": stride}
    calibration = {"coarse": coarse, "views": views}
    fit_stride(calibration, stands, place)
    if expected == "more":
        assert coarse["stride"] > stride
    else:
        assert coarse["stride"] == (None if expected == "none" else stride)


def test_circles_that_the_mirrors_do_not_reach_have_no_lines():
    """All of their outline lies at the ends of the mirrors then, which is no ellipse."""
    _, place, _ = two_stands(None, True)
    away = KnownPose(origin=[0.3, 0.1, 1.0], look_at=[3.0, 0.1, 0.9])
    stand = known_stand("away", away.place, np.array(away.look_at), away.rotation, place)
    np.testing.assert_array_equal(half_chords_of(stand, place, 3), 0.0)
