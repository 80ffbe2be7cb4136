"""Convergence, the numbers of Tables 5.7 and 5.8, flags, the group, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import xarray as xr

from sldvexp import dataset
from sldvexp.config.registry import get
from sldvexp.errors import UserError
from sldvexp.field import FieldResult, VolumeVisibility
from sldvexp.field.estimate import solve_field
from sldvexp.laser import TwoMirror
from sldvexp.reconstruction import Model, Reconstruction, Weights
from sldvexp.volume import PointSurface, SampleRule, SampleSettings, shape_matrix, tensor_rule

Make = Callable[..., Any]


def method_of(name: str, **fields: Any) -> Reconstruction:
    method: Reconstruction = get("reconstruction", name)(**fields)
    return method


def estimate(looks: VolumeVisibility, method: Reconstruction, **options: Any) -> FieldResult:
    return solve_field(looks, method, get("solver", "iterative")(), **options)


def mode(position: np.ndarray) -> np.ndarray:
    """A smooth field, shape (point, 3)."""
    x, y, z = np.moveaxis(position, -1, 0)
    deflection = np.sin(9 * x + 1) * np.cos(7 * y)
    return np.stack([-9 * z * np.cos(9 * x + 1), np.sin(5 * x * y) + z, deflection], axis=-1)


@pytest.mark.one_in(4)
@pytest.mark.parametrize("sizes", [(9, 17), (9, 17, 33)], ids=len)
@pytest.mark.parametrize("name", ["absolute", "contravariant"])
def test_refinement(
    make_plate: Make,
    make_every_sample: Make,
    six_points: SampleRule,
    name: str,
    sizes: tuple[int, ...],
) -> None:
    """The error falls with the square of the elements' size."""
    errors, fine = [], tensor_rule(7, 3)
    for n in sizes:
        prisms = make_plate((n, n), 3)
        nothing = np.zeros((prisms.nodes, 3, 1))
        looks = make_every_sample(prisms, six_points, 4, nothing)
        look = looks.at(np.arange(len(prisms.triangles)))
        seen = np.einsum("ski,si->ks", look.directions, mode(look.position))[..., None]
        looks = make_every_sample(prisms, six_points, 4, nothing, noise=seen)
        velocity = estimate(looks, method_of(name), bounds=False).velocity[..., 0].real
        basis = shape_matrix(prisms, fine)
        error = basis @ velocity - mode(basis @ prisms.position)
        errors.append(np.sqrt(np.mean(error**2)))
    rates = np.log2(np.divide(errors[:-1], errors[1:]))
    np.testing.assert_allclose(rates, 2.0, atol=0.15)


@pytest.fixture
def volume_of_section_5_4(tmp_path: Any) -> PointSurface:
    """7 layers of 63 nodes, 95 triangles, 7 samples in each of the 570 prisms."""
    x, y = np.meshgrid(np.linspace(-0.19, 0.19, 9), np.linspace(-0.15, 0.15, 7), indexing="ij")
    inner = (np.abs(x) < 0.18) & (np.abs(y) < 0.14)
    rng = np.random.default_rng(1)
    x = x + inner * rng.uniform(-0.01, 0.01, x.shape)
    y = y + inner * rng.uniform(-0.01, 0.01, y.shape)
    lines = [f"{a},{b},0.0" for a, b in zip(x.ravel(), y.ravel(), strict=True)]
    path = tmp_path / "points.csv"
    path.write_text("\n".join(["x_m,y_m,z_m", *lines]))
    middle = [1 / 3, 1 / 3, 1 / 3, 0.0]
    corners = [[0.5, 0.25, 0.25], [0.25, 0.5, 0.25], [0.25, 0.25, 0.5]]
    parameters = [[*c, z] for z in (-0.5, 0.5) for c in corners] + [middle]
    return PointSurface(path=str(path), samples=SampleSettings(parameters=parameters))


@pytest.mark.long
def test_structural_numbers(volume_of_section_5_4: PointSurface, make_every_sample: Make) -> None:
    """Unknowns, rows and the order of condition numbers of Table 5.7."""
    prisms, rule = volume_of_section_5_4.prisms(), volume_of_section_5_4.rule()
    triangles = len(prisms.triangles)
    assert prisms.nodes == 441
    samples = prisms.gaps * triangles * rule.points
    noise = 1e-3 * np.random.default_rng(2).normal(size=(5, samples, 2)) @ [[1], [1j]]
    looks = make_every_sample(prisms, rule, 5, np.ones((441, 3, 1)), noise=noise)
    partial = estimate(looks, method_of("absolute", weights=Weights.equal))
    full = estimate(looks, method_of("absolute", weights=Weights.equal, model=Model.full))
    relative = estimate(looks, method_of("relative", weights=Weights.equal))
    contravariant = estimate(looks, method_of("contravariant", weights=Weights.equal))
    found = [(r.unknowns, r.samples / samples) for r in (partial, full, relative, contravariant)]
    assert found == [(1323, 5), (1764, 5), (1323, 4), (441, 2)]
    assert contravariant.cond * 10 < min(partial.cond, relative.cond)
    assert full.cond > 20 * partial.cond
    # Table 5.7's std is sqrt(SSE / samples); real and imaginary part have 1e-3 each.
    for result, parts in ((partial, 2), (full, 2)):
        np.testing.assert_allclose(result.residual_std, 1e-3 * np.sqrt(parts), rtol=0.1)
        np.testing.assert_allclose(result.s, 1e-3, rtol=0.02)
    assert contravariant.sse.shape == (3, 1)
    assert contravariant.residual_std[2] < 0.5 * contravariant.residual_std[:2].min()
    np.testing.assert_allclose(partial.residual_std_by_view, 1e-3 * np.sqrt(2), rtol=0.1)
    assert relative.residual_std_by_row.shape == (4, 1)
    pooled = np.sqrt(np.mean(relative.residual_std_by_row**2))
    np.testing.assert_allclose(pooled, relative.residual_std[0, 0], rtol=1e-9)


@pytest.mark.whole
def test_intercepts(make_plate: Make, make_every_sample: Make, six_points: SampleRule) -> None:
    """Of independent samples F compares both models' sums of squares; it grows with intercepts."""
    prisms = make_plate((4, 4), 3)
    samples = prisms.gaps * len(prisms.triangles) * 6
    found = {}
    for size in (0.0, 0.01):
        nodal = np.ones((prisms.nodes, 4, 3)) * [[1], [2], [3], [size]]
        noise = 1e-3 * np.random.default_rng(3).normal(size=(6, samples, 3, 2)) @ [1, 1j]
        looks = make_every_sample(prisms, six_points, 6, nodal, noise=noise)
        full = estimate(looks, method_of("absolute", model=Model.full))
        partial = estimate(looks, method_of("absolute"), bounds=False)
        test = full.intercept_test
        assert test is not None
        added, left = 2 * prisms.nodes, 2 * (full.samples - 4 * prisms.nodes)
        drop = (partial.sse - full.sse)[0] / added
        np.testing.assert_allclose(test.statistic, drop / (full.sse[0] / left), rtol=1e-6)
        # Random images tell the residuals' degrees of freedom to a few percent.
        np.testing.assert_allclose(test.dof[1], left, rtol=0.1)
        found[size] = test
        assert partial.intercept_test is None
    assert np.all(found[0.0].p_value > 1e-3)
    assert np.all(found[0.01].reject)


def test_what_views_do_not_determine(
    make_plate: Make, make_every_sample: Make, six_points: SampleRule
) -> None:
    """A third sees three views, a third two, a third one only."""
    prisms = make_plate((10, 4), 3)
    nodal = np.random.default_rng(4).normal(size=(prisms.nodes, 3, 1))
    looks = make_every_sample(prisms, six_points, 3, nodal)
    x = looks.at(np.arange(len(prisms.triangles))).position[:, 0]
    seen = np.stack([x > -0.07, x < 9, x > 0.07], axis=1)
    looks = make_every_sample(prisms, six_points, 3, nodal, seen=seen)
    at = prisms.position[:, 0]
    result = estimate(looks, method_of("absolute"), bounds=False)
    good, half, blind = at > 0.06, (at > -0.08) & (at < 0.06), at < -0.08
    np.testing.assert_allclose(result.velocity[good], nodal[good], atol=1e-8)
    assert result.observable[good].all()
    assert not result.observable[blind].any()
    assert np.isnan(result.velocity[~result.observable]).all()
    rank = dict(zip(result.flagged_node, result.flagged_rank, strict=True))
    assert {rank[n] for n in np.flatnonzero(half)} == {2}
    assert {rank[n] for n in np.flatnonzero(blind)} == {0}
    for n, lost in zip(result.flagged_node, result.flagged_direction, strict=True):
        np.testing.assert_allclose(lost @ lost.T, np.eye(3), atol=1e-9)
        if n in np.flatnonzero(half):
            cosines = [(v.origin - prisms.position[n]) @ lost[2] for v in looks.views[:2]]
            assert np.abs(cosines).max() < 0.05
    few, some = result.messages
    assert "nodes are not seen well enough to determine anything" in few
    assert "where the velocity along (" in some
    assert "in x, y, z is not determined" in some
    other = estimate(looks, method_of("contravariant", rows="1,2,3"), bounds=False)
    np.testing.assert_allclose(other.velocity[good], nodal[good], atol=1e-8)
    assert not other.observable[~good].any()


def test_bounds_of_flagged_nodes(
    make_plate: Make, make_every_sample: Make, six_points: SampleRule
) -> None:
    prisms = make_plate((8, 4), 3)
    nodal = np.ones((prisms.nodes, 3, 1))
    looks = make_every_sample(prisms, six_points, 4, nodal)
    x = looks.at(np.arange(len(prisms.triangles))).position[:, 0]
    seen = np.repeat(x[:, None] > -0.02, 4, axis=1)
    looks = make_every_sample(prisms, six_points, 4, nodal, seen=seen)
    result = estimate(looks, method_of("absolute"))
    known = result.observable
    assert 0.4 < known.mean() < 0.7
    for values in (result.velocity, result.std, result.confidence, result.std_noise):
        assert np.isfinite(values[known]).all()
        assert np.isnan(values[~known]).all()
    assert (result.std[known] > 0).all()


@pytest.mark.one_in(2)
@pytest.mark.parametrize("frequencies", [None, [50.0, 60.0]])
def test_group(
    make_plate: Make, make_every_sample: Make, six_points: SampleRule, tmp_path: Any,
    frequencies: list[float] | None,
) -> None:  # fmt: skip
    prisms = make_plate((4, 4), 3)
    nodal = np.random.default_rng(5).normal(size=(prisms.nodes, 4, len(frequencies or [0])))
    looks = make_every_sample(prisms, six_points, 6, nodal)
    for name, fields, equations in (
        ("absolute", {"model": Model.full}, ["all components"]),
        ("contravariant", {}, ["t1", "t2", "n"]),
        ("contravariant", {"rows": "all", "model": Model.full}, ["t1", "t2", "n", "intercept"]),
    ):
        method = method_of(name, **fields)
        result = estimate(looks, method, local=True)
        group = replace(result, frequency=frequencies).to_dataset()
        dims = ("node", "component") + (("frequency",) if frequencies else ())
        for variable in ("velocity", "velocity_std", "confidence", "velocity_std_noise"):
            assert group[variable].dims == dims
        assert group["velocity_std_by_part"].dims == ("part", *dims)
        assert list(group["component"].values) == ["t1", "t2", "n"]
        assert list(group["equation"].values) == equations
        assert group["position"].dims == ("node", "axis")
        assert group["element"].shape == (prisms.gaps * 18, 6)
        assert group.attrs["dof"] == result.unknowns
        assert group.attrs["samples"] == result.samples
        assert {"sse", "residual_std", "cond", "rcond", "bounds_error"} <= set(group.attrs)
        assert group["residual_std_by_view"].sizes["view"] == 6
        path = tmp_path / "run.nc"
        dataset.save({"field": group}, {}, path)
        with dataset.load(path) as tree:
            xr.testing.assert_identical(tree["field"].to_dataset().load(), group)


@pytest.mark.whole
def test_velocities_that_are_zero(
    make_plate: Make, make_every_sample: Make, six_points: SampleRule
) -> None:
    prisms = make_plate((4, 4), 3)
    looks = make_every_sample(prisms, six_points, 5, np.zeros((prisms.nodes, 3, 1)))
    for name in ("absolute", "relative", "combined", "contravariant"):
        result = estimate(looks, method_of(name))
        assert not result.velocity.any()
        assert np.isfinite(result.std).all()


def test_what_is_refused(
    make_plate: Make, make_views: Make, six_points: SampleRule, laser: TwoMirror
) -> None:
    prisms, views = make_plate((4, 4), 3), make_views(5)

    def refused(some: list[Any], match: str, method: str = "absolute", **options: Any) -> None:
        looks = VolumeVisibility(some, laser, prisms, six_points)
        with pytest.raises(UserError, match=match):
            estimate(looks, method_of(method), bounds=False, **options)

    refused([], "field: there are no views")
    refused(views[:2], "the rows 1,2 are 2 independent ones, which cannot determine three")
    refused(views[:3], "the rows 2-1,3-1 are 2 independent ones", method="relative")
    refused(views[:2], "2 views do not have 3 independent rows", method="contravariant")
    same = replace(views[0], name="again")
    refused([*views, same], "views 1 and again have the same pose")
    silent = replace(views[2], std=np.zeros(400))
    refused([*views[:2], silent], "view 3: the standard error of pixel 0 is 0")
    refused(views, r"shape \(6, 6\); 5 views need \(30, 30\)", covariance=np.eye(6))
    away = replace(views[1], dac=views[1].dac + 3000)
    refused([views[0], away, *views[2:]], "view 2: none of the samples is seen")
    near = [replace(views[0], name=str(k + 1), origin=views[0].origin + 1e-5 * k) for k in range(3)]
    refused(near, "nothing is determined anywhere by the rows 1,2,3; 48 of 48 nodes")
