"""Corners in DAC steps that the scan has of given stands: those of another object do not count."""

from __future__ import annotations

import pytest

from sldvexp import planner
from sldvexp.errors import UserError
from sldvexp.geometry import KnownPose
from sldvexp.planner.done import boxes_told
from sldvexp.planner.files import as_pose
from sldvexp.pose.given import Given
from sldvexp.scan.calibration import CalibrationScan, Centres
from sldvexp.scan.rectangle import Rectangle, ScanRegion
from sldvexp.scan.session import Session
from tests.composing import experiment
from tests.planner.planned_experiments import SMALL

#: A plate that is larger than the experiment's, and elsewhere.
OTHER = (*SMALL, "volume.center=[0.55,0.10,0]", "volume.size=[0.46,0.32]", "plan.drop_out=0")


@pytest.mark.whole
def test_stands_that_were_planned_have_the_same_bounds_when_they_are_given():
    """Though the experiment's own views have the same names, and corners of its own plate."""
    planned = planner.plan(experiment("experiment=plate", *OTHER, "plan.stands=4"))
    views = {stand.name: KnownPose(**as_pose(stand)) for stand in planned.stands}
    assert list(views) == ["1", "2", "3", "4"]
    e = experiment("experiment=plate", *OTHER)
    e.pose = Given(views=views)
    given = planner.check_stands(e)
    assert given.undetermined == 0
    assert given.asked == pytest.approx(planned.asked, rel=0.02)
    told = list(boxes_told(given.given, given.place, e))
    assert [line.partition(":")[0] for line in told] == [f"stand {name}" for name in views]
    assert "scan.structure.views.1 gives corners in DAC steps that hold " in told[0]


@pytest.mark.whole
def test_corners_of_the_stand_itself_count():
    e = experiment("experiment=plate", *SMALL)
    given = planner.check_stands(e)
    assert list(boxes_told(given.given, given.place, e)) == []
    assert given.expected.std.shape[0] == len(given.place.nodes)


PLACES = {"a": [0.9, 0.1, 1.3], "b": [-0.5, 0.2, 1.3], "c": [0, -0.7, 1.4]}
CORNERS = [[0.28, 0.02, 0], [0.56, 0.02, 0], [0.56, 0.26, 0], [0.28, 0.26, 0]]


def marked(*views, poses=PLACES):
    """Make a session with rough poses, of which some views were marked since."""
    e = experiment("experiment=plate", *SMALL)
    e.scene = None
    rough = {name: KnownPose(origin=poses[name], look_at=[0.42, 0.14, 0.0]) for name in poses}
    steps = [[-600, 100], [-600, -1400], [600, -1400], [600, 100]]
    circles = {name: Centres(dac=steps, circles=[1, 2, 3, 4]) for name in views}
    regions = {name: ScanRegion(corners=steps) for name in views}
    e.scan = Session(
        calibration=CalibrationScan(views=circles),
        structure=Rectangle(views=regions, pixels=[9, 11], corners_at=CORNERS),
        poses=rough,
    )
    return e


def test_view_that_was_marked_stands_where_its_rough_pose_is():
    given = planner.check_stands(marked("a", "b"))
    assert [stand.name for stand in given.stands] == ["a", "b", "c"]
    assert given.undetermined == 0


def test_stands_of_marks_alone_are_told_not_to_be_known():
    with pytest.raises(UserError) as told:
        planner.check_stands(marked("a", "b", poses={"c": PLACES["c"]}))
    assert str(told.value) == (
        "plan: the stands of views a, b are not known, since DAC steps of marks alone do not tell "
        "them: give their rough poses too (scan.poses.a), or the folder of a run of these views"
    )
    with pytest.raises(UserError, match=r"stand of view a is not known, .* tell it: give its"):
        planner.check_stands(marked("a", poses={name: PLACES[name] for name in "bc"}))


def test_rough_poses_of_a_scan_of_images_alone_have_no_corners_in_steps():
    e = experiment("experiment=plate", *SMALL)
    views = {
        name: ScanRegion(pose=KnownPose(origin=place, look_at=[0.42, 0.14, 0.0]))
        for name, place in (("a", [0.9, 0.1, 1.3]), ("b", [-0.5, 0.2, 1.3]), ("c", [0, -0.7, 1.4]))
    }
    corners = [[0.28, 0.02, 0], [0.56, 0.02, 0], [0.56, 0.26, 0], [0.28, 0.26, 0]]
    e.scan = Rectangle(views=views, pixels=[9, 11], corners_at=corners)
    given = planner.check_stands(e)
    assert [stand.name for stand in given.stands] == ["a", "b", "c"]
    assert given.undetermined == 0
