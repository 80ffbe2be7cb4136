"""The error that elements add, estimated from the field, against the one that they do add."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from sldvexp.field.bounds.element_error import element_error, mean_squares, told
from sldvexp.volume import Grid, sample_positions, shape_matrix


def fitted(shape, wave):
    """A volume, and the least-squares fit of its elements to a wave, beside the wave itself."""
    volume = Grid(size=[1.0, 1.0], shape=shape, layers=2, thickness=0.01)
    prisms, rule = volume.prisms(), volume.rule()
    basis = shape_matrix(prisms, rule)
    samples = sample_positions(prisms, rule).reshape(-1, 3)
    nodal = spsolve((basis.T @ basis).tocsc(), basis.T @ wave(samples))
    return prisms, rule, nodal[:, None, None].astype(complex), wave(prisms.position)


@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.6, 0.8)])
def test_it_is_the_error_of_a_fit_to_a_wave(direction):
    number = 6.0

    def wave(points):
        return np.sin(number * points[:, :2] @ direction + 0.3)

    prisms, rule, nodal, true = fitted([25, 25], wave)
    error = nodal[:, 0, 0] - true
    inner = (np.abs(prisms.position[:, :2]) < 0.35).all(axis=1)
    found = element_error(prisms, rule, nodal)[:, 0, 0]
    size = np.sqrt(np.mean(np.abs(error[inner]) ** 2))
    assert np.sqrt(np.mean(np.abs(found - error)[inner] ** 2)) < 0.15 * size


def test_it_is_nothing_for_what_the_elements_can_follow():
    prisms, rule, nodal, _ = fitted([9, 7], lambda p: 2.0 + 3.0 * p[:, 0] - p[:, 1])
    assert np.abs(element_error(prisms, rule, nodal)).max() < 1e-12


def test_only_what_bounds_do_not_contain_is_told():
    error = np.full((5, 3, 1), 0.1 + 0j)
    assert told(mean_squares(error, np.full((5, 3, 1), 1.0))) == []
    (sentence,) = told(mean_squares(error, np.full((5, 3, 1), 0.1)))
    assert "they add about 0.1 m/s" in sentence
