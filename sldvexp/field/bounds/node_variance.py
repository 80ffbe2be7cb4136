"""How far nodal values may be off, of all nodes.

Samples' velocities are interpolated from the same pixels, so that their errors are correlated.
With ``b = sum_k R_k v_k`` the noise of the pixels, independent of one another, gives the nodal
covariance ``sum_k K_k S_k K_k^T``, ``K_k = M^-1 R_k`` and S_k the pixels' variances. To it comes
the effect of the poses, see `sldvexp.field.bounds.pose_uncertainty`.

Bounds of a few nodes computed exactly, to know how far the others may be off.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.field.bounds.inverse import InverseRows, NearRows
from sldvexp.field.bounds.pose_uncertainty import PoseEffect, column_variances
from sldvexp.field.equations.regions import RegionSamples
from sldvexp.field.equations.sample_model import FieldModel
from sldvexp.field.equations.system import NormalEquations, Solve
from sldvexp.field.visibility.visibility import VolumeVisibility
from sldvexp.typing import Array, BoolArray, IndexArray


@dataclass(eq=False)
class Bounds:
    """Variances of nodal values, filled part by part.

    Attributes
    ----------
    group : ndarray of int, shape (view,)
        Views whose noise changes alike with the frequency.
    noise : ndarray, shape (layer, surface_node, parameter, group)
        From the noise of the pixels of each group of views.
    pose : ndarray, shape (layer, surface_node, parameter, column)
        From the poses.
    expected : ndarray, shape (equation, group)
        Sum of squared residuals of one real part that the noise lets expect.
    pointwise : ndarray, shape (2, layer, surface_node, 3)
        Variances at the samples around a node, summed: the least possible, and the method's.
    """

    group: IndexArray
    noise: Array
    pose: Array
    expected: Array
    pointwise: Array

    @classmethod
    def empty(
        cls, looks: VolumeVisibility, model: FieldModel, group: IndexArray, columns: int
    ) -> Bounds:
        """Zeros."""
        shape = (looks.prisms.layers, looks.prisms.surface_nodes, model.parameters)
        equations = model.parameters if model.contravariant else 1
        return cls(
            group,
            np.zeros((*shape, group.max() + 1)),
            np.zeros((*shape, columns)),
            np.zeros((equations, group.max() + 1)),
            np.zeros((2, *shape[:2], 3)),
        )

    @property
    def efficiency(self) -> Array:
        """Gauss-Markov bound over variance, shape (layer, surface_node, component)."""
        least, own = self.pointwise
        return np.divide(least, own, out=np.full_like(own, np.nan), where=own > 0)

    def add_noise(self, part: RegionSamples, rows: InverseRows) -> None:
        """Noise of the part's own nodes, and of the residuals of the samples it owns."""
        own = part.region.own
        variances = [std**2 for std in part.model.pixel_std]
        for group in range(self.noise.shape[3]):
            views = [k for k, of in enumerate(self.group) if of == group]
            nodal, fitted = rows.variances(
                [part.influences[k] for k in views], [variances[k] for k in views]
            )
            self.noise[..., group][:, own] = nodal
            self.expected[:, group] -= fitted if part.model.contravariant else fitted.sum()
            for k in views:
                self.expected[:, group] += _of_samples(part, k, variances[k])

    def add_efficiency(self, part: RegionSamples) -> None:
        """Variances of the samples around the part's own nodes."""
        sums = part.patch.to_nodes(np.concatenate(sample_variances(part), axis=1))
        here = np.searchsorted(part.patch.nodes, part.region.own)
        self.pointwise[0][:, part.region.own] = sums[:, here, :3]
        self.pointwise[1][:, part.region.own] = sums[:, here, 3:]


def _of_samples(part: RegionSamples, k: int, variance: Array) -> Array:
    """Variances of a view's samples that the part owns, in every equation, summed."""
    of_samples = (part.look.seen[k].weights.power(2) @ variance) * part.owned
    if part.model.contravariant:
        found: Array = of_samples @ part.at.estimator[:, :, k] ** 2
        return found
    return np.array([of_samples @ part.at.pointwise.weight[:, k, k]])


def sample_variances(part: RegionSamples) -> tuple[Array, Array]:
    """Variances of the components at each sample by itself, both (sample, 3).

    The least that is possible with all views that see it (Gauss and Markov, no intercept), and that
    of the method's rows; 0 where these do not determine the velocity, or there is no noise.
    """
    at = part.at
    good = at.pointwise.kept & (at.pointwise.rank == part.model.parameters)
    good &= np.all((at.std > 0) | ~part.look.valid, axis=1)
    std, valid = at.std[good], part.look.valid[good]
    estimator = at.estimator[good]
    if at.inverse is None:
        estimator = np.linalg.solve(at.pointwise.information[good], estimator)
    weight = valid / np.where(valid, std, 1.0) ** 2
    x = at.pointwise.design[good, :, :3]
    least, own = np.zeros((2, len(good), 3))
    inverse = np.linalg.inv(np.swapaxes(x, 1, 2) @ (x * weight[..., None]))
    least[good] = np.diagonal(inverse, axis1=1, axis2=2)
    own[good] = np.einsum("spk,sk->sp", estimator[:, :3] ** 2, std**2)
    return least, own


#: Surface nodes of a part that are verified, each in one layer.
NODES = 4


@dataclass(frozen=True, eq=False)
class Verification:
    """What is verified.

    Parameters
    ----------
    part : RegionSamples
    pose : PoseEffect, optional
    right : ndarray, optional
        Its right-hand sides.
    noise : ndarray, shape (layer, surface_node, parameter)
        Variances from the noise.
    kept : ndarray, shape (layer, surface_node, parameter, ...)
        Those from the poses, as `pose` gives them.
    determined : ndarray of bool, shape (layer, surface_node, parameter)
    """

    part: RegionSamples
    pose: PoseEffect | None
    right: Array | None
    noise: Array
    kept: Array
    determined: BoolArray

    def largest_error(self, rows: NearRows, system: NormalEquations, solve: Solve) -> float:
        """Largest relative error of the standard errors of some of the part's nodes."""
        layer, own = self._chosen(rows)
        node, block = self.part.region.own[own], system.block
        unit = np.zeros((system.layers, system.graph.nodes, block, len(node), block))
        for i, (x, n) in enumerate(zip(layer, node, strict=True)):
            unit[x, n, :, i] = np.eye(block)
        columns = solve(unit.reshape(*unit.shape[:3], -1)).reshape(unit.shape)
        inverse = columns[:, self.part.patch.nodes]
        if block == 1:
            inverse = inverse * np.eye(self.noise.shape[2])[:, None]
        worst = 0.0
        for i, (x, n) in enumerate(zip(layer, node, strict=True)):
            exact = self._variance(inverse[:, :, :, i])
            known = self.determined[x, n] & np.all(exact > 0, axis=1)
            near = self.noise[x, n, known, None] + self._of_pose(self.kept[x, n, known])
            ratio = np.sqrt(near / exact[known])
            worst = max(worst, float(np.abs(ratio - 1).max(initial=0.0)))
        return worst

    def _variance(self, inverse: Array) -> Array:
        """Of a node, from its row of the inverse (layer, patch_node, parameter, parameter)."""
        row = inverse.reshape(-1, inverse.shape[-1]).T
        total = np.zeros((len(row), 1))
        for r, std in zip(self.part.influences, self.part.model.pixel_std, strict=True):
            total += ((r.T @ row.T) ** 2).T @ std[:, None] ** 2
        if self.pose is None or self.right is None:
            return total
        return total + self._of_pose(self.pose.variance(row @ self.right.reshape(len(row.T), -1)))

    def _of_pose(self, kept: Array) -> Array:
        """Variances of the data's columns, shape (..., column)."""
        return kept if self.pose is None else column_variances(self.pose, kept)

    def _chosen(self, rows: NearRows) -> tuple[IndexArray, IndexArray]:
        """Some nodes spread over the part, and one with the oddest information."""
        determined = self.determined[:, self.part.region.own]
        layers, count = determined.shape[:2]
        own = np.linspace(0, count - 1, min(NODES, count)).round().astype(np.intp)
        layer = np.arange(len(own)) * (layers - 1) // max(1, len(own) - 1)
        far = np.abs(rows.turn - np.eye(rows.turn.shape[-1])).max(axis=(2, 3))
        x, n = np.unravel_index(np.argmax(far * determined.all(axis=2)), far.shape)
        return np.append(layer, x), np.append(own, n)
