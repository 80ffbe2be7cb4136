"""Fits of the same views share equations, inverses and variances, and are what each is alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np
import pytest

from sldvexp.field import Direct, Iterative, View, VolumeVisibility
from sldvexp.field.bounds import intercept_test
from sldvexp.field.bounds.intercept_test import ChosenIntercepts
from sldvexp.field.bounds.inverse import WholeInverse
from sldvexp.field.estimate import solve_field
from sldvexp.field.result import FieldResult
from sldvexp.laser import TwoMirror
from sldvexp.reconstruction import Absolute, Combined, Contravariant, Model, Relative
from sldvexp.volume import Grid

METHODS = [
    Absolute(),
    Relative(),
    Combined(),
    Contravariant(),
    Contravariant(rows="all"),
    Absolute(model=Model.full),
]
SOLVERS = [Iterative(), Direct()]
VOLUME = Grid(size=[0.3, 0.3], shape=[4, 4], layers=3, thickness=0.02)


@pytest.fixture
def look(
    make_views: Callable[..., list[View]], laser: TwoMirror
) -> Callable[..., VolumeVisibility]:
    rng = np.random.default_rng(5)
    views = [
        replace(v, velocity=rng.normal(size=(*v.velocity.shape, 2)) @ [1e-3, 1e-3j])
        for v in make_views(5, pixels=14, covariance=1e-8 * np.eye(6))
    ]
    return lambda volume=VOLUME: VolumeVisibility.from_volume(views, laser, volume)


def assert_same_bits(found: FieldResult, alone: FieldResult) -> None:
    for f in fields(found):
        a, b = getattr(found, f.name), getattr(alone, f.name)
        assert type(a) is type(b), f.name
        if f.name == "variance":
            assert a.keys() == b.keys()
            for source in a:
                np.testing.assert_array_equal(a[source], b[source], err_msg=source)
        if isinstance(a, np.ndarray | float | int):
            np.testing.assert_array_equal(a, b, err_msg=f.name)
    assert found.messages == alone.messages
    assert repr(found.intercept_test) == repr(alone.intercept_test)


@pytest.mark.whole
def test_every_method_and_solver_is_what_it_is_alone(look: Callable[[], VolumeVisibility]) -> None:
    """To the last bit, in whatever order they come."""
    together = look()
    together.common = {}
    alone = [[solve_field(look(), method, solver) for solver in SOLVERS] for method in METHODS]
    for solvers in (slice(None), slice(None, None, -1)):
        for method, own in zip(METHODS, alone, strict=True):
            for solver, result in zip(SOLVERS[solvers], own[solvers], strict=True):
                assert_same_bits(solve_field(together, method, solver), result)


@pytest.mark.one_in(2)
@pytest.mark.parametrize("other", [{"bounds": False}, {"local": True}], ids=str)
def test_a_fit_takes_nothing_of_one_without_bounds_or_in_other_coordinates(
    look: Callable[..., VolumeVisibility], other: dict[str, bool]
) -> None:
    curved = replace(VOLUME, radius=0.5)
    together = look(curved)
    together.common = {}
    solve_field(together, Contravariant(), Direct(), **other)
    alone = solve_field(look(curved), Contravariant(), Direct())
    assert_same_bits(solve_field(together, Contravariant(), Direct()), alone)


def test_variances_are_computed_once_for_all_solvers(
    look: Callable[[], VolumeVisibility], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those of each method, and the least of all: not those of each pair of method and solver."""
    computed, usual = [], WholeInverse.variances

    def counted(*args):
        computed.append(args[0])
        return usual(*args)

    monkeypatch.setattr(WholeInverse, "variances", counted)
    together = look()
    together.common = {}
    for method in METHODS:
        for solver in SOLVERS:
            solve_field(together, method, solver)
    assert len(computed) == len(METHODS) + 1


def test_intercepts_are_chosen_and_images_smoothed_once_for_all_solvers(
    look: Callable[[], VolumeVisibility], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A small field's inverse is known, so that no solver has a part in which are tested."""
    chosen, smoothed = [], []
    usual, smooth = ChosenIntercepts.from_pixels, intercept_test.smooth_image
    monkeypatch.setattr(
        ChosenIntercepts, "from_pixels", lambda *args: chosen.append(args) or usual(*args)
    )
    monkeypatch.setattr(
        intercept_test, "smooth_image", lambda *args: smoothed.append(args) or smooth(*args)
    )
    together = look()
    together.common = {}
    full = Absolute(model=Model.full)
    tests = [solve_field(together, full, solver).intercept_test for solver in SOLVERS]
    assert len(chosen) == 1
    assert len(smoothed) == len(together.views)
    np.testing.assert_allclose(tests[0].statistic, tests[1].statistic, rtol=1e-9)
    np.testing.assert_allclose(tests[0].dof, tests[1].dof, rtol=1e-9)


def test_slopes_are_those_of_the_columns_that_are_asked_for(
    look: Callable[[], VolumeVisibility],
) -> None:
    together, alone = look(), look()
    together.common = {}
    data = [v.velocity.real for v in alone.views]
    for factor in (1.0, 2.0, 2.0, 1.0):
        columns = [factor * each for each in data]
        for a, b in zip(together.slopes(columns), alone.slopes(columns), strict=True):
            np.testing.assert_array_equal(a, b)


def test_views_of_another_pose_or_without_one_share_nothing(
    look: Callable[[], VolumeVisibility], laser: TwoMirror
) -> None:
    together = look()
    together.common = {}
    solve_field(together, Absolute(), Iterative())
    assert together.common
    for other in (together.without(0), together.seen_by(together.views), together.seen_with(laser)):
        assert other.common is None
    left = together.without(1)
    fresh = VolumeVisibility.from_volume(left.views, laser, VOLUME)
    for method in METHODS[:1]:
        a, b = (solve_field(seen, method, Iterative()) for seen in (left, fresh))
        np.testing.assert_array_equal(a.velocity, b.velocity)
        np.testing.assert_array_equal(a.std, b.std)
