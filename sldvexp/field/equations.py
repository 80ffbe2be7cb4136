"""First way through the samples: the field's normal equations, and who sees what."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sldvexp.field.coverage import Coverage, require_coverage
from sldvexp.field.elements import Graph, Patch
from sldvexp.field.influence import influence
from sldvexp.field.looks import Look, Looks
from sldvexp.field.model import FieldModel, Samples
from sldvexp.field.system import Assembly, System
from sldvexp.field.view import View

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Equations:
    """``M theta = b`` of a field, and counts.

    Attributes
    ----------
    system : System
    right : ndarray, shape (layer, surface_node, parameter, column)
        Real and imaginary part of b at each frequency, one after the other.
    ranked : ndarray, shape (layer, surface_node, parameter)
        The part of a node's samples, weighted by its basis function, at which the views determine
        1, 2 and so on parameters.
    rows : int
        Scalar rows of all samples that are kept.
    samples : int
        Samples that are kept.
    coverage : tuple of Coverage
        One a view.
    """

    system: System
    right: Array
    ranked: Array
    rows: int
    samples: int
    coverage: tuple[Coverage, ...]


def normal_equations(looks: Looks, model: FieldModel, data: list[Array]) -> Equations:
    """Go through all samples once.

    Parameters
    ----------
    looks : Looks
    model : FieldModel
    data : list of ndarray, shape (pixel, column), m/s
        Velocities of each view's pixels as real numbers.

    Raises
    ------
    UserError
        If a view sees nothing.
    """
    prisms = looks.prisms
    assembly = Assembly(Graph.of(prisms), looks.rule, prisms.layers, model.block)
    shape = (prisms.layers, prisms.surface_nodes, model.parameters)
    right, ranked, whole = np.zeros((*shape, data[0].shape[1])), np.zeros(shape), np.zeros(shape)
    rows = samples = 0
    coverage: list[Coverage] = []
    for look in looks.blocks():
        patch = Patch.over(prisms, looks.rule, look.triangles)
        at = model.at(look)
        assembly.add(patch, at.information)
        right[:, patch.nodes] += right_side(patch, look, at, data)
        ranked[:, patch.nodes] += patch.to_nodes(_ranked(at, model.parameters))
        whole[:, patch.nodes] += patch.to_nodes(np.ones((len(look.position), 1)))
        rows += int(at.pointwise.rows.sum())
        samples += int(at.pointwise.kept.sum())
        each = [Coverage.of(v, s) for v, s in zip(looks.views, look.seen, strict=True)]
        coverage = [a + b for a, b in zip(coverage, each, strict=True)] if coverage else each
    require_coverage(coverage)
    return Equations(assembly.system(), right, ranked / whole, rows, samples, tuple(coverage))


def right_side(patch: Patch, look: Look, at: Samples, data: list[Array]) -> Array:
    """``sum_s B_s^T (x) T_s v_s``, shape (layer, patch_node, parameter, column)."""
    columns = data[0].shape[1]
    parameters = at.estimator.shape[1]
    total = np.zeros((patch.count * parameters, columns))
    for k, (seen, velocity) in enumerate(zip(look.seen, data, strict=True)):
        total += influence(patch, at.estimator[:, :, k], seen.weights) @ velocity
    return total.reshape(patch.layers, len(patch.nodes), parameters, columns)


def pixel_data(views: list[View] | tuple[View, ...]) -> list[Array]:
    """Velocities of each view as real numbers, shape (pixel, column); 0 where flagged."""
    each = [np.where(v.usable[:, None], v.velocity, 0.0) for v in views]
    return [np.ascontiguousarray(v).view(float) for v in each]


def _ranked(at: Samples, parameters: int) -> Array:
    """1 where a kept sample determines 1, 2 and so on parameters, shape (sample, parameter)."""
    rank = np.where(at.pointwise.kept, at.pointwise.rank, 0)
    return (rank[:, None] > np.arange(parameters)).astype(float)
