"""Compiled kernels of bounds give what sparse matrices do, and nothing fails without them."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

import sldvexp.field.equations.system as field_system
from sldvexp.field import FieldResult, Iterative, View, VolumeVisibility
from sldvexp.field.bounds import compiled, kernels
from sldvexp.field.bounds.compiled import CompiledKernels
from sldvexp.field.estimate import solve_field
from sldvexp.laser import TwoMirror
from sldvexp.reconstruction import Absolute, Contravariant, Model, Reconstruction
from sldvexp.volume import Prisms, SampleRule

PLAIN = CompiledKernels(*(getattr(kernels, each.name) for each in fields(CompiledKernels)))
METHODS = {
    "contravariant": Contravariant(),
    "all rows": Contravariant(rows="all"),
    "absolute": Absolute(),
    "intercept": Absolute(model=Model.full),
}


@pytest.fixture
def visibility(
    make_plate: Callable[..., Prisms],
    make_views: Callable[..., list[View]],
    laser: TwoMirror,
    six_points: SampleRule,
) -> VolumeVisibility:
    """A plate of which one view sees a part, and all have lost some pixels."""
    rng, views = np.random.default_rng(8), []
    for k, view in enumerate(make_views(4, 8, covariance=np.diag([1e-4] * 6) ** 2)):
        flags = (rng.random(len(view.flags)) < 0.02).astype(int)
        flags[: 20 * (k == 2)] = 1
        velocity = rng.normal(size=(len(flags), 2, 2)).view(complex)[..., 0]
        views.append(replace(view, flags=flags, velocity=velocity))
    return VolumeVisibility(views, laser, make_plate((3, 3), layers=3), six_points)


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What one test has compiled the others load."""
    return tmp_path_factory.mktemp("cache")


@pytest.fixture
def fresh(monkeypatch: pytest.MonkeyPatch, cache: Path) -> Iterator[None]:
    """No kernel is loaded yet."""
    monkeypatch.setattr(compiled, "WORTHWHILE", 0)
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache))
    clear = compiled._compiled.cache_clear
    clear()
    yield
    clear()


def solved(visibility: VolumeVisibility, method: Reconstruction) -> FieldResult:
    return solve_field(visibility, method, Iterative())


@pytest.mark.one_in(4)
@pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)
@pytest.mark.parametrize("by", ["python", pytest.param("numba", marks=pytest.mark.whole)])
def test_kernels_give_what_sparse_matrices_do(
    visibility: VolumeVisibility,
    method: Reconstruction,
    by: str,
    fresh: None,
    monkeypatch: pytest.MonkeyPatch,
    cache: Path,
) -> None:
    monkeypatch.setattr(field_system, "SMALL", 0)
    monkeypatch.setattr(compiled, "WORTHWHILE", sys.maxsize)
    expected = solved(visibility, method)
    monkeypatch.setattr(compiled, "WORTHWHILE", 0)
    if by == "numba":
        pytest.importorskip("numba")
        assert isinstance(compiled.kernels_for(visibility), CompiledKernels)
    else:
        monkeypatch.setattr(compiled, "_compiled", lambda: PLAIN)
    found = solved(visibility, method)
    for name in ("noise", "pose"):
        np.testing.assert_allclose(found.variance[name], expected.variance[name], rtol=1e-12)
    np.testing.assert_allclose(found.chi2_ratio, expected.chi2_ratio, rtol=1e-12)
    np.testing.assert_allclose(found.efficiency, expected.efficiency, rtol=1e-12)
    np.testing.assert_allclose(found.bounds_error, expected.bounds_error, rtol=1e-9)
    np.testing.assert_array_equal(found.velocity, expected.velocity)
    assert np.isfinite(expected.efficiency).any()
    if by == "numba":
        again = solved(visibility, method)
        np.testing.assert_array_equal(again.variance["noise"], found.variance["noise"])
        kept = [*(cache / compiled.FOLDER).rglob("*.nbc")]
        assert len(kept) >= 2 + (method.model is Model.partial)


@pytest.mark.parametrize("broken", [False, True], ids=["missing", "broken"])
def test_a_plain_installation_does_without(
    visibility: VolumeVisibility,
    broken: bool,
    fresh: None,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    if broken:
        (tmp_path / "numba.py").write_text("raise ImportError('Numba needs another NumPy')")
        monkeypatch.syspath_prepend(tmp_path)
        monkeypatch.delitem(sys.modules, "numba", raising=False)
    else:
        monkeypatch.setitem(sys.modules, "numba", None)
    assert compiled.kernels_for(visibility) is None
    assert np.isfinite(solved(visibility, Absolute()).std).any()


def test_only_a_large_field_is_worth_it(
    visibility: VolumeVisibility, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its samples decide, and nothing else: what was computed before changes no number."""
    monkeypatch.setattr(compiled, "_compiled", lambda: PLAIN)
    samples = 4 * 2 * 8 * 6
    monkeypatch.setattr(compiled, "WORTHWHILE", samples)
    assert compiled.kernels_for(visibility) is PLAIN
    monkeypatch.setattr(compiled, "WORTHWHILE", samples + 1)
    assert compiled.kernels_for(visibility) is None
