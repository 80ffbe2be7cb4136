"""The error that elements add, estimated from the field, against the one that they do add."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from sldvexp.field.bounds.element_error import SurfaceMean, element_error
from sldvexp.volume import Grid, sample_positions, shape_matrix


def fitted(shape, wave):
    """A volume, and the least-squares fit of its elements to a wave, beside the wave itself."""
    volume = Grid(size=[1.0, 1.0], shape=shape, layers=2, thickness=0.01)
    prisms, rule = volume.prisms(), volume.rule()
    basis = shape_matrix(prisms, rule)
    samples = sample_positions(prisms, rule).reshape(-1, 3)
    nodal = spsolve((basis.T @ basis).tocsc(), basis.T @ wave(samples))
    mean = SurfaceMean.from_prisms(prisms, rule)
    return prisms, mean, nodal[:, None, None].astype(complex), wave(prisms.position)


@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.6, 0.8)])
def test_it_is_the_error_of_a_fit_to_a_wave(direction):
    number = 6.0

    def wave(points):
        return np.sin(number * points[:, :2] @ direction + 0.3)

    prisms, mean, nodal, true = fitted([25, 25], wave)
    error = nodal[:, 0, 0] - true
    inner = (np.abs(prisms.position[:, :2]) < 0.35).all(axis=1)
    found = element_error(mean, nodal)[:, 0, 0]
    size = np.sqrt(np.mean(np.abs(error[inner]) ** 2))
    assert np.sqrt(np.mean(np.abs(found - error)[inner] ** 2)) < 0.15 * size


def test_it_is_nothing_for_what_the_elements_can_follow():
    _, mean, nodal, _ = fitted([9, 7], lambda p: 2.0 + 3.0 * p[:, 0] - p[:, 1])
    assert np.abs(element_error(mean, nodal)).max() < 1e-12


def test_nodes_that_are_not_determined_take_nothing_from_others():
    prisms, mean, nodal, _ = fitted([25, 25], lambda p: np.sin(6.0 * p[:, 0]))
    whole = element_error(mean, nodal)[:, 0, 0]
    at = prisms.position
    gone = (np.abs(at[:, 0] - 0.2) < 0.1) & (np.abs(at[:, 1]) < 0.1)
    nodal[gone] = np.nan
    found = element_error(mean, nodal)[:, 0, 0]
    assert np.isnan(found[gone]).all()
    assert np.isfinite(found[~gone]).all()
    far = np.hypot(at[:, 0] - 0.2, at[:, 1]) > 0.3
    np.testing.assert_array_equal(found[far], whole[far])
    beside = ~gone & ~far
    assert np.abs(found - whole)[beside].max() < 0.5 * np.abs(whole).max()


def test_without_inner_nodes_nothing_is_known():
    _, mean, nodal, _ = fitted([2, 2], lambda p: p[:, 0])
    assert np.isnan(element_error(mean, nodal)).all()
