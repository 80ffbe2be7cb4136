"""Where a wide spot sees the edge of a circle, and the circle without the spot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr

from sldvexp.geometry import conic
from sldvexp.image import ScanLines, fit_circle, profile_edges
from sldvexp.image.edge_detection import FINE_WINDOW
from sldvexp.image.spot import seen_edges, spot_of_widths

#: Larger semi-axis, steps; the tip of a circle seen at an angle has the radius a cos^2.
LARGER = 1000.0
TILTS = [0.0, 60.0, 70.0, 75.0]


def ellipse(tilt: float, turn: float = 0.4) -> np.ndarray:
    axes = LARGER * np.array([1.0, np.cos(np.radians(tilt))])
    turned = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    shape = turned * axes**2 @ turned.T
    return np.array([-900.3, 1100.6, shape[0, 0], shape[1, 1], shape[0, 1]])


def light_inside(numbers: np.ndarray, width: float, position: np.ndarray) -> np.ndarray:
    """Part of a round spot inside an ellipse: chords along x exact, summed over y."""
    y = np.linspace(-7, 7, 801)
    inverse = np.linalg.inv(conic.shape_matrix(numbers))
    away = position - numbers[:2]
    row = away[..., 1, None] + width * y
    middle = -inverse[0, 1] * row / inverse[0, 0]
    square = 1.0 - np.linalg.det(inverse) / inverse[0, 0] * row**2
    half = np.sqrt(np.maximum(square, 0.0) / inverse[0, 0])
    first, last = ((middle + s * half - away[..., 0, None]) / width for s in (-1.0, 1.0))
    weight = np.exp(-0.5 * y**2)
    return np.asarray((ndtr(last) - ndtr(first)) @ weight / weight.sum())


def scanned(
    numbers: np.ndarray,
    width: float,
    noise: float,
    rng: np.random.Generator,
    around: np.ndarray | None = None,
) -> ScanLines:
    """Fine lines of 25 whole steps across the edge, or another ellipse, as a session lays them."""
    lines = 44
    turn = 2 * np.pi * (np.arange(lines) + 0.5) / lines
    points, normals = conic.boundary(numbers if around is None else around, turn)
    stride = max(1, int(np.ceil(2.5 * width / 12)))
    ahead = stride * normals / np.abs(normals).max(axis=-1, keepdims=True)
    position = np.round(points[:, None] + (np.arange(25) - 12)[:, None] * ahead[:, None])
    motion = light_inside(numbers, width, position) + noise * rng.normal(size=(lines, 25))
    std = np.full(motion.shape, max(noise, 1e-4))
    return ScanLines(motion, std, position, np.zeros(motion.shape, bool))


def tip(numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The ellipse's sharper end and the direction outwards."""
    axes, directions = conic.principal_axes(numbers)
    out = directions[:, 0]
    return (numbers[:2] + axes[0] * out)[None], out[None]


@pytest.mark.parametrize("tilt", TILTS)
def test_a_small_spot_sees_half_the_motion_inside_by_half_the_curvature_times_its_square(
    tilt: float,
) -> None:
    """The remainder of first order falls with the square of the width."""
    numbers = ellipse(tilt)
    place, out = tip(numbers)
    bend = float(conic.curvature(out, numbers)[0])
    remainders = []
    for part in (0.05, 0.1, 0.2):
        width = part / bend
        offset, widening = seen_edges(numbers, width**2 * np.eye(2), place, out)
        remainders.append(1.0 + offset[0] / (bend * width**2 / 2.0))
        assert widening[0] == pytest.approx(1.0 + part**2 / 4.0, abs=part**2 / 10.0)
    assert 0 < abs(remainders[0]) < 0.002
    assert remainders[1] / remainders[0] == pytest.approx(4.0, rel=0.2)
    assert remainders[2] / remainders[1] == pytest.approx(4.0, rel=0.2)


def test_the_spot_is_told_by_the_widths_of_edges_all_around() -> None:
    turn = np.linspace(0, 2 * np.pi, 44, endpoint=False)
    normal = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    light = np.array([[30.0, 4.0], [4.0, 25.0]])
    width = np.sqrt(np.einsum("ni,ij,nj->n", normal, light, normal))
    std = np.full(44, 0.05)
    assert spot_of_widths(width, std, normal) == pytest.approx(light, rel=1e-3)
    width[[3, 20]] *= 5.0
    assert spot_of_widths(width, std, normal) == pytest.approx(light, rel=1e-2)
    few = spot_of_widths(width[[0, 1]], std[[0, 1]], normal[[0, 1]])
    assert np.all(np.abs(np.linalg.eigvalsh(few) / 30.0 - 1.0) < 0.3)


@pytest.mark.one_in(9)
@pytest.mark.parametrize("tilt", TILTS)
@pytest.mark.parametrize("part", [0.03, 0.3, 0.6, 0.9])
def test_the_ellipse_without_the_spot(tilt: float, part: float) -> None:
    """To a hundredth of the shift at the tip; first order alone leaves a tenth to two thirds."""
    numbers = ellipse(tilt)
    true = conic.Ellipse(numbers, np.eye(5))
    larger, smaller = true.semi_axes
    width = part * smaller**2 / larger
    if width > smaller / 3.0:
        pytest.skip("the spot looks over the circle and beyond")
    lines = scanned(numbers, width, 0.0, np.random.default_rng(0))
    edges = profile_edges(lines, 1, FINE_WINDOW)
    found = fit_circle(edges)[0].ellipse.semi_axes
    shift = part * width / 2.0
    assert found == pytest.approx(true.semi_axes, abs=0.02 * shift + 0.03)


def z_scores(tilt: float, part: float, seeds: int) -> tuple[np.ndarray, np.ndarray]:
    """Centre and semi-axes, errors over what is stated, (seed, 4); reduced chi squares."""
    scores, reduced = [], []
    for seed in range(seeds):
        numbers = ellipse(tilt, 0.3 + 0.1 * seed)
        true = conic.Ellipse(numbers, np.eye(5))
        width = part * true.semi_axes[1] ** 2 / LARGER
        lines = scanned(numbers, width, 0.005, np.random.default_rng(seed))
        fit, _ = fit_circle(profile_edges(lines, 1, FINE_WINDOW))
        std = [*np.sqrt(np.diag(fit.ellipse.covariance)[:2]), *fit.ellipse.semi_axes_std]
        error = [*fit.ellipse.centre - true.centre, *fit.ellipse.semi_axes - true.semi_axes]
        scores.append(np.array(error) / std)
        reduced.append(fit.chi_square / fit.dof)
    return np.array(scores), np.array(reduced)


def check(scores: np.ndarray, reduced: np.ndarray) -> None:
    """The mean square of z is one within 4.5 of its standard deviations."""
    count = len(scores)
    assert np.all(np.abs(np.mean(scores**2, axis=0) - 1.0) < 4.5 * np.sqrt(2.0 / count))
    assert np.mean(reduced) == pytest.approx(1.0, abs=0.2 + 4.5 * np.sqrt(2 / 39 / count))


@pytest.mark.whole
@pytest.mark.parametrize(("tilt", "part"), [(60.0, 0.3), (70.0, 0.6)])
def test_bounds_hold_with_a_wide_spot(tilt: float, part: float) -> None:
    check(*z_scores(tilt, part, 12))


@pytest.mark.long
@pytest.mark.parametrize(("tilt", "part"), [(0.0, 0.1), (60.0, 0.3), (60.0, 0.6), (70.0, 0.8)])
def test_bounds_hold_with_a_wide_spot_in_many_scans(tilt: float, part: float) -> None:
    check(*z_scores(tilt, part, 200))


@pytest.mark.whole
@pytest.mark.parametrize("tilt", [60.0, 70.0])
@pytest.mark.parametrize("wide", [0.42, 0.5, 0.6, 0.65])
def test_a_spot_too_wide_for_its_circle_has_its_error_in_the_bounds(
    wide: float, tilt: float
) -> None:
    """As noise makes them, bounds are up to a hundred times too small."""
    scores, _ = z_scores(tilt, wide / np.cos(np.radians(tilt)), 6)
    assert np.all(np.mean(scores**2, axis=0) < 1.0 + 4.5 * np.sqrt(2.0 / 6))


def test_lines_that_lie_beside_the_circle_see_it_where_it_is() -> None:
    """Lines of rough ellipses cross the edge at an angle and beside their middle."""
    numbers = ellipse(71.0)
    true = conic.Ellipse(numbers, np.eye(5))
    width = 0.9 * true.semi_axes[1] ** 2 / LARGER
    rough = numbers + np.array([0.0, 0.0, *(0.1 * numbers[2:])])
    lines = scanned(numbers, width, 0.0, np.random.default_rng(0), around=rough)
    found = fit_circle(profile_edges(lines, 1, FINE_WINDOW))[0].ellipse
    assert found.centre == pytest.approx(true.centre, abs=0.1)
    assert found.semi_axes == pytest.approx(true.semi_axes, abs=0.1)


def test_edges_that_are_wrong_are_still_found() -> None:
    numbers = ellipse(70.0)
    lines = scanned(numbers, 60.0, 0.005, np.random.default_rng(2))
    edges = profile_edges(lines, 1, FINE_WINDOW)
    position = edges.position.copy()
    position[[5, 17, 30]] += 40.0 * edges.direction[[5, 17, 30]]
    width = edges.width.copy()
    width[[8, 25]] *= 3.0
    spoiled = replace(edges, position=position, width=width)
    fit, _ = fit_circle(spoiled)
    assert set(np.flatnonzero(~fit.used)) == {5, 17, 30}
    clean = fit_circle(edges)[0].ellipse.semi_axes
    assert fit.ellipse.semi_axes == pytest.approx(clean, abs=1.0)


def test_an_edge_that_a_line_does_not_resolve_leaves_the_others_their_spot() -> None:
    lines = scanned(ellipse(60.0), 60.0, 0.005, np.random.default_rng(2))
    edges = profile_edges(lines, 1, FINE_WINDOW)
    width = edges.width.copy()
    width[7] = 0.0
    fit, _ = fit_circle(replace(edges, width=width))
    clean = fit_circle(edges)[0].ellipse.semi_axes
    assert fit.ellipse.semi_axes == pytest.approx(clean, abs=0.5)
