"""Which ellipse is which circle, whatever the roll, the mirroring or the order of the circles."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from sldvexp.errors import UserError
from sldvexp.geometry import Ellipse, fit_ellipse
from sldvexp.image.matching import bitangent_images, match_circles
from sldvexp.targets import Circle, Circles, Plane
from sldvexp.units import LengthUnit

Make = Callable[..., Any]
#: What swapped and inverted mirrors do to the image, and whether that mirrors it.
WIRINGS = {
    "right": (np.array([[1.0, 0.0], [0.0, 1.0]]), False),
    "swapped": (np.array([[0.0, 1.0], [1.0, 0.0]]), True),
    "up-down inverted": (np.array([[-1.0, 0.0], [0.0, 1.0]]), True),
    "left-right inverted": (np.array([[1.0, 0.0], [0.0, -1.0]]), True),
    "both inverted": (np.array([[-1.0, 0.0], [0.0, -1.0]]), False),
}
STD = 0.2


def images(
    target: Circles,
    view: Any,
    order: Sequence[int],
    wiring: np.ndarray | None = None,
    rng: np.random.Generator | None = None,
) -> list[Ellipse]:
    """Ellipses of the circles in this order, with edge noise if there is a generator."""
    found = []
    for number in order:
        edge = view.edge(target, number) @ (np.eye(2) if wiring is None else wiring).T
        noise = 0.0 if rng is None else STD * rng.normal(size=edge.shape)
        found.append(fit_ellipse(edge + noise, STD).ellipse)
    return found


@pytest.mark.one_in(8)
@pytest.mark.parametrize("wiring", WIRINGS)
@pytest.mark.parametrize("plane", ["one", "two"])
@pytest.mark.parametrize("rolls", [2, pytest.param(6, marks=pytest.mark.whole)])
def test_roll_order_and_mirroring_are_found(
    plane: str, wiring: str, rolls: int, view: Make, figure_4_1: Circles, two_planes: Circles
) -> None:
    target = figure_4_1 if plane == "one" else two_planes
    matrix, mirrored = WIRINGS[wiring]
    rng = np.random.default_rng(1)
    for roll in np.linspace(-3.0, 3.0, rolls):
        tilt = tuple(rng.uniform(-0.6, 0.6, 2))
        order = rng.permutation(sorted(target.circles)).tolist()
        found = images(target, view(roll=roll, tilt=tilt), order, matrix, rng)
        match = match_circles(target, found)
        assert {n: order[k] for n, k in match.ellipse.items()} == {n: n for n in order}
        assert match.mirrored is mirrored
        assert match.residual < 1.5
        assert match.runner_up > 10 * match.residual


@pytest.mark.parametrize("wiring", WIRINGS)
def test_points_of_figure_4_1_are_found_in_the_image(
    wiring: str, view: Make, figure_4_1: Circles
) -> None:
    """Off by the conic model's error alone: up to 0.3 step at 1.7 m, never none."""
    matrix, _ = WIRINGS[wiring]
    order, where = [3, 1, 4, 2], view(aside=(0.0, 0.0))
    found = images(figure_4_1, where, order, matrix)
    match = match_circles(figure_4_1, found)
    points, _ = bitangent_images(found, match, figure_4_1.selected_pairs())
    sixteen = points[:, :2].swapaxes(1, 2).reshape(16, 2)
    error = sixteen - where.dac(figure_4_1.points().position) @ matrix.T
    assert 0.02 < np.linalg.norm(error, axis=1).max() < 0.3
    pairs = [(a, b) for a in range(1, 5) for b in range(a + 1, 5)]
    all_48 = bitangent_images(found, match, pairs).points.reshape(48, 2)
    error = all_48 - where.dac(figure_4_1.all_bitangents().position) @ matrix.T
    assert 0.02 < np.linalg.norm(error, axis=1).max() < 0.3


@pytest.mark.whole
@pytest.mark.parametrize("wiring", ["right", pytest.param("swapped", marks=pytest.mark.long)])
def test_covariance_of_the_points_is_that_of_repeats(
    wiring: str, view: Make, figure_4_1: Circles
) -> None:
    matrix, _ = WIRINGS[wiring]
    rng = np.random.default_rng(2)
    count, order, where = 60, [3, 1, 4, 2], view()
    exact = images(figure_4_1, where, order, matrix)
    match = match_circles(figure_4_1, exact)
    pairs = figure_4_1.selected_pairs()
    stated = bitangent_images(exact, match, pairs).covariance
    deviation = np.sqrt(np.diag(stated.reshape(64, 64)))
    drawn = [
        bitangent_images(images(figure_4_1, where, order, matrix, rng), match, pairs).points
        for _ in range(count)
    ]
    spread = np.std(drawn, axis=0).ravel()
    assert np.all(np.abs(spread / deviation - 1.0) < 4.5 / np.sqrt(2 * count))
    assert deviation.max() < 0.25


@pytest.mark.one_in(3)
@pytest.mark.parametrize("wiring", WIRINGS)
def test_covariance_follows_the_mirroring(wiring: str, view: Make, figure_4_1: Circles) -> None:
    matrix, _ = WIRINGS[wiring]
    pairs = figure_4_1.selected_pairs()
    straight = images(figure_4_1, view(), [1, 2, 3, 4])
    turned = images(figure_4_1, view(), [1, 2, 3, 4], matrix)
    here, there = (
        bitangent_images(found, match_circles(figure_4_1, found), pairs)
        for found in (straight, turned)
    )
    assert there.points == pytest.approx(here.points @ matrix.T, abs=1e-6)
    expected = np.einsum("xi,pleiqmfj,yj->plexqmfy", matrix, here.covariance, matrix)
    assert there.covariance == pytest.approx(expected, abs=1e-9)


def target_of(circles: dict[int, Circle], planes: dict[str, Plane] | None = None) -> Circles:
    planes = {"front": Plane()} | (planes or {})
    return Circles(unit=LengthUnit.inch, circles=circles, planes=planes)


def square(diameters: Sequence[float]) -> dict[int, Circle]:
    corners = [(2.5, 2.5), (8.5, 2.5), (8.5, 8.5), (2.5, 8.5)]
    return {
        n: Circle(x, y, d)
        for n, ((x, y), d) in enumerate(zip(corners, diameters, strict=True), start=1)
    }


@pytest.mark.parametrize(
    ("circles", "says"),
    [
        (
            square([0.8] * 4),
            r"looks the same in two ways: the ellipses fit its circles to [\d.]+ steps rms, and to "
            r"[\d.]+ if circles .* \(a ratio of 1[\d.]*, where 2 times as much and 0.6 steps "
            r"are needed\); a circle of another diameter, or one moved off the symmetric place, "
            r"would tell the two apart",
        ),
        (
            square([0.8, 1.2, 0.8, 1.6]),
            r"if circles 1, 3 change places and the image is mirrored \(a ratio of 1",
        ),
        (
            {1: Circle(3, 5, 0.8), 2: Circle(8, 5, 1.2)},
            r"if the image is mirrored \(a ratio of 1",
        ),
        (
            {1: Circle(3, 3, 0.8), 2: Circle(8, 3, 0.8), 3: Circle(5.5, 9, 1.4)},
            r"if circles 1, 2 change places and the image is mirrored",
        ),
    ],
    ids=["square", "diagonal", "two", "isosceles"],
)
def test_symmetric_objects_are_ambiguous(circles: dict[int, Circle], says: str, view: Make) -> None:
    target = target_of(circles)
    found = images(target, view(), sorted(circles), rng=np.random.default_rng(3))
    with pytest.raises(UserError, match=says):
        match_circles(target, found)


def test_different_diameters_break_the_symmetry(view: Make) -> None:
    """A tenth of an inch on one of four circles, and another on its neighbour."""
    target = target_of(square([0.8, 0.8, 0.9, 1.0]))
    match = match_circles(target, images(target, view(), [4, 2, 3, 1]))
    assert match.ellipse == {1: 3, 2: 1, 3: 2, 4: 0}
    assert match.runner_up > 2 * match.residual


def test_two_circles_need_to_be_told_whether_the_image_is_mirrored(view: Make) -> None:
    target = target_of({1: Circle(3, 5, 0.8), 2: Circle(8, 5, 1.2)})
    found = images(target, view(), [2, 1])
    for mirrored in (False, True):
        match = match_circles(target, found, mirrored)
        assert (match.ellipse, match.mirrored) == ({1: 1, 2: 0}, mirrored)


def test_many_circles_on_a_plane_are_matched_without_trying_all_orders(view: Make) -> None:
    rng = np.random.default_rng(4)
    places = [(x, y) for x in (1.5, 4.2, 6.8, 9.5) for y in (2.0, 5.5, 9.0)]
    circles = {
        n: Circle(x + rng.uniform(-0.6, 0.6), y + rng.uniform(-0.6, 0.6), rng.uniform(0.7, 1.0))
        for n, (x, y) in enumerate(places, start=1)
    }
    target = target_of(circles)
    order = rng.permutation(sorted(circles)).tolist()
    match = match_circles(target, images(target, view(), order))
    assert {n: order[k] for n, k in match.ellipse.items()} == {n: n for n in order}


@pytest.mark.one_in(3)
@pytest.mark.parametrize("wiring", WIRINGS)
def test_planes_with_the_same_circles_are_told_apart_by_their_depth(
    wiring: str, view: Make
) -> None:
    """A camera that sees space inside out would exchange the two planes."""
    matrix, mirrored = WIRINGS[wiring]
    places = {1: (0.0, 0.0, 0.8), 2: (3.0, 0.5, 0.9), 3: (1.0, 4.0, 1.0)}
    near = {n: Circle(x, y, d) for n, (x, y, d) in places.items()}
    far = {n + 3: Circle(x, y, d, "far") for n, (x, y, d) in places.items()}
    target = target_of(near | far, {"far": Plane([5.0, 5.0, -4.0], [0.0, 0.0, 1.0])})
    order = [5, 1, 4, 2, 6, 3]
    found = images(target, view(), order, matrix, np.random.default_rng(6))
    match = match_circles(target, found)
    assert {n: order[k] for n, k in match.ellipse.items()} == {n: n for n in order}
    assert match.mirrored is mirrored


@pytest.mark.one_in(6)
@pytest.mark.parametrize("wiring", WIRINGS)
def test_two_equal_circles_on_each_of_two_planes_are_told_apart_by_a_straight_look(
    wiring: str, view: Make
) -> None:
    """Each pair could change places for a camera whose image is oblique to its line of sight."""
    matrix, mirrored = WIRINGS[wiring]
    low = {1: Circle(1.2, 1.2, 1.6), 3: Circle(5.9, 8.9, 1.6)}
    high = {2: Circle(8.7, 2.4, 1.6, "high"), 4: Circle(1.2, 8.5, 1.6, "high")}
    target = target_of(low | high, {"high": Plane([0.0, 0.0, 4.0], [0.0, 0.0, 1.0])})
    rng = np.random.default_rng(7)
    for roll in np.linspace(-3.0, 3.0, 6):
        order = rng.permutation(sorted(target.circles)).tolist()
        tilt = tuple(rng.uniform(-0.35, 0.35, 2))
        found = images(target, view(roll=roll, tilt=tilt), order, matrix, rng)
        match = match_circles(target, found)
        assert {n: order[k] for n, k in match.ellipse.items()} == {n: n for n in order}
        assert match.mirrored is mirrored


def test_one_circle_alone_on_its_plane_takes_the_ellipse_that_is_left(
    view: Make, figure_4_1: Circles
) -> None:
    raised = {"raised": Plane([0.0, 0.0, 2.0], [0.0, 0.0, 1.0])}
    target = target_of(figure_4_1.circles | {9: Circle(5.0, 5.0, 0.9, "raised")}, raised)
    match = match_circles(target, images(target, view(), [2, 9, 1, 4, 3]))
    assert match.ellipse == {1: 2, 2: 0, 3: 4, 4: 3, 9: 1}


def test_two_circles_alone_on_their_planes_are_refused(view: Make, figure_4_1: Circles) -> None:
    planes = {f"p{k}": Plane([0.0, 0.0, float(k)], [0.0, 0.0, 1.0]) for k in (1, 2)}
    alone = {8: Circle(5.0, 5.0, 0.9, "p1"), 9: Circle(5.0, 3.0, 0.9, "p2")}
    target = target_of(figure_4_1.circles | alone, planes)
    with pytest.raises(UserError, match="circles 8, 9 are each alone on their plane"):
        match_circles(target, images(target, view(), [1, 2, 3, 4, 8, 9]))


def test_a_missing_ellipse_is_refused(view: Make, figure_4_1: Circles) -> None:
    with pytest.raises(
        UserError, match="the calibration object has 4 circles, but 3 ellipses were found"
    ):
        match_circles(figure_4_1, images(figure_4_1, view(), [1, 2, 3]))


def test_another_object_is_refused(view: Make, figure_4_1: Circles) -> None:
    other = target_of(square([0.8, 1.2, 1.6, 2.2]))
    with pytest.raises(
        UserError,
        match=r"not those of the calibration object: the best assignment leaves [\d.]+ steps rms "
        r"at the bitangent points, more than 20 % of the smallest semi-axis",
    ):
        match_circles(other, images(figure_4_1, view(), [1, 2, 3, 4]))


def test_the_same_circle_scanned_twice_is_named(view: Make, figure_4_1: Circles) -> None:
    with pytest.raises(UserError, match="not those of the calibration object"):
        match_circles(figure_4_1, images(figure_4_1, view(), [1, 2, 3, 3]))
