"""View sets that do not determine everything: what is determined, what is flagged, what is said."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.errors import UserError
from sldvexp.reconstruction import Absolute, Combined, Contravariant, Model, Relative

V = np.array([1.0 + 2j, -3.0, 5.0j])


def unit(vectors: list[list[float]]) -> np.ndarray:
    array = np.array(vectors, float)
    return array / np.linalg.norm(array, axis=1, keepdims=True)


IN_PLANE_XZ = unit([[0, 0, 1], [1, 0, 1], [-1, 0, 2], [1, 0, 3]])
TILTED = unit([[1, 1, 0], [1, 1, 1], [1, 1, -1], [1, 1, 2]])  # none sees along (1, -1, 0)
CONE = np.column_stack([0.6 * np.cos(np.arange(6)), 0.6 * np.sin(np.arange(6)), np.full(6, 0.8)])


def test_instruments_in_one_plane() -> None:
    result = Absolute().reconstruct(IN_PLANE_XZ, IN_PLANE_XZ @ V)
    np.testing.assert_array_equal(result.observable, [[True, False, True]])
    np.testing.assert_allclose(result.velocity[0, [0, 2], 0], V[[0, 2]], atol=1e-12)
    assert np.isnan(result.velocity[0, 1, 0])
    assert np.isnan(result.std[0, 1, 0])
    assert np.isnan(result.confidence[0, 1, 0])
    assert np.all(np.isnan(result.covariance[0, 1]))
    assert np.all(np.isfinite(result.covariance[0][np.ix_([0, 2], [0, 2])]))
    assert np.isnan(result.efficiency[0, 1, 0])
    assert result.dof[0] == 2 * (4 - 2)
    assert result.rcond[0] < 1e-15
    assert result.messages == (
        "the views do not determine the velocity along (0.00, 1.00, 0.00) (y)",
    )
    along = result.along
    assert along is not None
    assert along.rank[0] == 2
    np.testing.assert_allclose(np.abs(along.direction[0][2]), [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(along.velocity[0, :2, 0], along.direction[0][:2] @ V, atol=1e-12)
    assert np.isnan(along.velocity[0, 2, 0])


def test_bounds_of_what_is_determined_are_those_of_the_smaller_problem() -> None:
    rng = np.random.default_rng(1)
    seen = IN_PLANE_XZ @ V + rng.normal(size=4) + 1j * rng.normal(size=4)
    result = Absolute().reconstruct(IN_PLANE_XZ, seen)
    small = IN_PLANE_XZ[:, [0, 2]]
    solution, squares, *_ = np.linalg.lstsq(small, seen)
    np.testing.assert_allclose(result.velocity[0, [0, 2], 0], solution, rtol=1e-12)
    std = np.sqrt(squares[0] / 4 * np.diag(np.linalg.inv(small.T @ small)))
    np.testing.assert_allclose(result.std[0, [0, 2], 0], std, rtol=1e-12)
    assert result.along is not None
    np.testing.assert_allclose(np.sort(result.along.std[0, :2, 0]), np.sort(std), rtol=1e-9)
    np.testing.assert_allclose(
        result.along.confidence[0, :2, 0], result.factor[0] * result.along.std[0, :2, 0]
    )


def test_undetermined_direction_along_no_axis() -> None:
    result = Absolute().reconstruct(TILTED, TILTED @ V)
    np.testing.assert_array_equal(result.observable, [[False, False, True]])
    assert result.velocity[0, 2, 0] == pytest.approx(V[2])
    assert result.messages == ("the views do not determine the velocity along (0.71, -0.71, 0.00)",)
    assert result.along is not None
    along = {
        tuple(np.round(d, 2)): v
        for d, v in zip(result.along.direction[0], result.along.velocity[0, :, 0], strict=True)
    }
    assert along[0.71, 0.71, 0.0] == pytest.approx((V[0] + V[1]) / np.sqrt(2))


def test_parallel_views_determine_one_direction() -> None:
    directions = unit([[0, 0, 1], [0, 0, 1], [0, 0, -1]])
    result = Absolute().reconstruct(directions, directions @ V)
    np.testing.assert_array_equal(result.observable, [[False, False, True]])
    assert result.velocity[0, 2, 0] == pytest.approx(V[2])
    assert result.along is not None
    assert result.along.rank[0] == 1
    assert "(1.00, 0.00, 0.00) (x) and (0.00, 1.00, 0.00) (y)" in result.messages[0]


def test_one_view_has_no_bounds_and_says_so() -> None:
    directions = unit([[0, 0, 1]])
    result = Absolute().reconstruct(directions, directions @ V)
    assert result.velocity[0, 2, 0] == V[2]
    assert not result.bounded[0]
    assert result.noise_from == "none"
    assert np.isnan(result.std[0, 2, 0])
    assert result.messages[1] == (
        "1 view leaves no residual at 1 of 1 points: no bounds without std or another view"
    )
    known = Absolute().reconstruct(directions, directions @ V, std=[0.5])
    assert known.bounded[0]
    assert known.std[0, 2, 0] == pytest.approx(0.5)
    assert len(known.messages) == 1


def test_three_good_views_have_no_bounds_without_std() -> None:
    directions = np.eye(3)
    result = Absolute().reconstruct(directions, V)
    assert result.observable.all()
    np.testing.assert_allclose(result.velocity[0, :, 0], V)
    assert np.all(np.isnan(result.std))
    assert not result.bounded[0]
    assert np.isfinite(Absolute().reconstruct(directions, V, std=0.1).std).all()


def test_a_cone_of_views_cannot_tell_the_axis_from_an_intercept() -> None:
    result = Absolute(model=Model.full).reconstruct(CONE, CONE @ V + 3)
    np.testing.assert_array_equal(result.observable, [[True, True, False]])
    np.testing.assert_allclose(result.velocity[0, :2, 0], V[:2], atol=1e-12)
    assert result.intercept is not None
    assert np.isnan(result.intercept[0, 0])
    assert result.messages == (
        "the views do not determine beside an intercept the velocity along (0.00, 0.00, 1.00) (z)",
    )
    assert Absolute().reconstruct(CONE, CONE @ V).observable.all()


def test_differences_on_a_cone() -> None:
    result = Relative().reconstruct(CONE, CONE @ V + 3)
    np.testing.assert_array_equal(result.observable, [[True, True, False]])
    assert result.messages[0].startswith("the rows 2-1,3-1,4-1,5-1,6-1 do not determine")


@pytest.mark.parametrize("method", [Combined(), Contravariant(), Absolute(rows="best")])
def test_best_rows_of_deficient_views(method: Combined | Contravariant | Absolute) -> None:
    result = method.reconstruct(IN_PLANE_XZ, IN_PLANE_XZ @ V)
    np.testing.assert_array_equal(result.observable, [[True, False, True]])
    np.testing.assert_allclose(result.velocity[0, [0, 2], 0], V[[0, 2]], atol=1e-12)


def test_best_rows_see_as_much_as_all_views_do() -> None:
    directions = unit([[0, 0, 1], [0, 0, 1], [0, 0, -1], [1, 0, 1]])
    result = Absolute(rows="best").reconstruct(directions, directions @ V)
    np.testing.assert_array_equal(result.observable, [[True, False, True]])


def test_good_and_deficient_points_together() -> None:
    rng = np.random.default_rng(2)
    good = unit(rng.normal(size=(4, 3)).tolist())
    directions = np.stack([good, IN_PLANE_XZ, good, TILTED], axis=1)
    seen = directions @ V + rng.normal(size=(4, 4))
    result = Absolute().reconstruct(directions, seen)
    np.testing.assert_array_equal(result.observable.sum(axis=1), [3, 2, 3, 1])
    np.testing.assert_array_equal(result.dof, [2, 4, 2, 4])
    assert result.along is not None
    np.testing.assert_array_equal(result.along.point, [1, 3])
    assert result.messages == (
        "the views do not determine the velocity along (0.00, 1.00, 0.00) (y) at point 1 "
        "(counted from 0); at 2 of 4 points something is not determined",
    )
    for p in range(4):
        alone = Absolute().reconstruct(directions[:, p], seen[:, p])
        np.testing.assert_allclose(result.velocity[p], alone.velocity[0], rtol=1e-9)
        np.testing.assert_allclose(result.std[p], alone.std[0], rtol=1e-9)


def test_deficient_points_with_std_by_frequency() -> None:
    rng = np.random.default_rng(3)
    std = rng.uniform(1, 2, (4, 1, 3))
    seen = (IN_PLANE_XZ @ V)[:, None, None] + rng.normal(size=(4, 1, 3))
    together = Absolute().reconstruct(IN_PLANE_XZ[:, None], seen, std)
    assert together.along is not None
    for f in range(3):
        alone = Absolute().reconstruct(IN_PLANE_XZ, seen[:, 0, f], std[:, 0, f])
        assert alone.along is not None
        for field in ("velocity", "std", "confidence"):
            np.testing.assert_allclose(
                getattr(together.along, field)[..., f],
                getattr(alone.along, field)[..., 0],
                rtol=1e-9,
            )


@pytest.mark.parametrize(("spread", "seen"), [(3e-3, True), (3e-5, False)])
def test_threshold(spread: float, seen: bool) -> None:
    """One DAC step is 1e-4 rad: what spreads less than it is not a direction of its own."""
    directions = unit([[0, 0, 1], [1, spread, 1], [-1, spread, 2], [1, -2 * spread, 3]])
    assert Absolute().reconstruct(directions, directions @ V).observable[0, 1] == seen


def test_threshold_does_not_depend_on_the_weights() -> None:
    directions = unit([[0, 0, 1], [1, 0.01, 1], [-1, 0.01, 2], [1, -0.02, 3]])
    std = np.array([1e-4, 1, 1, 1])
    assert Absolute().reconstruct(directions, directions @ V, std).observable.all()


@pytest.mark.parametrize(
    ("method", "views", "match"),
    [
        (Contravariant(), 2, "2 views do not have 3 independent rows"),
        (Combined(), 2, "2 views do not have 3 independent rows"),
        (Relative(rows="best"), 3, "3 views do not have 3 independent rows"),
        (Relative(), 1, "a difference needs two views"),
        (Absolute(model=Model.full), 3, "at least 4 rows are needed, but there are 3: 1,2,3"),
        (Contravariant(rows="1,2,3"), 2, "the row '3' is no view"),
        (Contravariant(rows="1,2,2-1"), 2, "depend on one another"),
        (Contravariant(rows="1,2"), 4, "exactly 3 rows are needed, but 1,2 are 2"),
        (Combined(rows="1-5,2,4", model=Model.full), 5, "at least 4 rows are needed"),
        (
            Combined(rows="2-1,3-1,4-1,5-1", model=Model.full),
            5,
            "an intercept cancels in every difference",
        ),
    ],
)
def test_fewer_views_or_rows_than_needed(method: Absolute, views: int, match: str) -> None:
    directions = unit(np.random.default_rng(4).normal(size=(views, 3)).tolist())
    with pytest.raises(UserError, match=match):
        method.reconstruct(directions, directions @ V)


def test_what_is_not_determined_has_no_imaginary_part_either(sldvexp) -> None:
    rows = "reconstruction.rows='1,2'"
    run = sldvexp("experiment=point", "reconstruction=absolute", rows)
    assert run.status == 2, run.err  # fewer views than the experiment expects
    for name in ("velocity", "observed_velocity"):
        values = run.tree["point"][name].values
        lost = np.isnan(values)
        assert lost.any()
        assert np.isnan(values[lost].imag).all()
        assert np.isnan(values[lost].real).all()
