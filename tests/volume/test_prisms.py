"""Prisms and the samples in them, against what geometry says."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sldvexp.geometry import rotation_from_euler
from sldvexp.volume import (
    Diagonals,
    Grid,
    Prisms,
    SampleRule,
    SampleSettings,
    extruded,
    sample_positions,
    shape_matrix,
)
from sldvexp.volume.samples import sample_frames, triangle_points

few = settings(max_examples=25, deadline=None, derandomize=True)
length = st.floats(0.05, 2.0)
angle = st.floats(-3.0, 3.0)


@st.composite
def rules(draw):
    """Tensor products and lists of parameters."""
    if draw(st.booleans()):
        triangle, line = draw(st.sampled_from([1, 3, 6, 7, 12])), draw(st.integers(1, 4))
        return SampleSettings(triangle, line).rule()
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    points = draw(st.integers(1, 9))
    return SampleRule(
        np.column_stack([rng.dirichlet([1, 1, 1], points), rng.uniform(-1, 1, points)])
    )


@st.composite
def volumes(draw):
    """Grids of any pose, flat or curved."""
    radius = draw(st.none() | st.sampled_from([-1.5, 1.5]))
    return Grid(
        center=draw(st.lists(length, min_size=3, max_size=3)),
        euler=draw(st.lists(angle, min_size=3, max_size=3)),
        size=[draw(length), draw(length)],
        shape=[draw(st.integers(2, 6)), draw(st.integers(2, 6))],
        radius=radius,
        layers=draw(st.integers(2, 5)),
        thickness=draw(st.floats(0.01, 0.3)),
        offset=draw(st.floats(-0.2, 0.2)),
        diagonals=draw(st.sampled_from(Diagonals)),
    )


def prism_volumes(prisms: Prisms) -> np.ndarray:
    """Volume of every prism: its Jacobian is linear in xi, quadratic in zeta, and so exact."""
    corner = prisms.position[prisms.element]
    total = np.zeros(len(corner))
    for xi in triangle_points(3):
        for zeta in (-1 / np.sqrt(3), 1 / np.sqrt(3)):
            low, high = (1 - zeta) / 2, (1 + zeta) / 2
            base = low * corner[:, :3] + high * corner[:, 3:]
            up = np.einsum("c,eci->ei", xi, corner[:, 3:] - corner[:, :3]) / 2
            u, v = base[:, 1] - base[:, 0], base[:, 2] - base[:, 0]
            total += np.einsum("ei,ei->e", np.cross(u, v), up) / 6
    return total


def test_nodes_are_numbered_layer_by_layer():
    prisms = Grid(center=[0, 0, 0], shape=[9, 7], layers=7, thickness=0.03).prisms()
    assert (prisms.layers, prisms.gaps, prisms.surface_nodes, prisms.nodes) == (7, 6, 63, 441)
    nodes = np.arange(127, 253) - 1  # the dissertation counts from 1
    assert set(prisms.layer[nodes]) == {2, 3}  # its layers 3 and 4
    np.testing.assert_allclose(prisms.position[nodes[:63], 2], -0.005, atol=1e-15)
    np.testing.assert_allclose(prisms.position[nodes[63:], 2], 0.0, atol=1e-15)
    triangles = len(prisms.triangles)
    assert prisms.element.shape == (6 * triangles, 6)
    gap, triangle = 4, 17
    lower, upper = prisms.element[gap * triangles + triangle].reshape(2, 3)
    np.testing.assert_array_equal(lower, 4 * 63 + prisms.triangles[17])
    np.testing.assert_array_equal(upper, 5 * 63 + prisms.triangles[17])
    np.testing.assert_array_equal(prisms.node_frame[130], prisms.frame[130 - 2 * 63])


@few
@given(rules())
def test_basis_functions_are_a_partition_of_unity(rule):
    shape = rule.shape()
    assert shape.shape == (rule.points, 6)
    np.testing.assert_allclose(shape.sum(axis=1), 1.0, rtol=1e-14)
    assert (shape >= -1e-15).all()


def test_basis_functions_are_those_of_eq_5_20():
    xi1, xi2, xi3, zeta = 0.5, 0.3, 0.2, 0.4
    (n,) = SampleRule(np.array([[xi1, xi2, xi3, zeta]])).shape()
    low, high = (1 - zeta) / 2, (1 + zeta) / 2
    np.testing.assert_allclose(n, [xi1 * low, xi2 * low, xi3 * low, xi1 * high, xi2 * high, 0.14])
    corners = np.vstack([np.c_[np.eye(3), -np.ones(3)], np.c_[np.eye(3), np.ones(3)]])
    np.testing.assert_array_equal(SampleRule(corners).shape(), np.eye(6))


@pytest.mark.parametrize(("triangle", "line"), [(1, 1), (3, 2), (6, 3), (7, 1), (12, 4)])
def test_shape_of_a_tensor_product_is_the_product_of_shapes(triangle, line):
    rule = SampleSettings(triangle, line).rule()
    assert rule.points == triangle * line
    product = np.einsum("rh,qc->rqhc", rule.line_shape(), rule.triangle_shape())
    np.testing.assert_allclose(rule.shape(), product.reshape(-1, 6), rtol=1e-14)


@few
@given(volumes(), rules(), st.integers(0, 2**32))
def test_samples_reproduce_linear_fields(volume, rule, seed):
    prisms = volume.prisms()
    gradient = np.random.default_rng(seed).standard_normal(3)
    place = sample_positions(prisms, rule)
    assert place.shape == (prisms.gaps, len(prisms.triangles), rule.points, 3)
    matrix = shape_matrix(prisms, rule)
    assert matrix.shape == (place[..., 0].size, prisms.nodes)
    assert matrix.has_canonical_format
    np.testing.assert_allclose(
        matrix @ (prisms.position @ gradient + 2.0),
        place.reshape(-1, 3) @ gradient + 2.0,
        atol=1e-12,
    )


@few
@given(volumes())
def test_every_prism_is_upright(volume):
    prisms = volume.prisms()
    assert (prism_volumes(prisms) > 0).all()
    corner = prisms.position[prisms.triangles]
    area = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    assert (np.einsum("ti,tci->tc", area, prisms.frame[prisms.triangles, 2]) > 0).all()
    assert (np.diff(prisms.depth) > 0).all()


@few
@given(st.lists(length, min_size=2, max_size=2), st.floats(0.01, 0.3), st.sampled_from(Diagonals))
def test_flat_prisms_fill_the_box(size, thickness, diagonals):
    volume = Grid(size=size, shape=[5, 4], thickness=thickness, layers=4, diagonals=diagonals)
    total = prism_volumes(volume.prisms()).sum()
    assert total == pytest.approx(size[0] * size[1] * thickness, rel=1e-12)


@pytest.mark.parametrize("radius", [0.2, -0.2])
def test_prisms_of_a_panel_fill_the_shell_in_the_limit(radius):
    low, high = -0.01, 0.02
    shell = 0.3 / 0.2 * 0.1 * abs((0.2 + np.sign(radius) * high) ** 2
                                  - (0.2 + np.sign(radius) * low) ** 2) / 2  # fmt: skip
    errors = []
    for nodes in (9, 17, 33):
        panel = Grid(size=[0.3, 0.1], shape=[nodes, 3], radius=radius, depth=[low, 0.0, high])
        errors.append(shell - prism_volumes(panel.prisms()).sum())
    # Chords instead of arcs: too little by the square of their length.
    np.testing.assert_allclose(np.divide(errors[:-1], errors[1:]), 4.0, rtol=0.02)
    assert 0 < errors[-1] < 1e-3 * shell


@few
@given(volumes(), rules())
def test_rigid_motion_moves_everything_and_changes_nothing(volume, rule):
    moved = volume.prisms()
    own = Grid(**{**vars(volume), "center": [0.0, 0, 0], "euler": [0.0, 0, 0]}).prisms()
    rotation = rotation_from_euler(volume.euler)  # world to own axes
    np.testing.assert_array_equal(moved.triangles, own.triangles)
    np.testing.assert_array_equal(moved.depth, own.depth)
    back = (sample_positions(moved, rule) - volume.center) @ rotation.T
    np.testing.assert_allclose(back, sample_positions(own, rule), atol=1e-12)
    frames = sample_frames(moved, rule) @ rotation.T
    np.testing.assert_allclose(frames, sample_frames(own, rule), atol=1e-12)


@few
@given(volumes(), rules())
def test_frames_are_right_handed_and_orthonormal(volume, rule):
    prisms = volume.prisms()
    for frame in (prisms.frame, sample_frames(prisms, rule)):
        np.testing.assert_allclose(
            frame @ np.swapaxes(frame, -1, -2), np.broadcast_to(np.eye(3), frame.shape), atol=1e-12
        )
        np.testing.assert_allclose(np.linalg.det(frame), 1.0, rtol=1e-12)


def test_frames_at_the_corners_are_the_nodes():
    prisms = Grid(radius=0.2, shape=[6, 4]).prisms()
    corners = SampleRule(np.c_[np.eye(3), [-1.0, 0.0, 1.0]])
    expected = np.broadcast_to(prisms.frame[prisms.triangles], (6, 30, 3, 3, 3))
    np.testing.assert_allclose(sample_frames(prisms, corners), expected, atol=1e-14)


@pytest.mark.parametrize("radius", [0.2, -0.2])
def test_frames_of_a_panel_are_those_of_the_cylinder(radius):
    prisms = Grid(center=[0, 0, 0], size=[0.3, 0.2], shape=[7, 5], radius=radius).prisms()
    turn = np.repeat(np.linspace(-0.15, 0.15, 7), 5) / radius
    zero, one = np.zeros(35), np.ones(35)
    analytic = [[np.cos(turn), zero, -np.sin(turn)], [zero, one, zero],
                [np.sin(turn), zero, np.cos(turn)]]  # fmt: skip
    np.testing.assert_allclose(prisms.frame, np.moveaxis(analytic, -1, 0), atol=1e-14)
    # Every layer is a cylinder about the same axis.
    reach = np.hypot(prisms.position[:, 0], prisms.position[:, 2] + radius).reshape(7, 35)
    expected = np.abs(radius + prisms.depth)
    np.testing.assert_allclose(reach, np.broadcast_to(expected[:, None], (7, 35)), rtol=1e-13)


def test_samples_in_parts_are_those_of_the_whole():
    prisms, rule = Grid(radius=0.3).prisms(), SampleSettings(6, 2).rule()
    parts = [slice(0, 40), slice(40, None)]
    for of in (sample_positions, sample_frames):
        whole = np.concatenate([of(prisms, rule, part) for part in parts], axis=1)
        np.testing.assert_array_equal(whole, of(prisms, rule))


def test_extruded_copies_follow_their_normals():
    tilted = rotation_from_euler([0.3, 0.4, 0.5])
    frame = np.stack([np.eye(3), np.eye(3), tilted])
    surface = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    prisms = extruded(surface, np.array([[0, 1, 2]]), frame, np.array([-0.1, 0.3]))
    np.testing.assert_allclose(prisms.position[[0, 3]], [[0, 0, -0.1], [0, 0, 0.3]])
    np.testing.assert_allclose(
        prisms.position[[2, 5]], surface[2] + np.outer([-0.1, 0.3], tilted[2])
    )
