"""Assembly of a field's normal equations: the first way through the samples.

With the basis functions B_s at a sample, its information N_s and its estimator T_s, the equations
are ``sum_s B_s^T B_s (x) N_s theta = sum_s B_s^T (x) T_s v_s``. The right side is linear in the
pixels' velocities, so that real and imaginary part at each frequency are columns of one product.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sldvexp.field.equations.regions import RegionIterator, RegionSamples
from sldvexp.field.equations.sample_model import SAMPLES_IN_CACHE, SampleContributions
from sldvexp.field.equations.system import Assembly, NormalEquations
from sldvexp.field.visibility.coverage import Coverage, require_coverage
from sldvexp.field.visibility.view import View
from sldvexp.lazy import scipy
from sldvexp.typing import Array, BoolArray

#: Columns from which a matrix without blocks is multiplied faster.
MANY_COLUMNS = 32
#: Columns up to which samples are summed themselves, some at once, without a matrix of the pixels.
FEW_COLUMNS, COLUMNS_AT_ONCE = 32, 8
#: Part of a node's samples that must determine something for the node to count as determined.
SMALLEST_PART = 0.02
#: Part of a node's samples that may be missing where none of the prisms at it has them all.
#: Measured on a plate of 5 x 5 nodes in 3 layers, seen by five views that lose 2 to 30 % of their
#: pixels at random, all views taken at every sample, six seeds each: next to that without a loss
#: the standard error of such a node is 3.0 times as large in the median with 0.5 to 0.6 of its
#: samples left (6.3 at one node of ten), 8.1 times with 0.2 to 0.3 (23), 18 times with 0.1 to 0.2
#: (66), and 1.3 times where one prism has lost none (2.5).
MISSING = 0.8


@dataclass(frozen=True, eq=False)
class Equations:
    """``M theta = b`` of a field, and counts.

    Attributes
    ----------
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
    further : tuple of ndarray, shape (layer, surface_node, parameter, column)
        Right sides of further columns.
    """

    system: NormalEquations
    right: Array
    ranked: Array
    rows: int
    samples: int
    coverage: tuple[Coverage, ...]
    further: tuple[Array, ...] = ()


def normal_equations(parts: RegionIterator, data: list[Array]) -> Equations:
    """Go through all samples once.

    Parameters
    ----------
    data : list of ndarray, shape (pixel, column), m/s
        Velocities of each view's pixels as real numbers; of no column for the matrix alone.

    Raises
    ------
    UserError
        If a view sees nothing.
    """
    return joint_equations([parts], [[data]])[0]


def joint_equations(
    each: Sequence[RegionIterator], data: Sequence[Sequence[list[Array]]]
) -> list[Equations]:
    """Set up the normal equations of several models of the same samples, looked at once.

    Those of the first are to be solved. Of the others, if they are large, what their nearest
    Kronecker product needs is enough, which takes far less memory.

    Parameters
    ----------
    data : sequence of sequence of list of ndarray, shape (pixel, column), m/s
        Of each model: that of `normal_equations`, and any number of further columns.
    """
    pairs = zip(each, data, strict=True)
    sums = [EquationSums(parts, of, to_solve=not k) for k, (parts, of) in enumerate(pairs)]
    for part in each[0].disjoint():
        for of_model in sums:
            of_model.add(of_model.parts.of_region(part))
        del part  # before the next samples are looked at
    return [of_model.equations() for of_model in sums]


class EquationSums:
    """Collects the normal equations of a model, region by region.

    Parameters
    ----------
    data : sequence of list of ndarray, shape (pixel, column), m/s
        See `joint_equations`.
    to_solve : bool
        Whether all of the matrix is wanted even of a large system; see `Assembly`.
    """

    def __init__(
        self, parts: RegionIterator, data: Sequence[list[Array]], to_solve: bool = True
    ) -> None:
        prisms, model = parts.visibility.prisms, parts.model
        shape = (prisms.layers, prisms.surface_nodes, model.parameters)
        self.parts, self.data = parts, data
        self.one_by_one = model.contravariant
        self.assembly = Assembly(
            parts.graph, parts.visibility.rule, prisms.layers, model.block, whole=to_solve
        )
        self.right = [np.zeros((*shape, of[0].shape[1])) for of in data]
        self.ranked = np.zeros(shape)
        self.whole, self.complete = np.zeros((*shape[:2], 1)), np.zeros((*shape[:2], 1))
        self.rows = self.samples = 0
        self.coverage: list[Coverage] = []
        self.determined = True

    def add(self, part: RegionSamples) -> None:
        """Add the samples of a region."""
        at, nodes = part.at, part.patch.nodes
        self.assembly.add(part.patch, at.information)
        for right, data in zip(self.right, self.data, strict=True):
            right[:, nodes] += _right_side(part, data)
        whole = part.patch.ones_to_nodes()
        self.whole[:, nodes] += whole
        ranked = _ranked(at, part.model.parameters)
        self.determined = self.determined and at.pointwise.determined
        self.ranked[:, nodes] += whole if ranked.all() else part.patch.to_nodes(ranked)
        if self.one_by_one:
            of_whole = _of_whole_prisms(part)
            self.complete[:, nodes] += whole if of_whole.all() else part.patch.to_nodes(of_whole)
        self.rows += int(at.pointwise.rows.sum())
        self.samples += int(at.pointwise.kept.sum())
        seen = zip(part.visibility.views, part.samples.by_view, strict=True)
        here = [Coverage.from_view(*of_view) for of_view in seen]
        before = self.coverage
        self.coverage = [a + b for a, b in zip(before, here, strict=True)] if before else here

    def equations(self) -> Equations:
        """Finish the equations."""
        require_coverage(self.coverage)
        self.parts.determined = self.determined
        ranked = self.ranked / self.whole
        if self.one_by_one:  # few samples of some prisms are fewer than these have corners
            ranked[(ranked < 1 - MISSING) & (self.complete == 0)] = 0.0
        right, *further = self.right
        system = self.assembly.system(ranked[..., 0] >= SMALLEST_PART)
        coverage = tuple(self.coverage)
        return Equations(system, right, ranked, self.rows, self.samples, coverage, tuple(further))


def right_sides(parts: RegionIterator, data: list[Array]) -> Array:
    """Set up right-hand sides b alone, as `Equations.right`, of further columns."""
    prisms = parts.visibility.prisms
    shape = (prisms.layers, prisms.surface_nodes, parts.model.parameters, data[0].shape[1])
    right = np.zeros(shape)
    for part in parts.disjoint():
        right[:, part.patch.nodes] += _right_side(part, data)
    return right


def _right_side(part: RegionSamples, data: list[Array]) -> Array:
    """Sum ``B_s^T (x) T_s v_s`` over samples, shape (layer, patch_node, parameter, column)."""
    shape = part.patch.layers, len(part.patch.nodes), part.model.parameters, data[0].shape[1]
    if not shape[-1]:
        return np.zeros(shape)
    if shape[-1] <= FEW_COLUMNS:
        found = np.zeros(shape)
        for first in range(0, shape[-1], COLUMNS_AT_ONCE):
            some = slice(first, first + COLUMNS_AT_ONCE)
            _add_right_side(part, [d[:, some] for d in data], found[..., some])
        return found
    total = sum(_product(r, velocity) for r, velocity in zip(part.influences, data, strict=True))
    return np.reshape(total, shape)


def _add_right_side(part: RegionSamples, data: list[Array], found: Array) -> None:
    """Add few columns of a right side, gap by gap."""
    gaps = part.patch.sample_shape[0]
    velocity, estimator = part.velocities_last(data), part.at.estimator.T
    samples = velocity.shape[-1] // gaps
    side = np.empty((part.model.parameters, velocity.shape[1], samples))
    for gap in range(gaps):
        for first in range(0, samples, SAMPLES_IN_CACHE):
            here = slice(first, min(first + SAMPLES_IN_CACHE, samples))
            these = slice(gap * samples + here.start, gap * samples + here.stop)
            side[..., here] = np.einsum("kps,kcs->pcs", estimator[..., these], velocity[..., these])
        sums = part.patch.gap_to_nodes(side.reshape(-1, samples))
        found[gap : gap + 2] += sums.reshape(2, *found.shape[1:])


def _product(influence: scipy.sparse.bsr_array, velocity: Array) -> Array:
    """Multiply ``R v``; as a matrix without blocks many columns are added row by row at once."""
    rows = influence if velocity.shape[1] < MANY_COLUMNS else influence.tocsr()
    return np.asarray(rows @ velocity)


def pixel_data(views: Sequence[View]) -> list[Array]:
    """Turn velocities of each view into real numbers, shape (pixel, column); 0 where flagged."""
    return [real_columns(v.velocity, v.usable) for v in views]


def real_columns(velocity: NDArray[np.complexfloating], usable: BoolArray) -> Array:
    """Turn complex (pixel, frequency) into real (pixel, column); 0 where not usable."""
    columns = np.where(usable[:, None], velocity, 0.0).astype(complex, order="C", copy=False)
    return columns.view(float)


def _of_whole_prisms(part: RegionSamples) -> Array:
    """Put 1 at samples of prisms that have lost none, shape (sample, 1)."""
    kept = part.at.pointwise.kept.reshape(-1, part.visibility.rule.points)
    return np.repeat(kept.all(axis=1), kept.shape[1])[:, None].astype(float)


def _ranked(at: SampleContributions, parameters: int) -> Array:
    """Put 1 where a kept sample determines 1, 2 and so on parameters, shape (sample, parameter)."""
    rank = np.where(at.pointwise.kept, at.pointwise.rank, 0)
    return (rank[:, None] > np.arange(parameters)).astype(float)
