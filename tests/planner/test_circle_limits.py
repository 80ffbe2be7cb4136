"""Sentences on stands that the calibration object limits."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.config.experiment import Experiment
from sldvexp.config.planning import PlanRoom
from sldvexp.errors import UserError
from sldvexp.laser import TwoMirror
from sldvexp.planner.circle_limits import around, hidden_told
from sldvexp.planner.images import stand_at
from sldvexp.planner.marks import TargetMarks
from sldvexp.planner.place import Place, Unseen
from sldvexp.planner.search import candidates, examined
from sldvexp.targets import Circle, Circles, Plane
from sldvexp.units import LengthUnit
from sldvexp.volume import Grid


def place(incidence=60.0, forward=100.0, faces=("front", "top")):
    """A plate beside a box whose front is so many mm before it, with circles on some faces."""
    front = {1: Circle(20, 20, 30.0), 2: Circle(180, 25, 30.0), 4: Circle(30, 120, 30.0)}
    top = {5: Circle(30, 40, 30.0, "top"), 6: Circle(160, 60, 30.0, "top")}
    circles = (front if "front" in faces else {}) | (top if "top" in faces else {})
    planes = {
        "front": Plane([0.0, 0.0, forward], [0.0, 0.0, 1.0]),
        "top": Plane([0.0, 150.0, forward], [0.0, 1.0, 0.0]),
    }
    target = Circles(unit=LengthUnit.mm, circles=circles, planes=planes, accuracy=0.05)
    volume = Grid(center=[0.5, 0.075, 0.0], size=[0.46, 0.31], shape=[7, 5], layers=2)
    experiment = Experiment(volume=volume, laser=TwoMirror(), target=target)
    experiment.plan.room = PlanRoom(incidence=incidence)
    return Place.from_experiment(experiment)


@pytest.mark.whole
def test_circles_on_two_faces_limit_the_stands_and_those_on_one_do_not():
    told = around(place(), np.random.default_rng(0))
    assert "circles of the calibration object limit the stands" in told
    assert "one of a waist of 2 mm needs coarse.lines=9" in told
    assert "within 72 deg" in told
    assert around(place(incidence=72.0), np.random.default_rng(0)) == ""
    assert around(place(faces=("front",)), np.random.default_rng(0)) == ""


@pytest.mark.whole
def test_where_circles_forbid_every_stand_the_incidence_is_said_that_allows_some():
    told = r"with plan.room.incidence=\d\d \d+ of them are feasible \(circles are found up to 72"
    with pytest.raises(UserError, match=told):
        candidates(place(incidence=45.0), 50, np.random.default_rng(0))


def test_circles_that_the_plate_hides_are_told():
    """From the right the edge of the plate is before a circle that lies 60 mm behind its plane."""
    away = np.array([1.455, 1.081, 0.585])
    behind, before = place(72.0, forward=0.0), place(72.0, forward=100.0)
    (told,) = hidden_told([stand_at("3", away, behind)], behind)
    assert told.startswith("stand 3: the structure hides circle 6 of the calibration object, or ")
    assert list(hidden_told([stand_at("3", away, before)], before)) == []


def test_circles_that_are_turned_away_beyond_where_they_are_found_refuse_a_stand():
    """Whatever the incidence that the surface allows: here one on the top is seen at 76 deg."""
    steep, flat = np.array([[0.4, 0.8, 1.6]]), np.array([[0.4, 0.55, 1.7]])
    wide = place(incidence=85.0)
    assert max(wide.marks.incidences(flat[0]).values()) > 72
    assert examined(wide, flat).refused.tolist() == [Unseen.target_incidence]
    assert max(wide.marks.incidences(steep[0]).values()) < 72
    assert examined(wide, steep).refused.tolist() == [Unseen.seen]


def test_of_single_marks_the_structure_may_hide_all_but_four():
    plate = place(faces=("front",))
    x = np.linspace(0.35, 0.65, 5)
    behind = np.stack([x, np.full(5, 0.075), np.full(5, -0.1)], axis=1)
    beside = behind + np.array([0.0, 0.5, 0.0])
    origin = np.array([[0.5, 0.075, 2.0]])
    for free, refused in ((5, False), (4, False), (3, True)):
        position = np.concatenate([beside[:free], behind[free:]])
        marks = TargetMarks(position, np.zeros_like(position), np.zeros((0, 3)))
        hidden = marks.hidden_by(plate.structure, origin)
        assert (~hidden).sum() == free
        assert marks.too_few(hidden).tolist() == [refused]
    on_it = behind + np.array([0.0, 0.0, 0.1])
    marks = TargetMarks(on_it, np.zeros_like(on_it), np.zeros((0, 3)))
    assert not marks.hidden_by(plate.structure, origin).any()
