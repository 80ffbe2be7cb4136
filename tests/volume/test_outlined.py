"""Volumes of any outline: what the triangles cover, holes, and lines that cannot be."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.errors import ConfigError, UserError
from sldvexp.geometry import rotation_from_euler
from sldvexp.units import LengthUnit
from sldvexp.volume import Contour, OutlinedSurface

L_SHAPE = [[0.0, 0.0], [0.3, 0.0], [0.3, 0.1], [0.1, 0.1], [0.1, 0.2], [0.0, 0.2]]


def area(surface):
    a, b, c = np.moveaxis(surface.position[surface.triangles], 1, 0)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2


def test_triangles_cover_the_outline_and_leave_the_holes_out():
    made = OutlinedSurface(
        outline=Contour(L_SHAPE),
        holes={
            "round": Contour(center=[0.05, 0.15], radius=0.02),
            "slot": Contour([[0.15, 0.04], [0.25, 0.04], [0.25, 0.06], [0.15, 0.06]]),
        },
        spacing=0.01,
    )
    surface = made.surface()
    circle = 32 / 2 * 0.02**2 * np.sin(2 * np.pi / 32)
    assert area(surface) == pytest.approx(0.04 - circle - 0.002, rel=1e-9)
    middle = surface.position[surface.triangles].mean(axis=1)
    assert np.hypot(middle[:, 0] - 0.05, middle[:, 1] - 0.15).min() > 0.019
    made.prisms()


def test_normals_point_along_z_and_the_volume_stands_where_it_is_put():
    euler, center = [0.3, 0.7, -0.2], [100.0, 20.0, -30.0]
    outline = Contour(center=[10.0, 0.0], radius=50.0)
    made = OutlinedSurface(
        outline=outline, spacing=8.0, unit=LengthUnit.mm, center=center, euler=euler, thickness=4.0
    )
    prisms = made.prisms()
    rotation = rotation_from_euler(euler)
    own = (prisms.surface - 1e-3 * np.array(center)) @ rotation.T
    assert own[:, 2] == pytest.approx(0.0, abs=1e-12)
    assert np.hypot(own[:, 0] - 0.010, own[:, 1]).max() == pytest.approx(0.050)
    assert prisms.frame[:, 2] == pytest.approx(np.broadcast_to(rotation[2], (len(own), 3)))


def test_it_bends_to_a_cylinder():
    corners = [[-0.1, -0.05], [0.1, -0.05], [0.1, 0.05], [-0.1, 0.05]]
    surface = OutlinedSurface(outline=Contour(corners), radius=0.2).surface()
    x, _, z = surface.position.T
    assert np.hypot(x, z + 0.2) == pytest.approx(0.2)


def test_sides_are_followed_at_any_spacing():
    for spacing in (0.003, 0.01, 0.03):
        surface = OutlinedSurface(outline=Contour(L_SHAPE), spacing=spacing).surface()
        assert area(surface) == pytest.approx(0.04, rel=1e-9)


SQUARE = Contour([[0.0, 0.0], [0.1, 0.0], [0.1, 0.1], [0.0, 0.1]])


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        (
            {"outline": Contour([[0.0, 0.0], [0.1, 0.1], [0.1, 0.0], [0.0, 0.1]])},
            "outline: crosses itself at [0.05, 0.05] m; give its corners in order around it",
        ),
        ({"outline": Contour([[0.0, 0.0], [0.1, 0.0]])}, "outline: needs 3 corners or more"),
        ({"outline": Contour()}, "or the radius of a circle, not 0"),
        ({"outline": Contour(L_SHAPE, radius=0.1)}, "has corners and a radius: give one of them"),
        ({"outline": Contour(radius=-0.1)}, "outline.radius: must be a positive number"),
        ({"holes": {"a": Contour(center=[0.1, 0.05], radius=0.02)}}, "holes.a: crosses outline"),
        ({"holes": {"a": Contour(center=[0.3, 0.05], radius=0.02)}}, "holes.a: lies outside"),
        (
            {
                "holes": {
                    "a": Contour(center=[0.05, 0.05], radius=0.02),
                    "b": Contour(center=[0.07, 0.05], radius=0.02),
                }
            },
            "holes.b: crosses holes.a",
        ),
        ({"spacing": 0.06}, "spacing: must be 0.00045 m or more"),
        ({"spacing": 1e-5}, "or there are more than 50000 nodes"),
        ({"spacing": 0.0}, "spacing: must be a positive number, not 0.0"),
        ({"radius": 0.01}, "radius: must be finite and beyond +-0.031831 m"),
        ({"outline": Contour([[0.0, 0.0], [0.1], [0.1, 0.1]])}, "corners[1]: must be two numbers"),
        ({"outline": Contour([[0, 0], "a", [0.1, 0.1]])}, "corners[1]: must be two numbers"),
        ({"outline": Contour([[0, 0], [1, np.nan], [0.1, 0.1]])}, "corners[1]: must be finite"),
    ],
)
def test_no_such_outline(settings, told):
    with pytest.raises(ConfigError) as refused:
        OutlinedSurface(**({"outline": SQUARE} | settings))
    assert told in str(refused.value)


def test_a_spacing_that_cannot_follow_what_is_narrow_is_refused():
    holes = {
        "square": Contour([[0.03, 0.03], [0.07, 0.03], [0.07, 0.07], [0.03, 0.07]]),
        "beside": Contour(center=[0.0725, 0.04], radius=0.002),
    }
    with pytest.raises(UserError, match="choose a smaller spacing"):
        OutlinedSurface(outline=SQUARE, holes=holes, spacing=0.03).surface()
    fine = OutlinedSurface(outline=SQUARE, holes=holes, spacing=0.002).surface()
    circle = 32 / 2 * 0.002**2 * np.sin(2 * np.pi / 32)
    assert area(fine) == pytest.approx(0.01 - 0.0016 - circle, rel=1e-9)
