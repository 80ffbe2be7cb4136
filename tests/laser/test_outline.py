"""Outline of a part as the mirrors see it."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.errors import UserError
from sldvexp.geometry import rotation_from_vector, rotation_towards
from sldvexp.laser import PartOutline, TwoMirror, project

LASER = TwoMirror(mirror_offset=0.03)
ORIGIN = np.array([0.5, 0.3, 1.2])
ROTATION = rotation_towards(ORIGIN, [0.02, 0.01, 0.0])


def plate(hole=False):
    """A plate of 0.3 by 0.2 m; with a hole, or whole."""
    outer = np.array([[-0.15, -0.1], [0.15, -0.1], [0.15, 0.1], [-0.15, 0.1]])
    inner = np.array([[-0.05, -0.04], [0.06, -0.04], [0.06, 0.03], [-0.05, 0.03]])
    corners = np.concatenate([outer, inner])
    if hole:
        ring = [[k, (k + 1) % 4, 4 + (k + 1) % 4] for k in range(4)]
        ring += [[k, 4 + (k + 1) % 4, 4 + k] for k in range(4)]
    else:
        ring = [[0, 1, 2], [0, 2, 3]]
    return PartOutline.from_mesh(np.pad(corners, ((0, 0), (0, 1))), np.array(ring))


def box():
    """A box of 12 triangles."""
    signs = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    triangles = [t for a, b, c, d in faces for t in ([a, b, c], [a, c, d])]
    return PartOutline.from_mesh((signs - 0.5) * [0.3, 0.2, 0.1], np.array(triangles))


def steps(points, rotation=ROTATION, origin=ORIGIN):
    return project((np.asarray(points) - origin) @ rotation.T, LASER.mirror_offset) / LASER.step


@pytest.mark.parametrize("part", [plate(), plate(hole=True), box()], ids=["plate", "hole", "box"])
def test_places_on_the_outline_have_the_part_on_one_side(part):
    point, outward = part.outline(ROTATION, ORIGIN, LASER, 90)
    inside = part.covers(point - outward, ROTATION, ORIGIN, LASER)
    outside = part.covers(point + outward, ROTATION, ORIGIN, LASER)
    assert inside.mean() > 0.97  # but next to corners
    assert outside.mean() < 0.03


def test_a_hole_has_an_outline_of_its_own():
    point, outward = plate(hole=True).outline(ROTATION, ORIGIN, LASER, 200)
    middle = steps([[0.005, -0.005, 0.0]])[0]
    inwards = np.sum(outward * (point - middle), axis=1) < 0
    assert 0.2 < inwards.mean() < 0.45


def test_edges_of_a_box_that_its_front_hides_or_holds_are_no_outline():
    part = box()
    middle = steps(part.position).mean(axis=0)
    angle = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    direction = np.stack([np.sin(angle), np.cos(angle)], axis=1)
    found = part.crossings(
        np.tile(middle, (40, 1)), direction, ROTATION, ORIGIN, LASER, 5000.0, nearest=12
    )
    ahead = found.along > 0
    # From within, every line leaves a convex body once ahead and once behind.
    assert np.bincount(found.line[ahead], minlength=40).tolist() == [1] * 40


def test_crossings_are_exact_and_so_are_their_derivatives():
    part = plate(hole=True)
    point, direction = part.outline(ROTATION, ORIGIN, LASER, 40)

    def along(rotation, origin):
        found = part.crossings(point, direction, rotation, origin, LASER, 20.0)
        place = np.full(len(point), np.nan)
        place[found.line] = found.along
        return place, found

    base, found = along(ROTATION, ORIGIN)
    assert np.nanmax(np.abs(base)) < 0.05  # a piece is straight, the edge is not quite
    jacobian = np.full((len(point), 6), np.nan)
    jacobian[found.line] = found.jacobian
    for k in range(6):
        step = np.zeros(6)
        step[k] = 1e-6
        moved = [
            along(rotation_from_vector(s * step[:3]) @ ROTATION, ORIGIN + s * step[3:])[0]
            for s in (1, -1)
        ]
        numeric = (moved[0] - moved[1]) / 2e-6
        both = np.isfinite(numeric)
        assert both.sum() > 30
        np.testing.assert_allclose(numeric[both], jacobian[both, k], rtol=1e-4, atol=2.0)


def test_a_mesh_wound_anyhow_has_the_same_outline():
    part = box()
    triangles = part.triangles.copy()
    triangles[::3] = triangles[::3, ::-1]
    mixed = PartOutline.from_mesh(part.position, triangles)
    for one, other in zip(
        part.outline(ROTATION, ORIGIN, LASER, 50),
        mixed.outline(ROTATION, ORIGIN, LASER, 50),
        strict=True,
    ):
        # Edges come in the same order.
        np.testing.assert_allclose(one, other, atol=1e-9)


def test_a_part_behind_the_instrument_has_no_outline():
    with pytest.raises(UserError, match="no outline of the part is before the instrument"):
        plate().outline(rotation_towards(ORIGIN, [1.0, 0.6, 2.4]), ORIGIN, LASER, 20)
