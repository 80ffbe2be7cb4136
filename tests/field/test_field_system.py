"""The normal equations: Kronecker products, rows at samples, conditioning, regions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sldvexp.field.equations.conditioning as conditioning
import sldvexp.field.equations.system as field_system
from sldvexp.errors import UserError
from sldvexp.field.equations.elements import Graph, Patch
from sldvexp.field.equations.regions import SurfaceRegions
from sldvexp.field.equations.sample_model import RowModel
from sldvexp.field.equations.system import Assembly, NormalEquations, line_matrix
from sldvexp.field.solvers.kronecker import KroneckerInverse
from sldvexp.reconstruction.rows import differences_from_first, parse, views
from sldvexp.volume import Prisms, SampleRule, shape_matrix, tensor_rule

Make = Callable[..., Any]
NAMES = ["1", "2", "3", "4", "5"]


def assembled(prisms: Prisms, rule: SampleRule, information: np.ndarray) -> NormalEquations:
    """M of given N_s, put together from two patches."""
    assembly = Assembly(Graph.from_prisms(prisms), rule, prisms.layers, information.shape[-1])
    count = len(prisms.triangles)
    each = information.reshape(prisms.gaps, count, -1, *information.shape[1:])
    for some in (np.arange(0, count, 2), np.arange(1, count, 2)):
        part = each[:, some].reshape(-1, *information.shape[1:])
        assembly.add(Patch.over(prisms, rule, some), part)
    return assembly.system(np.ones((prisms.layers, prisms.surface_nodes), bool))


@pytest.mark.parametrize("block", [1, 3])
def test_a_large_one_keeps_what_is_needed(
    make_plate: Make, six_points: SampleRule, monkeypatch: pytest.MonkeyPatch, block: int
) -> None:
    """One gap where all are alike, and the mean of sums where the nearest product is enough."""
    prisms, rng = make_plate((4, 3), 4), np.random.default_rng(4)
    alike = np.eye(block) * np.ones((prisms.gaps * len(prisms.triangles) * 6, 1, 1))
    root = rng.normal(size=alike.shape)
    ranked = np.ones((prisms.layers, prisms.surface_nodes), bool)
    for information in (alike, root @ np.swapaxes(root, 1, 2)):
        whole = assembled(prisms, six_points, information)
        assert whole.exact == (whole.pairs.strides[0] == 0) == (information is alike)
        dense = by_definition(prisms, six_points, information)
        np.testing.assert_allclose(whole.matrix().toarray(), dense, atol=1e-12)
        monkeypatch.setattr(field_system, "SMALL", 0)
        every = Patch.over(prisms, six_points, np.arange(len(prisms.triangles)))
        means = Assembly(Graph.from_prisms(prisms), six_points, 4, block, whole=False)
        means.add(every, information)
        near = means.system(ranked)
        monkeypatch.undo()
        assert near.pairs.size == whole.surface_blocks.size
        np.testing.assert_allclose(near.surface_blocks, whole.surface_blocks, rtol=1e-12)
        np.testing.assert_allclose(near.lumped, whole.lumped, rtol=1e-12)
        held = means.system(ranked & (np.arange(4)[:, None] > 0)).surface_blocks
        assert np.abs(held - whole.surface_blocks).max() > 0


def by_definition(prisms: Prisms, rule: SampleRule, information: np.ndarray) -> np.ndarray:
    """``sum_s B_s^T B_s (x) N_s``."""
    basis = shape_matrix(prisms, rule).toarray()
    m = np.einsum("sn,sm,sab->namb", basis, basis, information)
    size = prisms.nodes * information.shape[-1]
    return m.reshape(size, size)


def as_unknowns(system: NormalEquations, x: np.ndarray) -> np.ndarray:
    return x.reshape(system.layers, -1, system.block, x.shape[-1])


@pytest.mark.parametrize("block", [1, 3])
@pytest.mark.parametrize("rule", ["tensor", "list"])
def test_the_matrix_is_the_sum_over_samples(
    make_plate: Make, six_points: SampleRule, rule: str, block: int
) -> None:
    prisms = make_plate((4, 3), 3)
    points = six_points if rule == "tensor" else SampleRule(six_points.parameter[[0, 2, 3, 4]])
    samples = prisms.gaps * len(prisms.triangles) * points.points
    root = np.random.default_rng(1).normal(size=(samples, block, block))
    information = root @ np.swapaxes(root, 1, 2)
    system = assembled(prisms, points, information)
    dense = by_definition(prisms, points, information)
    assert not system.exact
    np.testing.assert_allclose(system.matrix().toarray(), dense, atol=1e-12)
    x = np.random.default_rng(2).normal(size=(len(dense), 4))
    np.testing.assert_allclose(
        system.times(as_unknowns(system, x)).reshape(x.shape), dense @ x, atol=1e-12
    )
    sums = dense.reshape(prisms.nodes, block, prisms.nodes, block).sum(axis=2)
    np.testing.assert_allclose(system.lumped.reshape(sums.shape), sums, atol=1e-12)
    if block > 1:
        small = system.part(2).matrix().toarray()
        keep = (np.arange(len(dense)) % block) < 2
        np.testing.assert_allclose(small, dense[np.ix_(keep, keep)], atol=1e-12)


@pytest.mark.parametrize("block", [1, 4])
@pytest.mark.parametrize(("triangle", "line"), [(3, 2), (6, 3)])
def test_kronecker_product(make_plate: Make, triangle: int, line: int, block: int) -> None:
    """Samples that are a tensor product, alike at all depths: M is one product of two matrices."""
    prisms, rule = make_plate((4, 3), 4), tensor_rule(triangle, line)
    rng = np.random.default_rng(3)
    root = rng.normal(size=(len(prisms.triangles), 1, triangle, block, block + 1))
    n = root @ np.swapaxes(root, -1, -2)
    everywhere = np.broadcast_to(
        n[None], (prisms.gaps, len(prisms.triangles), line, *n.shape[2:])
    ).reshape(-1, block, block)
    system = assembled(prisms, rule, everywhere)
    dense = by_definition(prisms, rule, everywhere)
    assert system.exact
    np.testing.assert_allclose(np.kron(system.line, system.surface.toarray()), dense, atol=1e-12)
    x = as_unknowns(system, rng.normal(size=(len(dense), 3)))
    inverse = KroneckerInverse.from_system(system)
    np.testing.assert_allclose(inverse.times(system.times(x)), x, atol=1e-9)
    assert KroneckerInverse.from_system(system) is inverse  # factorised once, whoever asks
    np.testing.assert_allclose(line_matrix(rule, 4), system.line)


def test_nodes_without_samples_are_held(make_plate: Make, six_points: SampleRule) -> None:
    prisms = make_plate((4, 3), 3)
    samples = prisms.gaps * len(prisms.triangles) * 6
    seen = shape_matrix(prisms, six_points).toarray()[:, 0] == 0  # those that node 0 has no part in
    ranked = np.ones((3, prisms.surface_nodes), bool)
    ranked[0, 0] = False
    assembly = Assembly(Graph.from_prisms(prisms), six_points, 3, 1)
    patch = Patch.over(prisms, six_points, np.arange(len(prisms.triangles)))
    assembly.add(patch, seen.astype(float).reshape(samples, 1, 1))
    system = assembly.system(ranked)
    assert not system.active[0, 0]
    assert system.active.sum() == prisms.nodes - 1
    dense = system.matrix().toarray()
    assert dense[0, 0] > 0
    assert np.count_nonzero(dense[0]) == 1


@pytest.mark.parametrize("size", [10**6, 0])
@pytest.mark.parametrize("exact", [True, False])
def test_condition_numbers(
    make_plate: Make, six_points: SampleRule, monkeypatch: pytest.MonkeyPatch,
    exact: bool, size: int,
) -> None:  # fmt: skip
    prisms = make_plate((6, 5), 3)
    samples = prisms.gaps * len(prisms.triangles) * 6
    weight = np.ones(samples) if exact else np.random.default_rng(4).uniform(1, 2, samples)
    system = assembled(prisms, six_points, weight[:, None, None])
    dense = system.matrix().toarray()
    monkeypatch.setattr(field_system, "SMALL", size)
    solve = lambda x: np.linalg.solve(dense, x.reshape(len(dense), -1)).reshape(x.shape)  # noqa: E731
    cond, rcond = conditioning.condition_numbers(system, solve)
    np.testing.assert_allclose(cond, np.linalg.cond(dense), rtol=2e-3)
    np.testing.assert_allclose(rcond, 1 / np.linalg.cond(dense, 1), rtol=0.02)


def test_a_start_that_misleads_hides_no_eigenvalue() -> None:
    """Near the eigenvector of another value it is as good as any for what it has nothing of."""
    rng = np.random.default_rng(5)
    axes = np.linalg.qr(rng.normal(size=(300, 300)))[0]
    matrix = (axes * np.append(np.linspace(0, 1, 299), 9.0)) @ axes.T
    misleading = axes @ np.append(1e-4 * rng.normal(size=298), [1.0, 0.0])
    for near in (misleading, axes[:, -1]):
        value, vector = conditioning._largest(lambda x: matrix @ x, 300, near)
        np.testing.assert_allclose(value, 9, rtol=1e-5)
        assert abs(vector @ axes[:, -1]) > 0.99


@pytest.mark.parametrize("size", [1e3, 1e-3])
def test_the_lowest_vector_is_near_that_of_the_matrix(
    make_plate: Make, six_points: SampleRule, size: float
) -> None:
    """Few solutions are enough from there."""
    prisms, rng = make_plate((6, 5), 3), np.random.default_rng(4)
    samples = prisms.gaps * len(prisms.triangles) * 6
    system = assembled(prisms, six_points, size * rng.uniform(1, 1.5, samples)[:, None, None])
    dense, near = system.matrix().toarray(), conditioning._lowest_vector(system)
    assert np.linalg.norm(near) == pytest.approx(1)
    assert abs(near @ np.linalg.eigh(dense)[1][:, 0]) > 0.5
    counts = []
    for start in (None, near):
        solved: list[int] = []

        def solve(x: np.ndarray, solved: list[int] = solved) -> np.ndarray:
            solved.append(1)
            return np.linalg.solve(dense, x)

        conditioning._largest(solve, len(dense), start)
        counts.append(len(solved))
    assert counts[1] <= counts[0] / 2


@pytest.mark.parametrize(("triangle", "line"), [(1, 2), (3, 1)])
def test_too_few_samples(make_plate: Make, triangle: int, line: int) -> None:
    prisms, rule = make_plate((3, 2), 3), tensor_rule(triangle, line)
    samples = prisms.gaps * len(prisms.triangles) * rule.points
    system = assembled(prisms, rule, np.ones((samples, 1, 1)))
    message = "do not determine the layers" if line == 1 else "too few to determine the surface"
    with pytest.raises(UserError, match=message):
        KroneckerInverse.from_system(system)


def dense_rows(a: np.ndarray, x: np.ndarray, std: np.ndarray | None) -> tuple[np.ndarray, ...]:
    """N and T of rows A, weighted by the inverse of their covariance if std are given."""
    w = np.eye(len(a)) if std is None else np.linalg.pinv(a @ np.diag(std**2) @ a.T)
    t = x.T @ a.T @ w @ a
    return t @ x, t


@pytest.mark.one_in(14)
@pytest.mark.parametrize("intercept", [False, True])
@pytest.mark.parametrize("generalised", [False, True])
@pytest.mark.parametrize("rows", ["1,2,3,4,5", "2-1,3-1,4-1,5-1", "1-5,2,4,3", "1-5,2-5,3,4,1"])
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None, derandomize=True)
def test_rows_at_samples(rows: str, generalised: bool, intercept: bool, seed: int) -> None:
    """Where views are missing: literally the rows that are left, or all that they span."""
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(15, 5, 3))
    valid, std = rng.random((15, 5)) < 0.8, rng.uniform(0.5, 2, (15, 5))
    a = parse(rows, NAMES).matrix
    at = RowModel(a, intercept, generalised, 1e-9, complete=False).at(directions, valid, std)
    information, estimator = at.information, at.estimator
    for s in range(15):
        x = np.concatenate([directions[s], np.ones((5, 1))], axis=1)[:, : 4 if intercept else 3]
        missing = a[:, ~valid[s]]
        if generalised:  # rows that span {A^T y: no missing view}
            u, sigma, _ = np.linalg.svd(missing if missing.size else np.zeros((len(a), 1)))
            left = u[:, np.sum(sigma > 1e-9) :].T @ a
            left = left[np.abs(left).max(axis=1) > 1e-9] if len(left) else left
        else:
            left = a[~np.any(missing != 0, axis=1)]
        if len(left) < 2:
            assert at.rows[s] == 0
            assert not estimator[s].any()
            continue
        n, t = dense_rows(left, x, std[s] if generalised else None)
        np.testing.assert_allclose(information[s], n, atol=1e-8 * np.abs(n).max())
        np.testing.assert_allclose(estimator[s], t, atol=1e-8 * np.abs(t).max())
        assert at.rank[s] == np.linalg.matrix_rank(left @ x, tol=1e-9)
        assert at.rows[s] == len(left)


@pytest.mark.parametrize(("rows", "intercept"), [("all", False), ("all", True), ("few", False)])
def test_samples_some_at_a_time(
    rows: str, intercept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Normal equations and their solutions are those of each sample by itself."""
    rng = np.random.default_rng(6)
    directions, std = rng.normal(size=(40, 5, 3)), rng.uniform(0.5, 2, (40, 5))
    valid = rng.random((40, 5)) < 0.7
    a = differences_from_first(NAMES).matrix if rows == "few" else views(NAMES).matrix
    generalised, parameters = rows == "all", 4 if intercept else 3
    monkeypatch.setattr("sldvexp.field.equations.sample_model.SAMPLES_IN_CACHE", 7)
    at = RowModel(a, intercept, generalised, 1e-9, complete=True).at(directions, valid, std)
    lost = ~at.kept
    assert lost.any()
    assert at.kept.any()
    weighted = at.weight.times(at.design)
    last = at.weight.times_last(np.moveaxis(at.design, 0, -1))
    np.testing.assert_allclose(np.moveaxis(last, -1, 0), weighted, rtol=1e-12, atol=1e-12)
    information, estimator = at.information, at.estimator
    np.testing.assert_allclose(estimator, np.swapaxes(weighted, 1, 2), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(information, estimator @ at.design, rtol=1e-12, atol=1e-12)
    inverse, solution = at.solutions()
    assert not inverse[lost].any()
    assert not solution[lost].any()
    expected = np.linalg.inv(information[at.kept])
    np.testing.assert_allclose(inverse[at.kept], expected, rtol=1e-8, atol=1e-8)
    x = solution[at.kept] @ at.design[at.kept]
    np.testing.assert_allclose(x, np.broadcast_to(np.eye(parameters), x.shape), atol=1e-8)


def test_rows_of_all_views_and_differences() -> None:
    """With weights by their covariance, differences from any view say the same."""
    rng = np.random.default_rng(5)
    directions, std = rng.normal(size=(7, 5, 3)), rng.uniform(0.5, 2, (7, 5))
    valid = np.ones((7, 5), bool)
    valid[:, 0] = False  # the view that others are subtracted from
    first = RowModel(differences_from_first(NAMES).matrix, False, True, 1e-9, False)
    last = RowModel(parse("2-5,3-5,4-5", NAMES).matrix, False, True, 1e-9, False)
    one, other = (m.at(directions, valid, std).information for m in (first, last))
    np.testing.assert_allclose(one, other, atol=1e-12)
    literal = RowModel(differences_from_first(NAMES).matrix, False, False, 1e-9, False)
    assert not literal.at(directions, valid, std).kept.any()
    whole = RowModel(views(NAMES).matrix, True, False, 1e-9, complete=True)
    assert not whole.at(directions[:, :, :], valid & (np.arange(5) < 4), std).kept.any()


@pytest.mark.parametrize("rings", [0, 2])
def test_regions(make_plate: Make, rings: int) -> None:
    prisms = make_plate((9, 7), 2)
    graph = Graph.from_prisms(prisms)
    surface = SurfaceRegions.from_prisms(prisms, graph)
    owned = []
    for own in surface.parts(10):
        assert len(own) <= 10
        region = surface.around(own, rings)
        owned.append(own)
        touched = np.isin(prisms.triangles, region.support).any(axis=1)
        np.testing.assert_array_equal(region.triangles, np.flatnonzero(touched))
        x = prisms.position[region.support, :2] - prisms.position[own, :2].mean(axis=0)
        assert np.abs(x).max() < 0.4 / 6 * (rings + 4)
    np.testing.assert_array_equal(np.sort(np.concatenate(owned)), np.arange(63))
    single = [surface.of_own(own).triangles for own in owned]
    np.testing.assert_array_equal(np.sort(np.concatenate(single)), np.arange(len(prisms.triangles)))


def test_patch_is_the_matrix_of_basis_functions(make_plate: Make, six_points: SampleRule) -> None:
    prisms = make_plate((4, 3), 3)
    basis = shape_matrix(prisms, six_points)
    patch = Patch.over(prisms, six_points, np.arange(len(prisms.triangles)))
    rng = np.random.default_rng(6)
    nodal, samples = rng.normal(size=(prisms.nodes, 2)), rng.normal(size=(basis.shape[0], 2))
    by_layer = nodal.reshape(3, -1, 2)
    np.testing.assert_allclose(patch.at_samples(by_layer), basis @ nodal, atol=1e-14)
    np.testing.assert_allclose(patch.to_nodes(samples).reshape(-1, 2), basis.T @ samples)
    ones = patch.to_nodes(np.ones((len(samples), 1)))
    np.testing.assert_allclose(patch.ones_to_nodes(), ones, rtol=1e-14)
