"""A field of the element space is recovered exactly, by every method, model and solver."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import sldvexp.field.equations.regions as field_parts
from sldvexp.config.registry import get, names
from sldvexp.field import Solver
from sldvexp.field.estimate import solve_field
from sldvexp.reconstruction import Model, Weights
from sldvexp.volume import SampleRule

EXACT = 1e-9
Make = Callable[..., Any]

METHODS = [
    ("absolute", "all", Model.partial, 3),
    ("absolute", "all", Model.full, 4),
    ("relative", "all", Model.partial, 4),
    ("combined", "best", Model.partial, 3),
    ("combined", "best", Model.full, 4),
    ("contravariant", "best", Model.partial, 3),
    ("contravariant", "best", Model.full, 4),
    ("contravariant", "all", Model.partial, 3),
    ("contravariant", "all", Model.full, 4),
]
SEVEN = SampleRule(
    np.array(
        [
            [0.50, 0.25, 0.25, -0.5],
            [0.25, 0.50, 0.25, -0.5],
            [0.25, 0.25, 0.50, -0.5],
            [0.50, 0.25, 0.25, 0.5],
            [0.25, 0.50, 0.25, 0.5],
            [0.25, 0.25, 0.50, 0.5],
            [1 / 3, 1 / 3, 1 / 3, 0.0],
        ]
    )
)


def iterative() -> Solver:
    return get("solver", "iterative")()


def nodal_values(nodes: int, model: Model, seed: int = 1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    shape = (nodes, 4 if model is Model.full else 3, 2)
    return rng.normal(size=shape) + 1j * rng.normal(size=shape)


@pytest.mark.one_in(10)
@pytest.mark.parametrize("local", [False, True])
@pytest.mark.parametrize(("name", "rows", "model", "fewest"), METHODS)
@pytest.mark.parametrize("count", [3, 5, pytest.param(12, marks=pytest.mark.long)])
def test_a_field_of_the_element_space(
    make_plate: Make, make_every_sample: Make, six_points: SampleRule,
    name: str, rows: str, model: Model, fewest: int, count: int, local: bool,
) -> None:  # fmt: skip
    if count < fewest:
        count = fewest
    prisms = make_plate(radius=0.6)
    nodal = nodal_values(prisms.nodes, model)
    looks = make_every_sample(prisms, six_points, count, nodal, local=local)
    method = get("reconstruction", name)(rows=rows, model=model)
    result = solve_field(looks, method, iterative(), local=local, bounds=False)
    scale = np.abs(nodal).max()
    np.testing.assert_allclose(result.velocity, nodal[:, :3], atol=EXACT * scale)
    assert result.components == (("t1", "t2", "n") if local else ("x", "y", "z"))
    if model is Model.full:
        np.testing.assert_allclose(result.intercept, nodal[:, 3], atol=EXACT * scale)
    assert result.observable.all()
    assert not result.messages


@pytest.mark.one_in(10)
@pytest.mark.parametrize("rule", ["tensor", "list"])
@pytest.mark.parametrize("solver", names("solver"))
@pytest.mark.parametrize(("name", "rows", "model", "fewest"), METHODS)
def test_every_solver(
    make_plate: Make, make_every_sample: Make, six_points: SampleRule,
    solver: str, name: str, rows: str, model: Model, fewest: int, rule: str,
) -> None:  # fmt: skip
    """What a solver must do, whoever wrote it; also where some samples are not seen."""
    prisms = make_plate()
    nodal = nodal_values(prisms.nodes, model)
    points = six_points if rule == "tensor" else SEVEN
    samples = prisms.gaps * len(prisms.triangles) * points.points
    for seen in (None, np.random.default_rng(2).random((samples, 6)) < 0.9):
        looks = make_every_sample(prisms, points, 6, nodal, seen=seen)
        method = get("reconstruction", name)(rows=rows, model=model)
        result = solve_field(looks, method, get("solver", solver)(), bounds=False)
        known = result.observable
        assert known.mean() > 0.95
        error = np.abs(result.velocity - nodal[:, :3])[known]
        assert error.max() < EXACT * np.abs(nodal).max()


@pytest.mark.one_in(3)
@pytest.mark.parametrize("weights", Weights)
@pytest.mark.parametrize(
    ("name", "kept"), [("absolute", 0.2), ("relative", 0.6), ("contravariant", 0.6)]
)
def test_uneven_coverage(
    make_plate: Make, make_every_sample: Make, six_points: SampleRule,
    name: str, kept: float, weights: Weights,
) -> None:  # fmt: skip
    """View 1 ends at one place and view 2 at another; elsewhere the field is whole."""
    prisms = make_plate((7, 6))
    samples = prisms.gaps * len(prisms.triangles) * 6
    looks = make_every_sample(prisms, six_points, 5, nodal_values(prisms.nodes, Model.partial))
    x = looks.at(np.arange(len(prisms.triangles))).position[:, 0]
    seen = np.ones((samples, 5), bool)
    seen[x > 0.07, 1] = seen[x < -0.07, 2] = False
    nodal = nodal_values(prisms.nodes, Model.partial)
    looks = make_every_sample(prisms, six_points, 5, nodal, seen=seen)
    method = get("reconstruction", name)(rows="all", weights=weights)
    result = solve_field(looks, method, iterative(), bounds=False)
    np.testing.assert_allclose(result.velocity, nodal, atol=EXACT * np.abs(nodal).max())
    assert list(result.coverage[1].lost)  # counted by the reason
    assert result.samples > kept * samples


@pytest.mark.whole
def test_parts_of_a_volume_give_the_same(
    make_plate: Make, make_every_sample: Make, six_points: SampleRule,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    prisms = make_plate((9, 8))
    nodal = nodal_values(prisms.nodes, Model.partial)
    noise = 0.1 * np.random.default_rng(3).normal(size=(5, 6 * prisms.gaps * 112, 2))
    looks = make_every_sample(prisms, six_points, 5, nodal, noise=noise)
    for name in ("absolute", "contravariant"):
        method = get("reconstruction", name)()
        whole = solve_field(looks, method, iterative(), bounds=False)
        with monkeypatch.context() as patch:
            patch.setattr(field_parts, "SAMPLES_IN_ALL", 0)
            patch.setattr(field_parts, "SAMPLES_AT_ONCE", 500)
            parts = solve_field(looks, method, iterative(), bounds=False)
        np.testing.assert_allclose(parts.velocity, whole.velocity, atol=1e-11)
        np.testing.assert_allclose(parts.sse, whole.sse)
        np.testing.assert_allclose(parts.residual_std_by_view, whole.residual_std_by_view)
        assert (parts.samples, parts.unknowns) == (whole.samples, whole.unknowns)
        assert [c.seen for c in parts.coverage] == [c.seen for c in whole.coverage]


@pytest.mark.one_in(4)
@pytest.mark.parametrize("model", Model)
@pytest.mark.parametrize("weights", Weights)
@pytest.mark.parametrize("name", ["absolute", "relative", "combined"])
def test_least_squares_of_all_rows(
    make_plate: Make, make_every_sample: Make, six_points: SampleRule,
    name: str, weights: Weights, model: Model,
) -> None:  # fmt: skip
    """The field is the least-squares solution of one large matrix (Eqs 5.25 and 5.27)."""
    from sldvexp.volume import shape_matrix

    if name == "relative" and model is Model.full:
        pytest.skip("an intercept cancels in differences")
    prisms = make_plate((3, 3), 3)
    samples, p = prisms.gaps * 8 * 6, 4 if model is Model.full else 3
    noise = np.random.default_rng(4).normal(size=(5, samples, 1))
    nodal = nodal_values(prisms.nodes, model)[..., :1]
    looks = make_every_sample(prisms, six_points, 5, nodal, noise=noise)
    rows = {"absolute": "all", "relative": "all", "combined": "1-5,2,4,3"}[name]
    method = get("reconstruction", name)(rows=rows, weights=weights, model=model)
    result = solve_field(looks, method, iterative(), bounds=False)

    directions = looks.at(np.arange(8)).directions
    design = np.concatenate([directions, np.ones((samples, 5, 1))], axis=2)[..., :p]
    a = result.rows.matrix
    if weights is Weights.noise:  # equal pixels: rows weighted by the inverse of A A^T
        a = np.linalg.cholesky(np.linalg.inv(a @ a.T)).T @ a
    basis = shape_matrix(prisms, six_points).toarray()
    big = np.einsum("rk,skp,sn->srnp", a, design, basis).reshape(samples * len(a), -1)
    v = np.stack([view.velocity[:, 0] for view in looks.views], axis=1)
    right = np.einsum("rk,sk->sr", a, v).ravel()
    best, squares = np.linalg.lstsq(big, right, rcond=None)[:2]
    nodes = best.reshape(-1, p)
    np.testing.assert_allclose(result.velocity[..., 0], nodes[:, :3], rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(result.sse[0, 0], squares[0], rtol=1e-9)
    assert result.unknowns == big.shape[1]
    assert result.samples == big.shape[0]
