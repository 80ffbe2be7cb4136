"""Rounded numbers of nodes are near the true ones by a share of their bounds."""

from __future__ import annotations

import base64
import zlib

import numpy as np
import pytest

from sldvexp.report.html import packing, shape
from tests.shell.made_strain import made_strain


def whole(text: str, nodes: int) -> np.ndarray:
    """Read what `packing.whole` has written, NaN and all."""
    planes = np.frombuffer(zlib.decompress(base64.b64decode(text)), np.uint8).reshape(2, -1)
    differences = np.ascontiguousarray(planes.T).view("<i2").astype(np.int64)
    found = np.cumsum(differences.reshape(-1, nodes), axis=1).astype("<i2").astype(float)
    return np.where(found == packing.NONE, np.nan, found)


def made(seed: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Make velocities of 4 frequencies, 3 components and 50 nodes, over five decades."""
    rng = np.random.default_rng(seed)
    size = 10 ** rng.uniform(-5, 0, (4, 3, 50))
    velocity = size * np.exp(2j * np.pi * rng.uniform(size=size.shape))
    return velocity, 10 ** rng.uniform(-4, -2, size.shape)


def read(own: dict) -> tuple[np.ndarray, np.ndarray]:
    code, real, imaginary = (
        whole(own[name], 50).reshape(4, 3, 50) for name in ("bound", "real", "imaginary")
    )
    bound = own["least"] * np.exp(own["ratio"] * code)
    step = np.fmax(own["share"] * bound, np.array(own["finest"])[:, None, None])
    return step * (real + 1j * imaginary), bound


def test_velocities_are_rounded_to_a_share_of_their_bounds():
    velocity, bound = made()
    found, limits = read(packing.velocities(velocity, bound))
    np.testing.assert_allclose(limits, bound, rtol=packing.RATIO / 2 + 1e-9)
    largest = abs(velocity).max(axis=(1, 2), keepdims=True)
    step = np.maximum(packing.SHARE * limits, largest / packing.MOST)
    away = found - velocity
    assert np.all(abs(away.real) <= 0.5001 * step)
    assert np.all(abs(away.imag) <= 0.5001 * step)
    assert abs(away).max() > 0.3 * step.min()  # rounded they are


def test_what_is_not_determined_and_what_has_no_bound_stay_so():
    velocity, bound = made()
    velocity[1, 2, 7] = np.nan
    bound[0, 0, 3], bound[0, 0, 4] = np.nan, 0.0
    found, limits = read(packing.velocities(velocity, bound))
    assert np.argwhere(np.isnan(found)).tolist() == [[1, 2, 7]]
    assert np.argwhere(np.isnan(limits)).tolist() == [[0, 0, 3]]
    assert limits[0, 0, 4] < 1e-100
    largest = abs(velocity[0]).max()
    assert abs(found[0, 0, 3:5] - velocity[0, 0, 3:5]).max() < largest / packing.MOST


@pytest.mark.parametrize("value", [0.0, np.nan])
def test_a_field_that_does_not_move_is_written(value):
    velocity, bound = np.full((4, 3, 50), value + 0j), np.full((4, 3, 50), value)
    found, _ = read(packing.velocities(velocity, bound))
    np.testing.assert_array_equal(found.real, value)


def test_all_frequencies_are_there_rounded_when_exact_ones_have_no_room(
    monkeypatch, small_volume, small_field
):
    around = small_volume()
    of, strain = small_field(around), made_strain(around)
    monkeypatch.setattr(shape, "MOST_BYTES", 3000)
    assert not shape.shape_of(of, around)["rounded"]
    data = shape.shape_of(of, around, strain)
    assert (data["rounded"], data["frequencies"], data["left_out"]) == (True, [197.0, 439.0], 0)
    first = data["colourings"][0]
    drawn = whole(first["real"], 20) + 1j * whole(first["imaginary"], 20)
    drawn *= np.array(first["finest"])[:, None]
    expected = 1e6j * strain["strain"].values[:, 0].T
    largest = abs(expected).max(axis=1, keepdims=True)
    assert np.all(abs(drawn - expected) <= 0.72 * largest / packing.SHADES)
