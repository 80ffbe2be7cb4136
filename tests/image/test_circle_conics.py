"""From scan lines to the conic of a circle, with the spot's size taken out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from sldvexp.errors import UserError
from sldvexp.geometry import conic, fit_ellipse
from sldvexp.image import fit_circle, gradient_edges, profile_edges
from sldvexp.image.edge_detection import COARSE_WINDOW, FINE_WINDOW
from sldvexp.image.pinhole import require_ellipse

Make = Callable[..., Any]
METHODS = {"gradient": gradient_edges, "profile": profile_edges}


@pytest.mark.parametrize("method", METHODS)
def test_coarse_lines_place_the_fine_ones(method: str, spot: Make) -> None:
    """Six edges on three lines, close enough for fine lines of 25 pixels around them."""
    scene = spot(noise=0.02)
    edges = METHODS[method](scene.scan(scene.across()), 2, COARSE_WINDOW)
    fit, _ = fit_circle(edges)
    points, _ = conic.boundary(fit.ellipse.parameters, np.linspace(0, 2 * np.pi, 44))
    distance, _ = conic.signed_distance(points, scene.ellipse)
    assert (len(edges.std), fit.dof) == (6, 1)
    assert np.abs(distance).max() < 8.0


@pytest.mark.one_in(6)
@pytest.mark.parametrize("repeats", [10, 25])
@pytest.mark.parametrize("width", [0.7, 1.5, 2.5])
def test_fine_lines_give_the_ellipse_within_its_stated_errors(
    width: float, repeats: int, spot: Make
) -> None:
    """The bias over the repeats is below a two-hundredth of a step, and chi square as expected."""
    scene = spot(width=width, noise=0.02, seed=1)
    scans = [scene.scan(scene.fine()) for _ in range(repeats)]
    fits = [fit_circle(profile_edges(scan, 1, FINE_WINDOW))[0] for scan in scans]
    true = conic.Ellipse(scene.ellipse, np.eye(5))
    place = np.array([[*f.ellipse.centre, *f.ellipse.semi_axes] for f in fits])
    error = place - np.array([*true.centre, *true.semi_axes])
    stated = np.array(
        [[*np.sqrt(np.diag(f.ellipse.covariance)[:2]), *f.ellipse.semi_axes_std] for f in fits]
    ).mean(axis=0)
    assert stated.max() < 0.025
    assert np.all(np.abs(error.mean(axis=0)) < 0.005 + 4.5 * stated / np.sqrt(repeats))
    assert np.all(np.abs(error.std(axis=0) / stated - 1.0) < 4.5 / np.sqrt(2 * repeats))
    reduced = np.mean([f.chi_square / f.dof for f in fits])
    assert reduced == pytest.approx(1.0, abs=0.1 + 4.5 * np.sqrt(2 / 39 / repeats))


def test_without_the_correction_a_spot_makes_the_circle_smaller(spot: Make) -> None:
    scene = spot(width=2.5, noise=0.001)
    edges = profile_edges(scene.scan(scene.fine()), 1, FINE_WINDOW)
    fit, moved = fit_circle(edges)
    raw = fit_ellipse(edges.position, edges.std, edges.direction)
    larger, smaller = fit.ellipse.semi_axes
    shrunk = fit.ellipse.semi_axes - raw.ellipse.semi_axes
    curvature = np.array([larger / smaller**2, smaller / larger**2])
    assert shrunk == pytest.approx(2.5**2 / 2 * curvature, rel=0.1)
    assert np.linalg.norm(moved.position - edges.position, axis=1).min() > 0.03


def test_wrong_edges_are_counted(spot: Make) -> None:
    scene = spot()
    edges = profile_edges(scene.scan(scene.fine()), 1, FINE_WINDOW)
    edges.position[[5, 17, 30]] += 4.0 * edges.direction[[5, 17, 30]]
    fit, _ = fit_circle(edges)
    assert np.flatnonzero(~fit.used).tolist() == [5, 17, 30]
    assert np.abs(fit.residual[fit.used]).max() < 0.15


def test_a_dead_speaker_is_named_with_what_was_seen(spot: Make) -> None:
    scene = spot()
    scene.ellipse = scene.ellipse + np.array([5000.0, 0, 0, 0, 0])
    lines = spot().fine()
    edges = profile_edges(scene.scan(lines, "circle 3"), 1, FINE_WINDOW)
    with pytest.raises(
        UserError,
        match=r"^circle 3: an ellipse needs 5 edge points or more, not 0 \(seen: 0 edges on 44 "
        r"scan lines; rejected 44 with too little contrast\)$",
    ):
        fit_circle(edges)


def test_half_a_circle_is_named_with_what_was_seen(spot: Make) -> None:
    scene = spot()
    edges = profile_edges(scene.scan(scene.fine()[:12], "circle 2"), 1, FINE_WINDOW)
    with pytest.raises(
        UserError,
        match=r"^circle 2: its 12 edge points, over \d+ deg of arc .* \(seen: 12 edges on 12 scan",
    ):
        fit_circle(edges)


def test_edges_that_make_no_ellipse_are_refused_before_they_are_freed_from_the_spot(
    spot: Make,
) -> None:
    scene = spot(width=2.5, noise=0.001)
    edges = profile_edges(scene.scan(scene.fine()), 1, FINE_WINDOW)
    require_ellipse(edges)
    line = replace(edges, position=edges.position * [1.0, 0.0])
    told = []
    for complain in (fit_circle, require_ellipse):
        with pytest.raises(UserError, match="no ellipse") as error:
            complain(line)
        told.append(str(error.value))
    assert told[0] == told[1]
