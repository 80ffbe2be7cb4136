"""Layouts, precisions and mistakes of the measured arrays."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.errors import UserError
from sldvexp.reconstruction import Absolute, Model, solve


def scene(points: int = 40, frequencies: int = 3) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(6)
    directions = rng.normal(size=(5, points, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    shape = (5, points, frequencies)
    return directions, rng.normal(size=shape) + 1j * rng.normal(size=shape)


@pytest.mark.parametrize(
    ("dtype", "real"),
    [
        (np.float32, np.float32),
        (np.float64, np.float64),
        (np.complex64, np.float32),
        (np.complex128, np.float64),
        (np.int16, np.float64),
        (np.float16, np.float64),
    ],
)
def test_precision_of_the_data_is_kept(dtype: type, real: type) -> None:
    directions, velocity = scene()
    data: np.ndarray = (
        velocity.astype(dtype) if np.issubdtype(dtype, complex) else velocity.real.astype(dtype)
    )
    result = Absolute(model=Model.full).reconstruct(directions.astype(np.float32), data)
    exact = Absolute(model=Model.full).reconstruct(
        directions.astype(np.float32), data.astype(complex)
    )
    assert result.intercept is not None
    assert result.velocity.dtype == result.intercept.dtype
    assert result.velocity.real.dtype == real
    assert result.std.dtype == result.confidence.dtype == real
    assert result.sse.dtype == result.s.dtype == real
    scale = np.abs(exact.velocity).max()
    np.testing.assert_allclose(result.velocity, exact.velocity, atol=2e-5 * scale)
    if np.issubdtype(result.velocity.dtype, np.complexfloating):
        np.testing.assert_allclose(result.std, exact.std, rtol=2e-4)


def test_real_data_are_not_complex_data_without_imaginary_part() -> None:
    directions, velocity = scene()
    real = Absolute().reconstruct(directions, velocity.real)
    assert real.velocity.dtype == float
    assert np.all(real.dof == 2)
    assert np.all(Absolute().reconstruct(directions, velocity).dof == 4)


def test_frequency_is_optional() -> None:
    directions, velocity = scene()
    with_it = Absolute().reconstruct(directions, velocity[..., :1])
    without = Absolute().reconstruct(directions, velocity[..., 0])
    np.testing.assert_array_equal(with_it.velocity, without.velocity)
    one_point = Absolute().reconstruct(directions[:, 0], velocity[:, 0, 0])
    np.testing.assert_allclose(one_point.velocity[0, :, 0], without.velocity[0, :, 0], rtol=1e-12)


def test_any_memory_order() -> None:
    directions, velocity = scene()
    expected = Absolute().reconstruct(directions, velocity)
    for data in (
        np.asfortranarray(velocity),
        np.repeat(velocity, 2, axis=2)[..., ::2],
        np.moveaxis(np.ascontiguousarray(np.moveaxis(velocity, 1, 2)), 2, 1),
    ):
        found = Absolute().reconstruct(np.asfortranarray(directions), data)
        np.testing.assert_allclose(found.velocity, expected.velocity, rtol=1e-12)
        np.testing.assert_allclose(found.std, expected.std, rtol=1e-10)
    one = Absolute().reconstruct(directions, np.asfortranarray(velocity)[..., 1])
    np.testing.assert_allclose(one.std[..., 0], expected.std[..., 1], rtol=1e-10)


@pytest.mark.parametrize("threads", [1, 3])
def test_blocks_and_threads_change_nothing(threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    directions, velocity = scene(points=101)
    directions[:, 50, :] = [0, 0, 1]  # one deficient point in one of the blocks
    whole = Absolute(model=Model.full).reconstruct(directions, velocity)
    monkeypatch.setattr(solve, "SYSTEMS_PER_BLOCK", 8)
    monkeypatch.setattr(solve, "NUMBERS_PER_STEP", 90)
    monkeypatch.setattr(solve, "MOST_THREADS", threads)
    monkeypatch.setattr(solve.os, "cpu_count", lambda: threads)
    parts = Absolute(model=Model.full).reconstruct(directions, velocity)
    for field in ("velocity", "std", "confidence", "sse", "dof", "intercept", "intercept_std"):
        np.testing.assert_allclose(getattr(parts, field), getattr(whole, field), rtol=1e-9)
    np.testing.assert_array_equal(parts.observable, whole.observable)
    assert parts.messages == whole.messages


def test_twice_is_the_same_to_the_bit() -> None:
    directions, velocity = scene(points=20_000, frequencies=2)
    one = Absolute().reconstruct(directions, velocity)
    two = Absolute().reconstruct(directions, velocity)
    for field in ("velocity", "std", "confidence"):
        np.testing.assert_array_equal(getattr(one, field), getattr(two, field))


def test_a_bad_sample_is_found_in_its_block(monkeypatch: pytest.MonkeyPatch) -> None:
    directions, velocity = scene(points=101)
    monkeypatch.setattr(solve, "SYSTEMS_PER_BLOCK", 8)
    velocity[3, 77, 2] = np.nan
    with pytest.raises(UserError, match="velocity of view d at point 77, frequency 2"):
        Absolute().reconstruct(directions, velocity, view_names=[*"abcde"])


GOOD, DATA = scene(points=4)
LONG = GOOD.copy()
LONG[2, 3] *= 1.5
HOLE = GOOD.copy()
HOLE[1, 2, 0] = np.nan


@pytest.mark.parametrize(
    ("directions", "velocity", "fields", "match"),
    [
        (GOOD[..., :2], DATA, {}, r"direction cosines have shape \(5, 4, 2\)"),
        (GOOD[0, 0], DATA, {}, r"direction cosines have shape \(3,\)"),
        (GOOD[:4], DATA, {}, r"velocities of shape \(5, 4, 3\) do not fit"),
        (GOOD, DATA[:, :3], {}, r"velocities of shape \(5, 3, 3\) do not fit"),
        (GOOD, DATA[..., :0], {}, r"velocities of shape \(5, 4, 0\) do not fit"),
        (GOOD, 1.0, {}, r"velocities of shape \(\) do not fit"),
        (GOOD[:, 0], 1.0, {}, r"velocities of shape \(\) do not fit"),
        (LONG, DATA, {}, "view 3 at point 3 .counted from 0. have length 1.5; they must be a unit"),
        (HOLE, DATA, {}, "view 2 at point 2 .counted from 0. have length nan"),
        (GOOD, DATA.astype(str), {}, "velocities must be numbers"),
        (GOOD, DATA, {"std": np.zeros(5)}, "std of view 1 at point 0, .* is 0.0; it must be a pos"),
        (GOOD, DATA, {"std": [1, 1, np.inf, 1, 1]}, "std of view 3 .* is inf"),
        (GOOD, DATA, {"std": np.ones((5, 3))}, r"std have shape \(5, 3\), which does not fit"),
        (GOOD, DATA, {"std": np.ones((5, 4, 3, 1))}, r"std have shape \(5, 4, 3, 1\)"),
        (GOOD, DATA, {"view_names": [*"abcd"]}, "5 views but 4 names: a, b, c, d"),
        (GOOD, DATA, {"view_names": [*"abcda"]}, "two views are called a"),
    ],
)
def test_mistakes(
    directions: np.ndarray, velocity: np.ndarray, fields: dict[str, object], match: str
) -> None:
    with pytest.raises(UserError, match=match):
        Absolute().reconstruct(directions, velocity, **fields)  # type: ignore[arg-type]
