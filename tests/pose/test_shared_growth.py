"""Edges of a circle that an uneven motion's growth moves together: poses and their bounds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sldvexp.image import fit_circle
from sldvexp.session.circles import edges_of, edges_to_dataset


def growing(edges, size):
    """Let two errors of the growth displace a circle's edges, in standard errors of an edge."""
    return replace(edges, growth_std=size * edges.std[:, None] * edges.direction)


def displaced(edges, rng):
    """Draw the two errors."""
    ahead = edges.growth_std @ rng.normal(size=2)
    return replace(edges, position=edges.position + ahead[:, None] * edges.direction)


def test_edges_keep_what_they_share_in_a_run(edge_lab):
    (edges,) = edge_lab(views=1).edges(np.random.default_rng(0)).values()
    circles = [growing(e, 0.5) for e in edges.values()]
    read = edges_of(edges_to_dataset(circles))
    for one, other in zip(circles, read, strict=True):
        assert other.growth_std == pytest.approx(one.growth_std)


def test_residuals_without_what_edges_share_have_the_inverse_of_their_covariance(edge_lab):
    (points,) = edge_lab(views=1).points(np.random.default_rng(0))
    count = len(points.std)
    some = np.random.default_rng(1).normal(size=(count, 2))
    shared = replace(points, growth=some)
    outwards = np.where(np.arange(count) % 3, 1.0, -1.0)
    root = shared.decorrelated(np.eye(count), outwards)
    moved = outwards[:, None] * some
    alike = points.circle[:, None] == points.circle
    covariance = np.eye(count) + alike * (moved @ moved.T)
    assert root @ root.T == pytest.approx(np.linalg.inv(covariance), abs=1e-9)
    none = points.decorrelated(np.eye(count), outwards)
    assert np.array_equal(none, np.eye(count))


def test_an_ellipse_has_what_its_edges_share(edge_lab):
    """Displaced by d along both axes it errs by d more."""
    (edges,) = edge_lab(views=1).edges(np.random.default_rng(0)).values()
    alone, shared = (fit_circle(growing(edges[1], k))[0].ellipse.covariance for k in (0.0, 0.5))
    std = float(np.median(edges[1].std))
    more = (shared[:2, :2] - alone[:2, :2]) / std**2
    assert more == pytest.approx(0.25 * np.eye(2), abs=0.01)


@pytest.mark.whole
def test_bounds_of_poses_have_what_edges_share(edge_lab):
    """Left out of the equations it makes the mean square four times as large."""
    lab = edge_lab(views=2)
    squares = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        lab.machine(rng)
        made = {
            n: {k: displaced(growing(e, 0.5), rng) for k, e in own.items()}
            for n, own in lab.edges(rng).items()
        }
        lab.edges = lambda _, made=made: made
        found = lab.solve(lab.points(None))
        del lab.edges
        for pose, name, own in zip(found.poses, lab.names, found.joint.of_views(), strict=True):
            error = pose.origin - lab.truth(name)[1]
            squares.append(error**2 / np.diag(own)[3:6])
    # Three coordinates of two views hang together: at least one degree of freedom a view.
    assert np.mean(squares) == pytest.approx(1.0, abs=4.5 * np.sqrt(2 / 40))
