"""Calibration objects: one acceptance test for all, then what is particular to each."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from omegaconf import OmegaConf

from sldvexp.errors import ConfigError
from sldvexp.geometry.circles import LINES
from sldvexp.io.registration import read
from sldvexp.targets import Circle, Circles, FiducialPoint, FiducialPoints, Plane
from sldvexp.targets.circles import bitangents_in_space, bitangents_std
from sldvexp.units import LengthUnit
from tests.composing import part

CONF = Path(__file__).parents[2] / "conf"
INCH = LengthUnit.inch.value

# Table 4.1 with the coordinates of Figure 4.28, inch; point numbers 1 to 16.
PUBLISHED = [
    [2.3490, 3.2156],
    [2.1653, 2.4277],
    [7.5578, 2.0048],
    [7.3725, 1.2100],
    [7.0696, 1.7066],
    [7.8611, 1.5078],
    [9.1017, 9.8073],
    [9.8976, 9.6075],
    [9.5079, 9.2973],
    [9.4905, 10.1177],
    [1.5890, 9.1396],
    [1.5721, 9.9408],
    [1.9797, 9.5806],
    [1.1823, 9.5003],
    [2.6598, 2.8623],
    [1.8549, 2.7813],
]


def configured(name: str, *overrides: str):
    return OmegaConf.to_object(part(f"+target={name}", *overrides))["target"]


def accept(target) -> None:
    """What every calibration object must give to those who use it."""
    points = target.points()
    n = len(points.number)
    assert n >= 3
    assert len(set(points.number.tolist())) == n
    assert points.number.dtype.kind == "i"
    assert points.position.shape == points.std.shape == (n, 3)
    assert np.isfinite(points.position).all()
    assert len(points.label) == len(set(points.label)) == n
    bound = target.unit.value * target.accuracy / np.sqrt(3)
    # Of the order of one coordinate's: a tangent point mixes center, radius and turn of the line.
    assert (points.std >= 0.9 * bound).all()
    assert (points.std <= 1.5 * bound).all()
    spread = np.linalg.svd(points.position - points.position.mean(axis=0), compute_uv=False)
    assert spread[1] > 1e-6 * spread[0]  # not on one line
    group = target.to_dataset()
    np.testing.assert_array_equal(group["position"].sel(axis=["x", "y", "z"]), points.position)
    np.testing.assert_array_equal(group["position_std"], points.std)
    np.testing.assert_array_equal(group["point"], points.number)
    assert group["position"].attrs["units"] == "m"


@pytest.mark.parametrize("name", sorted(p.stem for p in (CONF / "target").glob("*.yaml")))
def test_every_configured_target(name):
    accept(configured(name))


@pytest.mark.parametrize("unit", LengthUnit)
def test_the_unit_scales_everything(unit):
    square = {1: (0, 0), 2: (3, 0), 3: (3, 4), 4: (0, 4)}
    for target in (
        Circles(unit, 0.01, {n: Circle(x, y, 1) for n, (x, y) in square.items()}),
        FiducialPoints(unit, 0.01, {n: FiducialPoint(x, y, 0) for n, (x, y) in square.items()}),
    ):
        accept(target)
        in_m = type(target)(**{**vars(target), "unit": LengthUnit.m})
        ours, reference = target.points(), in_m.points()
        np.testing.assert_allclose(ours.position, reference.position * unit.value, rtol=1e-12)
        np.testing.assert_allclose(ours.std, reference.std * unit.value, rtol=1e-12)


def test_bitangent_points_of_the_dissertation():
    points = configured("dissertation").points()
    assert points.number.tolist() == list(range(1, 17))
    np.testing.assert_allclose(points.position[:, :2] / INCH, PUBLISHED, atol=1e-4)
    assert (points.position[:, 2] == 0).all()
    assert points.label[0] == "circle 1 of pair 1-2, external left"
    assert points.label[15] == "circle 1 of pair 4-1, external right"
    (table,) = read(CONF / "data" / "figure_4_28.reg")
    np.testing.assert_allclose(points.position, table.object_point, atol=1e-4 * INCH)


def test_all_48_bitangent_points():
    target = configured("dissertation")
    points, every = target.points(), target.all_bitangents()
    assert every.position.shape == (48, 3)  # Section 4.5.2
    assert every.number.tolist() == list(range(1, 49))
    assert every.label[:2] == tuple(f"circle {n} of pair 1-2, external left" for n in (1, 2))
    assert [label.split(", ")[1] for label in every.label[:8:2]] == list(LINES)
    # Six pairs; the ring of Figure 4.1 is among them, its last pair the other way round.
    at = {label: position for label, position in zip(every.label, every.position, strict=True)}
    for label, position in zip(points.label, points.position, strict=True):
        if "pair 4-1" in label:
            label = label.replace("4-1", "1-4")
            label = label.replace("left", "L").replace("right", "left").replace("L", "right")
        np.testing.assert_allclose(at[label], position, atol=1e-12)


def test_second_plane():
    target = configured("two_planes")
    points = target.points()
    assert points.number.tolist() == list(range(1, 33))
    np.testing.assert_allclose(points.position[:16, :2] / INCH, PUBLISHED, atol=1e-4)
    raised = points.position[16:] / INCH
    normal = np.array([0, 0.2, 1]) / np.hypot(0.2, 1)
    np.testing.assert_allclose((raised - [5.5, 5.5, 3]) @ normal, 0, atol=1e-12)
    # In the plane's own axes: x as the object's, y along (0, 1, -0.2).
    up = np.array([0, 1, -0.2]) / np.hypot(0.2, 1)
    center = np.array([4, 5.5, 3]) - 1.5 * up  # circle 5
    np.testing.assert_allclose(raised[0], center + 0.4 * up, atol=1e-12)  # left of 5-6
    assert target.all_bitangents().position.shape == (96, 3)


@pytest.mark.parametrize("normal", [[0, 0, 1], [0, 0, -2], [0.3, -0.5, 1], [1, 0, 0.01]])
def test_axes_of_a_plane(normal):
    x, y, n = axes = Plane(normal=normal).axes()
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(n, np.array(normal) / np.linalg.norm(normal))
    np.testing.assert_allclose(np.cross(x, y), n, atol=1e-12)
    # Of all directions in the plane, the projection of the object's x axis is the nearest to it.
    assert x[0] > 0
    assert y[0] == pytest.approx(0, abs=1e-12)


def test_pairs():
    circles = {n: Circle(3 * n, n % 2, 1) for n in (4, 2, 7)}
    assert Circles(circles=circles).selected_pairs() == [(2, 4), (4, 7), (7, 2)]
    del circles[7]
    two = Circles(circles=circles)
    assert two.selected_pairs() == [(2, 4)]
    assert len(two.points().number) == 4
    chosen = Circles(circles=circles, pairs=[" 4 - 2"])
    assert chosen.selected_pairs() == [(4, 2)]
    swapped = two.points().position[[3, 2, 1, 0]]
    np.testing.assert_allclose(chosen.points().position, swapped, atol=1e-12)
    assert configured("dissertation", "target.pairs=[1-3,2-4]").selected_pairs() == [(1, 3), (2, 4)]


def test_std_of_bitangent_points_against_their_scatter():
    trials, std = 20_000, 0.01
    rng = np.random.default_rng(5)
    a, b = np.array([0.0, 0.0, 0.6]), np.array([1.5, 0.7, 0.4])
    scale = std * np.array([1, 1, 0.5])  # the diameter has std, the radius half of it
    noisy_a, noisy_b = (c + scale * rng.standard_normal((trials, 3)) for c in (a, b))
    axes = Plane(normal=[0.3, -0.5, 1]).axes()
    height = std * rng.standard_normal((trials, 1, 1, 1)) * axes[2]
    repeated = np.broadcast_to(axes, (trials, 3, 3))
    points = bitangents_in_space(noisy_a, noisy_b, np.zeros((trials, 3)), repeated) + height
    ratio = points.std(axis=0) / bitangents_std(a[None], b[None], axes[None], std)[0]
    # A sample's deviation scatters by 1 / sqrt(2 n); 24 of them stay within 4 of that, and
    # curvature adds (std / gap)^2, here up to 3e-4.
    assert np.abs(ratio - 1).max() < 4 / np.sqrt(2 * trials) + 3e-4


def test_fiducials_keep_their_numbers_and_order():
    points = FiducialPoints(
        LengthUnit.mm,
        0.5,
        {9: FiducialPoint(1, 2, 3), 2: FiducialPoint(4, 5, 7), 5: FiducialPoint(0, 0, 0)},
    )
    assert points.points().number.tolist() == [9, 2, 5]
    expected = np.array([[1, 2, 3], [4, 5, 7], [0, 0, 0]]) * 1e-3
    np.testing.assert_allclose(points.points().position, expected)
    np.testing.assert_allclose(points.points().std, 0.5e-3 / np.sqrt(3))


A, B, FAR = Circle(0, 0, 1), Circle(0.8, 0, 1), Circle(5, 0, 1)
NAN = float("nan")


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        (
            {"circles": {1: A, 2: Circle(5, 0, -1)}},
            "circles.2.diameter: must be a positive number, not -1",
        ),
        (
            {"circles": {1: A, 2: Circle(5, 0, 0)}},
            "circles.2.diameter: must be a positive number, not 0",
        ),
        ({"circles": {1: A, 2: Circle(NAN, 0, 1)}}, "circles.2.x: must be finite, not nan"),
        (
            {"circles": {1: A, 2: Circle(5, float("inf"), 1)}},
            "circles.2.y: must be finite, not inf",
        ),
        (
            {"circles": {1: A, 2: B}},
            "circles: circles 1 and 2 overlap: their centers are 0.8 m apart, which must be more "
            "than the sum of their radii",
        ),
        (
            {"circles": {1: Circle(0, 0, 4), 2: B}},
            "circles: circles 1 and 2 lie one inside the other: their centers are 0.8 m apart, "
            "which must be more than the sum of their radii",
        ),
        (
            {"circles": {1: A, 2: Circle(5, 0, 1, "frnt")}},
            "circles.2.plane: there is no plane frnt; did you mean front? Valid: front",
        ),
        (
            {"circles": {1: A, 2: FAR}, "accuracy": -1},
            "accuracy: must be zero or a positive number, not -1",
        ),
        (
            {"circles": {1: A, 2: FAR}, "planes": {"front": Plane(normal=[0, 0, 0])}},
            "planes.front.normal: must not be zero",
        ),
        (
            {"circles": {1: A, 2: FAR}, "planes": {"front": Plane(normal=[-2, 0, 0])}},
            "planes.front.normal: must not be along the object's x axis, whose projection is the "
            "plane's own x axis",
        ),
        (
            {"circles": {1: A, 2: FAR}, "planes": {"front": Plane(origin=[0, 0])}},
            "planes.front.origin: must be three numbers, not 2",
        ),
        (
            {"circles": {1: A, 2: FAR}, "planes": {"front": Plane(normal=[0, NAN, 1])}},
            "planes.front.normal: must be finite, not nan",
        ),
        (
            {"circles": {1: A, 2: FAR}, "pairs": ["1-2", "1-9"]},
            "pairs[1]: 1-9 names circle 9; there are 1, 2",
        ),
        ({"circles": {1: A, 2: FAR}, "pairs": ["1-1"]}, "pairs[0]: 1-1 pairs a circle with itself"),
        (
            {"circles": {1: A, 2: FAR}, "pairs": ["1-2", "2-1"]},
            "pairs[1]: 2-1 is listed twice; its points would be counted twice",
        ),
        (
            {"circles": {1: A, 2: FAR}, "pairs": ["1+2"]},
            "pairs[0]: must be two circle numbers such as 1-2, not '1+2'",
        ),
        (
            {
                "circles": {1: A, 2: FAR, 3: Circle(0, 0, 1, "back")},
                "planes": {"front": Plane(), "back": Plane(origin=[0, 0, -1])},
                "pairs": ["1-2", "1-3"],
            },
            "pairs[1]: 1-3 pairs circles of different planes, which have no bitangents",
        ),
        ({"circles": {1: A}}, "circles: bitangents need two circles on one plane"),
        ({}, "circles: bitangents need two circles on one plane"),
    ],
)
def test_refused_circles(fields, message):
    with pytest.raises(ConfigError) as error:
        Circles(**fields)
    assert str(error.value) == message


def test_circles_of_different_planes_may_cover_each_other():
    planes = {"front": Plane(), "raised": Plane(origin=[0, 0, 1])}
    raised = {3: Circle(0, 0, 1, "raised"), 4: Circle(5, 0, 1, "raised")}
    accept(Circles(circles={1: A, 2: FAR, **raised}, planes=planes))


def test_all_problems_are_told_at_once():
    with pytest.raises(ConfigError) as error:
        Circles(circles={1: A, 2: B, 3: Circle(NAN, 0, -1)}, pairs=["1-7"], accuracy=NAN)
    fields = [problem.field for problem in error.value.problems]
    assert fields == ["accuracy", "circles.3.x", "circles.3.diameter", "circles", "pairs[0]"]


def line(*along):
    return {n: FiducialPoint(*(n * v + 1 for v in along)) for n in range(1, 6)}


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        (
            {"fiducials": line(0.1, 0.3, -0.7)},
            "fiducials: all 5 points lie on one line; at least one must stand beside it",
        ),
        (
            {"fiducials": {**line(1, 0, 0), 6: FiducialPoint(2, 1, 1)}},
            "fiducials.6: stands where point 1 stands; "
            "fiducials: all 6 points lie on one line; at least one must stand beside it",
        ),
        (
            {
                "fiducials": {
                    1: FiducialPoint(1, 1, 1),
                    2: FiducialPoint(1, 1, 1),
                    3: FiducialPoint(2, 1, 1),
                    4: FiducialPoint(1, 2, 1),
                }
            },
            "fiducials.2: stands where point 1 stands",
        ),
        (
            {"fiducials": {1: FiducialPoint(0, 0, 0), 2: FiducialPoint(1, 0, 0)}},
            "fiducials: a pose needs three points or more, not 2",
        ),
        (
            {"fiducials": {**line(1, 0, 0), 7: FiducialPoint(0, NAN, 0)}},
            "fiducials.7: must be finite, not nan",
        ),
        (
            {"fiducials": {**line(1, 0, 0), 7: FiducialPoint(0, 5, 0)}, "accuracy": -0.1},
            "accuracy: must be zero or a positive number, not -0.1",
        ),
    ],
)
def test_refused_points(fields, message):
    with pytest.raises(ConfigError) as error:
        FiducialPoints(**fields)
    assert str(error.value) == message


def test_a_point_beside_the_line_is_enough():
    accept(FiducialPoints(fiducials={**line(0.1, 0.3, -0.7), 6: FiducialPoint(1.0, 1.1, 1.0)}))
