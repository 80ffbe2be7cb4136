"""Views that are given by points of the world and a rough pose, and what they become in steps."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.errors import ConfigError, UserError
from sldvexp.geometry import KnownPose
from sldvexp.laser import TwoMirror, rays
from sldvexp.scan.by_hand import ByHand, Marks
from sldvexp.scan.calibration import CalibrationScan, Centres
from sldvexp.scan.pixel_list import PixelList, PixelSequence
from sldvexp.scan.rectangle import Rectangle, ScanRegion
from sldvexp.scan.session import Session
from sldvexp.targets import Circle, Circles, FiducialPoint, FiducialPoints
from sldvexp.units import LengthUnit

LASER = TwoMirror(mirror_offset=0.03)
FRONT = KnownPose(origin=[450.0, 100.0, 1500.0], look_at=[450.0, 100.0, 0.0], unit=LengthUnit.mm)
LEFT = KnownPose(origin=[-0.7, 0.2, 1.5], look_at=[0.4, 0.1, 0.0], roll=0.03)
CORNERS = [[150, -100, 0], [750, -100, 0], [750, 300, 0], [150, 300, 0]]
TARGET = Circles(
    unit=LengthUnit.mm,
    circles={
        n: Circle(x, y, 20.0) for n, (x, y) in {2: (20, 20), 5: (180, 30), 1: (90, 150)}.items()
    },
)


def on_the_plane(dac: np.ndarray, pose: KnownPose) -> np.ndarray:
    """Where the beams of steps meet z = 0, shape (N, 2), m."""
    own, along = rays(LASER.angle_from_dac(dac), LASER.mirror_offset)
    origin, along = pose.place + own @ pose.rotation, along @ pose.rotation
    return (origin - origin[:, 2:] / along[:, 2:] * along)[:, :2]


@pytest.mark.parametrize("pose", [FRONT, LEFT], ids=["front", "left"])
def test_the_box_holds_all_of_the_region_and_hardly_more(pose):
    scan = Rectangle(
        views={"a": ScanRegion(pose=pose)}, pixels=[9, 12], corners_at=CORNERS, unit=LengthUnit.mm
    )
    grid = scan.in_steps(LASER, None).grid("a")
    assert grid.shape == (9, 12, 2)
    outline = np.array(CORNERS, float) / 1000
    along = np.linspace(0, 1, 200)[:, None, None]
    edge = ((1 - along) * outline + along * np.roll(outline, -1, axis=0)).reshape(-1, 3)
    where = np.concatenate([edge, 0.5 * edge + 0.5 * outline.mean(axis=0)])
    point = (where - pose.place) @ pose.rotation.T
    steps = LASER.dac_from_angle(
        np.stack(
            [
                np.arctan2(point[:, 1], point[:, 2]),
                np.arctan2(point[:, 0], np.hypot(point[:, 1], point[:, 2]) + 0.03),
            ],
            axis=1,
        )
    )
    low, high = grid.min(axis=(0, 1)), grid.max(axis=(0, 1))
    np.testing.assert_allclose(low, steps.min(axis=0), atol=1)  # rounding, and bent edges
    np.testing.assert_allclose(high, steps.max(axis=0), atol=1)


def test_a_margin_is_a_length_at_the_region():
    def size(margin: float) -> np.ndarray:
        region = ScanRegion(pose=FRONT, corners_at=[[x / 1000 for x in p] for p in CORNERS])
        scan = Rectangle(views={"a": region}, pixels=[3, 3], margin=margin)
        grid = scan.in_steps(LASER, None).grid("a")
        along = on_the_plane(np.array([grid[1, 0], grid[1, 2], grid[0, 1], grid[2, 1]]), FRONT)
        return np.abs([along[0, 0] - along[1, 0], along[2, 1] - along[3, 1]])

    # Across the beam, which comes 12 degrees off the normal and from 2 % farther than the origin.
    grown = size(0.05) - size(0.0)
    assert (grown > 0.0995).all()
    assert (grown < 0.1 * 1.02 / np.cos(np.deg2rad(13)) + 5e-4).all()


def test_a_better_pose_takes_the_place_of_the_rough_one():
    rough = Rectangle(
        views={"a": ScanRegion(pose=FRONT)}, pixels=[2, 2], corners_at=CORNERS, unit=LengthUnit.mm
    )
    other = Rectangle(
        views={"a": ScanRegion(pose=LEFT)}, pixels=[2, 2], corners_at=CORNERS, unit=LengthUnit.mm
    )
    better = rough.in_steps(LASER, None, {"a": LEFT, "b": FRONT})
    np.testing.assert_array_equal(better.grid("a"), other.in_steps(LASER, None).grid("a"))


def test_pixels_fall_on_their_points_and_circles_on_their_centres():
    points = np.random.default_rng(0).uniform([100, -100, 0], [700, 300, 0], (90, 3))
    pixels = PixelList(
        views={"a": PixelSequence(pose=LEFT, pixels_at=points.tolist())}, unit=LengthUnit.mm
    )
    in_steps = pixels.in_steps(LASER, None)
    met = on_the_plane(np.concatenate(in_steps.lines("a")), LEFT)
    half_step = 1.2 * 0.5 * LASER.step.max() * 2.3 / np.cos(np.deg2rad(60))
    np.testing.assert_allclose(met, points[:, :2] / 1000, atol=half_step)

    scan = CalibrationScan(views={"a": Centres(pose=LEFT), "b": Centres([[1, 2]])})
    met = on_the_plane(scan.in_steps(LASER, TARGET).centres("a"), LEFT)
    expected = [[c.x / 1000, c.y / 1000] for c in TARGET.circles.values()]
    np.testing.assert_allclose(met, expected, atol=half_step)
    assert scan.in_steps(LASER, TARGET).centres("b").tolist() == [[1, 2]]
    assert scan.in_steps(LASER, TARGET).pixel_count("a") == 3 * (3 * 300 + 44 * 25)


def test_a_session_says_its_poses_once():
    session = Session(
        structure=Rectangle(corners_at=CORNERS, pixels=[4, 5], unit=LengthUnit.mm),
        poses={"front": FRONT, "left": LEFT},
    )
    assert session.view_names() == ["front", "left"]
    circles, image = session.parts("left")
    assert circles.views == {n: Centres(pose=p) for n, p in session.poses.items()}
    assert image.views == {n: ScanRegion(pose=p) for n, p in session.poses.items()}
    in_steps = session.in_steps(LASER, TARGET)
    assert [part.kind for part in in_steps.parts("left")] == ["circles", "image"]
    assert in_steps.structure.grid("left").shape == (4, 5, 2)
    assert in_steps.calibration.centres("front").shape == (3, 2)


def test_a_session_of_marks_takes_its_poses_for_the_images_alone():
    session = Session(
        structure=Rectangle(corners_at=CORNERS, pixels=[4, 5], unit=LengthUnit.mm),
        marks=ByHand(views={"front": Marks()}),
        poses={"front": FRONT},
    )
    assert [part.kind for part in session.parts("front")] == ["image", "marks"]


def test_an_own_entry_of_a_view_stays():
    session = Session(
        calibration=CalibrationScan(views={"front": Centres([[1, 2], [3, 4], [5, 6]])}),
        structure=Rectangle(corners_at=CORNERS, pixels=[4, 5], unit=LengthUnit.mm),
        poses={"front": FRONT},
    )
    circles, image = session.parts("front")
    assert circles.views["front"] == Centres([[1, 2], [3, 4], [5, 6]])
    assert image.views["front"].pose == FRONT


BEHIND = KnownPose(origin=[0.4, 0.1, 1.5], look_at=[0.4, 0.1, 3.0])
NEAR = KnownPose(origin=[0.4, 0.1, 0.3], look_at=[0.4, 0.1, 0.0])


@pytest.mark.parametrize(
    ("scan", "told"),
    [
        (
            CalibrationScan(views={"front": Centres(pose=BEHIND)}),
            "^scan: in the view front, circle 2 lies behind the instrument; correct the pose of",
        ),
        (
            CalibrationScan(views={"front": Centres(pose=NEAR)}),
            "^scan: in the view front, circle 2 is out of reach: the left_right angle of [0-9.]+ "
            "deg is not within the mirror's range of -25 to 25 deg; move the instrument",
        ),
        (
            Rectangle(
                views={"front": ScanRegion(pose=NEAR)},
                stride=1,
                corners_at=CORNERS,
                unit=LengthUnit.mm,
            ),
            r"^scan: in the view front, corner 1 at \(150, -100, 0\) mm is out of reach: the ",
        ),
        (
            PixelList(views={"front": PixelSequence(pose=BEHIND, pixels_at=[[0.1, 0.2, 0.0]])}),
            r"^scan: in the view front, pixel 1 at \(0.1, 0.2, 0.0\) m lies behind the instrument",
        ),
    ],
)
def test_what_cannot_be_reached_is_named_with_its_view(scan, told):
    with pytest.raises(UserError, match=told):
        scan.in_steps(TwoMirror(), TARGET)


def test_circles_are_predicted_of_a_target_that_has_them():
    scan = CalibrationScan(views={"front": Centres(pose=FRONT)})
    marks = FiducialPoints(fiducials={k: FiducialPoint(k % 2, k // 2) for k in range(3)})
    for target in (None, marks):
        with pytest.raises(
            UserError, match=r"^scan: the rough pose of the view front predicts circ"
        ):
            scan.in_steps(LASER, target)


@pytest.mark.parametrize(
    ("make", "field", "message"),
    [
        (
            lambda: CalibrationScan(views={"a": Centres([[1, 2]], pose=FRONT)}),
            "views.a",
            "give dac, path, or a rough pose, one of them",
        ),
        (
            lambda: CalibrationScan(views={"a": Centres()}),
            "views.a",
            "give dac, path, or a rough pose, one of them",
        ),
        (
            lambda: CalibrationScan(views={"a": Centres(pose=KnownPose(origin=[0, 0, 1]))}),
            "views.a.pose",
            "give either euler or look_at, and the origin",
        ),
        (lambda: CalibrationScan(margin=0.0), "margin", "must be a positive number, not 0.0"),
        (
            lambda: Rectangle(views={"a": ScanRegion(pose=FRONT)}, stride=1),
            "corners_at",
            "must be 3 or more points of the world, not 0",
        ),
        (
            lambda: Rectangle(
                views={"a": ScanRegion(pose=FRONT, corners_at=[[0, 1]] * 3)}, stride=1
            ),
            "views.a.corners_at[0]",
            "must be three numbers x, y, z, not [0, 1]",
        ),
        (
            lambda: Rectangle(views={"a": ScanRegion(corners_at=CORNERS)}, stride=1),
            "views.a",
            "give corners, path, or a rough pose and corners_at, one of them",
        ),
        (lambda: Rectangle(margin=-1.0), "margin", "must be zero or a positive number, not -1.0"),
        (
            lambda: PixelList(views={"a": PixelSequence(pose=FRONT)}),
            "views.a",
            "give dac, path, or a rough pose and pixels_at, one of them",
        ),
        (
            lambda: PixelList(views={"a": PixelSequence(pixels_at=[[0, 0, 0]])}),
            "views.a",
            "give dac, path, or a rough pose and pixels_at, one of them",
        ),
        (
            lambda: Session(poses={"a": KnownPose([0, 0, 0], [0, 0, 1], samples=5)}),
            "poses.a",
            "is a rough pose, without standard deviations and samples",
        ),
    ],
)
def test_wrong_entries_are_told(make, field, message):
    with pytest.raises(ConfigError) as error:
        make()
    assert {p.field: p.message for p in error.value.problems}[field] == message
