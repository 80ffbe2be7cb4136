"""What other files of one structure tell of a model: the error of its mesh, and sensitivities.

A coarser mesh of elements whose frequencies converge with the power p of their size h has an error
``(h_coarse / h)^p`` times as large. So the error of the finer is (Richardson)

    (f - f_coarse) / ((h_coarse / h)^p - 1).

A file of the same structure with another value of one parameter has the sensitivity
``d ln f / d ln theta = ln(f_other / f) / ln(theta_other / theta)``. Modes are paired by their
shapes, as frequencies may change places.
"""

from __future__ import annotations

import numpy as np

from sldvexp.errors import UserError
from sldvexp.lazy import scipy
from sldvexp.models.finite_elements import FiniteElementModel
from sldvexp.models.pairing import pair_modes
from sldvexp.typing import Array

#: MAC from which two modes of different meshes are one.
ALIKE = 0.8
#: Part of the extent that nodes of one structure may lie apart, for half of them.
APART = 0.1
#: Least ratio of the sizes of elements that tells an error.
COARSER = 1.2


def same_modes(model: FiniteElementModel, other: FiniteElementModel) -> Array:
    """Find the frequencies that another file has for a model's modes, shape (mode,), Hz.

    Raises
    ------
    UserError
        If it is of another structure, or lacks a mode.

    Examples
    --------
    >>> corner = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    >>> bent = np.array([[[0, 0], [0, 0], [a, b]] for a, b in [(0, 1), (1, 0), (0, -1), (1, 0)]])
    >>> square, none = np.array([[0, 1, 2, 3]]), np.empty((0, 3), int)
    >>> one, two = (
    ...     FiniteElementModel(corner, none, square, np.array(f), shape)
    ...     for f, shape in (([10.0, 20.0], bent), ([19.0, 21.0], bent[..., ::-1]))
    ... )
    >>> same_modes(one, two).tolist()
    [21.0, 19.0]
    """
    away, near = scipy.spatial.KDTree(model.position).query(other.position)
    back, _ = scipy.spatial.KDTree(other.position).query(model.position)
    extent = float(np.linalg.norm(np.ptp(model.position, axis=0)))
    apart = max(float(np.median(one)) for one in (away, back))
    if apart > APART * extent:
        raise UserError(
            f"{other.source}: most of its nodes and those of {model.source} lie more than "
            f"{1e3 * apart:.3g} mm beside one another; it must be the same structure, unit and axes"
        )
    x, y = (
        shape.reshape(-1, shape.shape[2]) for shape in (model.translation[near], other.translation)
    )
    mac = (x.T @ y) ** 2 / np.outer((x**2).sum(axis=0), (y**2).sum(axis=0))
    pair = pair_modes(mac, model.frequency, other.frequency, ALIKE)
    if (pair < 0).any():
        lost = int(np.argmin(pair))
        raise UserError(
            f"{other.source}: has no mode of the shape of mode {lost + 1} "
            f"({model.frequency[lost]:.5g} Hz) of {model.source}; the best MAC is "
            f"{mac[lost].max():.2g}; write as many modes into both"
        )
    return np.asarray(other.frequency[pair])


def mesh_error(model: FiniteElementModel, coarse: FiniteElementModel, order: float) -> Array:
    """Estimate the relative error of frequencies from a coarser mesh, shape (mode,).

    Parameters
    ----------
    order : float
        Power of the elements' size with which frequencies converge.

    Raises
    ------
    UserError
        If the other mesh is hardly coarser.
    """
    ratio = float(np.sqrt(len(model.halves) / len(coarse.halves)))
    if ratio < COARSER:
        raise UserError(
            f"{coarse.source}: its elements are {ratio:.2g} times as large as those of "
            f"{model.source}; the error of a mesh needs one that is at least {COARSER:g} times as "
            "coarse, better twice"
        )
    return np.abs(same_modes(model, coarse) / model.frequency - 1) / (ratio**order - 1)


def sensitivity_of(model: FiniteElementModel, other: FiniteElementModel, factor: float) -> Array:
    """Compute d ln f / d ln theta from a file whose parameter is `factor` times as large."""
    return np.asarray(np.log(same_modes(model, other) / model.frequency) / np.log(factor))
