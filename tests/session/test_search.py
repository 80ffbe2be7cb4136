"""Circles are found from rough poses, or a sentence says which one is not, and why."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from sldvexp.errors import UserError
from sldvexp.geometry import KnownPose, euler_from_rotation, rotation_from_vector
from sldvexp.image import fit_circle
from sldvexp.instrument import InstrumentError, Replay
from sldvexp.instrument.recording import JOURNAL
from sldvexp.laser import dac_of_points
from sldvexp.scan.calibration import Centres
from sldvexp.session.circles import edges_of
from sldvexp.session.operator import Operator
from sldvexp.session.search import PredictedCircle, spots_of
from sldvexp.session.session import scan_views
from sldvexp.signal.pixel_quality import Intercept
from sldvexp.targets import Plane
from sldvexp.units import LengthUnit

pytestmark = pytest.mark.usefixtures("client_clock")

#: A corner of the plate's face, 15 mm inside of it.
CORNERS = "[[0.285, 0.03, 0], [0.555, 0.03, 0], [0.555, 0.25, 0], [0.285, 0.25, 0]]"
SMALL = (
    "scan.calibration.coarse.pixels=180",
    "scan.calibration.fine.lines=8",
    "scan.calibration.sampling.samples=64",
    "scan.structure.sampling.samples=64",
    "scan.structure.pixels=[5,6]",
)


def off(pose: KnownPose, degrees: float, mm: float, seed: int | None) -> KnownPose:
    """A pose that is wrong by an angle and a length, somehow; without a seed both add up."""
    turn, shift = np.array([0.0, 1.0, 0.0]), -pose.rotation[0]
    if seed is not None:
        turn, shift = np.random.default_rng(seed).standard_normal((2, 3))
    turn = turn * np.deg2rad(degrees) / np.linalg.norm(turn)
    shift = shift * mm / 1000 / np.linalg.norm(shift)
    euler = euler_from_rotation(rotation_from_vector(turn) @ pose.rotation)
    return KnownPose(euler.tolist(), (pose.place + shift).tolist())


def session(composed, degrees, mm, *more, seed=0):
    """A session of two views whose rough poses are off from the true ones of the scene."""
    e = composed("scan=session", *SMALL, f"scan.structure.corners_at={CORNERS}", *more)
    poses = {view: off(e.scene.views[view], degrees, mm, seed) for view in "ab"}
    return replace(e, scan=replace(e.scan, poses=poses))


def centres_of(edges) -> np.ndarray:
    """Middles of the edges of each circle, in the order in which they were scanned."""
    return np.array([g["dac"].values.mean(axis=0) for _, g in edges.groupby("circle")])


class Eye:
    """Points at marks of a virtual lab without error, and remembers where the beam began."""

    def __init__(self, lab, hidden=()):
        self.lab, self.hidden, self.began, self.true = lab, hidden, [], []

    def aim(self, mark, start):
        if mark.number in self.hidden:
            return None
        self.began.append(start)
        self.true.append(self.lab.true_dac(mark.position))
        up_down, left_right = np.rint(self.true[-1]).astype(int).tolist()
        return up_down, left_right


@pytest.mark.one_in(2)
@pytest.mark.parametrize("where", ["scan.views.a", "scan.poses"])
def test_the_beam_begins_where_a_rough_pose_predicts_a_mark(composed, tmp_path, monkeypatch, where):
    marks = "{a: {hidden: [3]}}"
    scan = ["scan=by_hand", f"scan.views={marks}"]
    if where == "scan.poses":
        scan = ["scan=session", f"scan.marks.views={marks}"]
    e = composed(*scan, "target=fiducials", "scene.operator.mark_error=false")
    rough = off(e.scene.views["a"], 1.0, 20.0, None)
    if where == "scan.poses":
        e = replace(e, scan=replace(e.scan, poses={"a": rough}))
    else:
        e.scan.views["a"].pose = rough
    eyes = []

    def eye(lab):
        eyes[:] = eyes or [Eye(lab, hidden=(5,))]
        return eyes[0]

    monkeypatch.setattr("sldvexp.virtual_lab.VirtualLab.person", property(eye))
    found = scan_views(e, tmp_path)["registration"]
    assert found["point"].values.tolist() == [1, 2, 4, 6]
    beside = np.abs(np.array(eyes[0].began) - eyes[0].true).max(axis=1)
    assert beside[0] > 250
    assert (beside[1:] < [30, 30, 20]).all()


class Nobody(Operator):
    """Says what was asked."""

    def ask(self, request: str) -> str:
        raise UserError(request)


def test_the_operator_is_told_where_to_stand(composed, tmp_path, monkeypatch):
    e = session(composed, 0.0, 0.0)
    monkeypatch.setattr(type(e.instrument), "takes_views_itself", False)
    pose = KnownPose(origin=[900, 500, 1600], look_at=[100, 120.5, 0], unit=LengthUnit.mm)
    e = replace(e, scan=replace(e.scan, poses=e.scan.poses | {"a": pose}))
    told = (
        "Move the instrument to the view a, to about (900, 500, 1600) mm, looking at "
        "(100, 120.5, 0), then press Enter: "
    )
    with pytest.raises(UserError, match=re.escape(told)):
        scan_views(e, tmp_path, Nobody())


@pytest.mark.whole
@pytest.mark.parametrize(("seed", "beside"), [(None, 250), (0, 50), (1, 50)])
def test_a_rough_pose_wrong_by_a_degree_and_20_mm_is_enough(composed, tmp_path, seed, beside):
    e = session(composed, 1.0, 20.0, seed=seed)
    found = scan_views(e, tmp_path)
    for view in e.scan.view_names():
        with e.instrument.open(e.scene, e.laser, e.target, seed=e.seed, view=view) as lab:
            circles = lab.true_dac(e.target.outlines().mean(axis=1))
            corners = lab.true_dac(np.array(e.scan.structure.corners_at))
        predicted = e.scan.in_steps(e.laser, e.target).parts(view)[0].centres(view)
        assert np.abs(predicted - circles).max() > beside  # a circle is 110 wide
        assert np.abs(centres_of(found[f"edge/{view}"]) - circles).max() < 4
        # The circles have corrected the pose before the structure's corners are predicted.
        dac = found[f"image/{view}"]["dac"].values
        assert np.abs(dac.min(axis=0) - corners.min(axis=0)).max() < 20
        assert np.abs(dac.max(axis=0) - corners.max(axis=0)).max() < 20


@pytest.mark.whole
def test_a_search_that_was_cut_off_or_is_replayed_comes_out_the_same(composed, tmp_path):
    e = session(composed, 1.0, 20.0)
    found = scan_views(e, tmp_path / JOURNAL)
    for path in sorted((tmp_path / JOURNAL).rglob("*.npz"))[::3]:
        path.unlink()
    again = scan_views(e, tmp_path / JOURNAL)
    replayed = replace(e, instrument=Replay(str(tmp_path)), scene=None)
    other = scan_views(replayed, tmp_path / "other")
    for name, group in found.items():
        assert group.identical(again[name]), name
        assert group.identical(other[name]), name


#: Another estimate of the same samples, which puts the fine lines and the region steps beside.
OTHER = {"harmonics": 3, "refine": True, "intercept": Intercept.never}


@pytest.fixture(scope="module")
def recorded(composed, tmp_path_factory):
    """A session of one view, the folder of its recording, and what it found."""
    e, folder = session(composed, 1.0, 20.0), tmp_path_factory.mktemp("recorded")
    e = replace(e, scan=replace(e.scan, poses={"a": e.scan.poses["a"]}))
    return e, folder, scan_views(e, folder / JOURNAL)


@pytest.mark.whole
def test_a_recording_is_processed_by_another_estimator_where_its_lines_are(recorded, tmp_path):
    e, folder, found = recorded
    signal = replace(e.signal, **OTHER)
    other = replace(e, signal=signal, instrument=Replay(str(folder)), scene=None)
    again = scan_views(other, tmp_path / "other")
    assert list(again) == list(found)
    for name, group in found.items():
        if name.startswith("image"):
            np.testing.assert_array_equal(again[name]["dac"], group["dac"])
            assert np.abs(again[name]["velocity"] - group["velocity"]).max() > 0
        else:  # of the same lines other edges
            away = centres_of(again[name]) - centres_of(group)
            assert 0 < np.abs(away).max() < 2


@pytest.mark.one_in(4)
@pytest.mark.parametrize(
    "changed",
    [
        {"fine": {"lines": 9}},
        {"fine": {"stride": 2}},
        {"fine": {"pixels": 27}},
        {"coarse": {"stride": 4}},
    ],
    ids=lambda c: "-".join([*c, *next(iter(c.values()))]),
)
def test_a_recording_is_not_taken_for_one_of_other_lines(recorded, tmp_path, changed):
    e, folder, _ = recorded
    scan = e.scan.calibration
    for name, values in changed.items():
        scan = replace(scan, **{name: replace(getattr(scan, name), **values)})
    e = replace(e, scan=replace(e.scan, calibration=scan))
    with pytest.raises(InstrumentError, match="a recording can only be scanned as it was"):
        scan_views(replace(e, instrument=Replay(str(folder)), scene=None), tmp_path / "other")


@pytest.mark.long
def test_rough_poses_of_a_hundred_views_find_their_circles(composed, tmp_path):
    e = composed("scan=calibration", "scan.views={a: {dac: [[0, 0]]}}", "scan.sampling.samples=64")
    fine, coarse = replace(e.scan.fine, lines=8), replace(e.scan.coarse, pixels=180)
    for seed in range(15):  # of seven views
        for view, pose in e.scene.views.items():
            rough = {view: Centres(pose=off(pose, 1.0, 20.0, seed))}
            scan = replace(e.scan, views=rough, coarse=coarse, fine=fine)
            scan_views(replace(e, scan=scan, seed=seed), tmp_path / f"{view}{seed}")


@pytest.mark.whole
def test_a_pose_that_is_farther_off_than_the_margin_is_told_with_what_remains(composed, tmp_path):
    e = session(composed, 0.0, 0.0, "scan.calibration.margin=0.02")
    moved = replace(e.scan.poses["a"], origin=[0.40, 0.53, 1.655])
    e = replace(e, scan=replace(e.scan, poses=e.scan.poses | {"a": moved}))
    told = (
        r"^scan: in the view a, circle 1 is not found within 20 mm of DAC steps \(-\d+, \d+\), "
        r"where the rough pose predicts it; if its speaker was dead or hidden, delete "
        r"\S+/a/search_\* and resume the run, else start anew with a better rough pose of the "
        "view, or a larger margin of the scan of circles$"
    )
    with pytest.raises(UserError, match=told):
        scan_views(e, tmp_path)
    wider = replace(e.scan, calibration=replace(e.scan.calibration, margin=0.15))
    assert "edge/a" in scan_views(replace(e, scan=wider), tmp_path / "wider")


def test_a_dead_speaker_is_told_with_how_many_were_found(composed, tmp_path):
    e = session(composed, 1.0, 20.0, "scene.speakers={3: {velocity: 0}}")
    with pytest.raises(
        UserError, match=r"circle 3 is not found .* predicts it, though 2 of 4 were"
    ):
        scan_views(e, tmp_path)


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ("scene.generator_gain=0", "around it, the reference channel has no signal of 450 Hz"),
        ("scene.shutter_open=false", "around it, no light comes back from"),
    ],
)
def test_an_instrument_at_fault_is_told_as_the_cause(composed, tmp_path, wrong, told):
    e = session(composed, 1.0, 20.0, wrong)
    with pytest.raises(UserError, match=f"circle 1 is not found within 80 mm .*; {told}"):
        scan_views(e, tmp_path)


#: Four circles of 40 mm, the second on a block that hides the first from the right.
BLOCK = {1: (0.03, 0.03), 2: (0.16, 0.03), 3: (0.15, 0.225), 4: (0.03, 0.215)}


def before(composed, circles, diameter, places, *more):
    """A session before circles of one diameter, the true places being as far off as rough ones."""
    told = ", ".join(
        f"{n}: {{x: {x}, y: {y}, diameter: {diameter}}}" for n, (x, y) in circles.items()
    )
    poses = {
        view: KnownPose(origin=origin, look_at=[0.25, 0.1, 0.0])
        for view, origin in zip("ab", places, strict=True)
    }
    e = composed(
        "scan=session",
        *SMALL,
        f"scan.structure.corners_at={CORNERS}",
        "target=schema/circles",
        f"target.circles={{{told}}}",
        *more,
    )
    rough = {view: off(pose, 0.4, 10.0, 1) for view, pose in poses.items()}
    return replace(e, scene=replace(e.scene, views=poses), scan=replace(e.scan, poses=rough))


@pytest.mark.one_in(2)
@pytest.mark.parametrize("x", [0.16, 0.12])
def test_a_circle_behind_another_one_is_told_as_that(composed, tmp_path, x):
    """Also where all of it is hidden, and the other one is found in its place."""
    places = [0.2, 0.1, 1.5], [1.62, 0.11, 1.49]
    e = before(composed, BLOCK | {2: (x, 0.03)}, 0.04, places)
    raised = e.target.circles | {2: replace(e.target.circles[2], plane="raised")}
    planes = e.target.planes | {"raised": Plane(origin=[0, 0, 0.1])}
    e = replace(e, target=replace(e.target, circles=raised, planes=planes))
    e = replace(e, scan=replace(e.scan, poses={"b": e.scan.poses["b"]}))
    told = (
        "^scan: in the view b, .*circle 1 is hidden in part by circle 2, or looks too near to it, "
        "at another depth; stand more in front of the calibration object, or take that block or "
        "circle away; sldvexp aim tells"
    )
    with pytest.raises(UserError, match=told):
        scan_views(e, tmp_path)


@pytest.mark.whole
@pytest.mark.parametrize(
    ("board", "diameter", "away"),
    [("bits_12_sign", 0.1, 0.9), ("bits_16", 0.1, 0.9), ("bits_16", 0.02, 1.8)],
)
def test_lines_are_as_long_as_the_circles_need(composed, tmp_path, board, diameter, away):
    """Wide circles near by, and small ones far away, without any stride given."""
    circles = {1: (0, 0), 2: (0.2, 0.02), 3: (0.18, 0.2), 4: (0.02, 0.19)}
    places = [0.2, 0.1, away], [0.8, 0.1, away]
    e = before(composed, circles, diameter, places, f"laser.board={board}")
    found = scan_views(e, tmp_path)
    outlines = e.target.outlines()
    for view in "ab":
        pose = e.scene.views[view]
        for k, (_, edges) in enumerate(found[f"edge/{view}"].groupby("circle")):
            steps = dac_of_points(outlines[k], pose.rotation, pose.place, e.laser, ["rim"] * 16)
            assert edges.sizes["edge"] == 8
            off_by = edges["dac"].values.mean(axis=0) - steps.mean(axis=0)
            assert np.abs(off_by).max() < 0.02 * np.ptp(steps, axis=0).max()


def oblique(composed, incidence, *more):
    """A session of one view before four circles of 40 mm that are seen at an angle, deg."""
    circles = {1: (0, 0), 2: (0.2, 0.02), 3: (0.18, 0.2), 4: (0.02, 0.19)}
    turn = np.deg2rad(incidence)
    place = [float(0.1 - 1.3 * np.sin(turn)), 0.1, float(1.3 * np.cos(turn))]
    more = "scan.calibration.fine.lines=20", *more
    e = before(composed, circles, 0.04, [place, place], *more)
    return replace(e, scan=replace(e.scan, poses={"a": e.scan.poses["a"]}))


@pytest.mark.whole
@pytest.mark.parametrize(
    ("board", "incidence", "waist"), [("bits_16", 70.0, 1e-3), ("bits_12_sign", 70.0, 1.5e-3)]
)
def test_an_edge_that_a_wide_spot_blurs_over_an_oblique_circle_is_seen(
    composed, tmp_path, board, incidence, waist
):
    """Its two sides are more pixels apart than the coarse lines' edges are looked at."""
    e = oblique(composed, incidence, f"laser.board={board}", f"scene.spot.waist={waist}")
    edges = edges_of(scan_views(e, tmp_path)["edge/a"])
    pose = e.scene.views["a"]
    for outline, found in zip(e.target.outlines(), edges, strict=True):
        steps = dac_of_points(outline, pose.rotation, pose.place, e.laser, ["rim"] * len(outline))
        off_by = fit_circle(found)[0].ellipse.centre - steps.mean(axis=0)
        assert np.abs(off_by).max() < 0.02 * np.ptp(steps, axis=0).max()


@pytest.mark.whole
@pytest.mark.parametrize(
    ("incidence", "told", "wrong", "right"),
    [
        (
            70.0,
            r"; only \d+ pixels of one of its lines lie within the circle, as the rough pose "
            r"predicts it, fewer than coarse\.window=25: set no coarse\.stride, below .*, where 60 "
            "is set; the rough pose then tells one for each line$",
            ("scan.calibration.coarse.stride=60",),
            (),
        ),
        (
            75.0,
            r"; its lines have a pixel every \d+, \d+, \d+ DAC steps, as the rough pose tells the "
            r"circle's size: give it more of them, coarse\.lines=9, below",
            ("scene.spot.waist=1e-3",),
            ("scene.spot.waist=1e-3", "scan.calibration.coarse.lines=9"),
        ),
    ],
)
def test_lines_that_do_not_show_an_oblique_circle_are_told_with_those_that_do(
    composed, tmp_path, incidence, told, wrong, right
):
    with pytest.raises(UserError, match=told):
        scan_views(oblique(composed, incidence, "laser.board=bits_16", *wrong), tmp_path / "wrong")
    found = scan_views(oblique(composed, incidence, "laser.board=bits_16", *right), tmp_path)
    assert len(edges_of(found["edge/a"])) == 4


def test_only_a_whole_spot_of_the_circles_size_is_one():
    circle = PredictedCircle(
        1, np.zeros(2), np.full(2, 4.0), 12.0, np.full(2, 20.0), np.zeros((16, 2)), np.zeros(3)
    )
    size = 2 * circle.rings + 1
    middle = circle.rings

    def spots(*blocks, ring=circle.rings - 2):
        moves = np.zeros((size, size), bool)
        for rows, columns in blocks:
            moves[
                middle + rows[0] : middle + rows[1], middle + columns[0] : middle + columns[1]
            ] = 1
        return [spot.tolist() for spot in spots_of(moves, ring, circle)]

    assert spots(((2, 6), (-5, -2))) == [[3.5, -4.0]]
    assert spots(((0, 1), (0, 1))) == []  # speckle
    assert spots(((-5, 5), (-5, 5))) == []  # a plate
    assert spots(((2, 6), (-5, -2)), ring=5) == []  # goes on where nothing was scanned yet
    assert spots(((2, 5), (2, 5)), ((-2, 1), (-1, 3))) == [[-1.0, 0.5], [3.0, 3.0]]
