"""How far nodal values may be off, of all nodes.

Samples' velocities are interpolated from the same pixels, so that their errors are correlated.
With ``b = sum_k R_k v_k`` the noise of the pixels, independent of one another, gives the nodal
covariance ``sum_k K_k S_k K_k^T``, ``K_k = M^-1 R_k`` and S_k the pixels' variances. To it comes
the effect of the poses, see `sldvexp.field.bounds.pose_uncertainty`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.field.bounds.inverse import InverseRows
from sldvexp.field.equations.regions import Part
from sldvexp.field.equations.sample_model import FieldModel
from sldvexp.field.visibility.looks import Looks
from sldvexp.typing import Array, IndexArray


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
    def empty(cls, looks: Looks, model: FieldModel, group: IndexArray, columns: int) -> Bounds:
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

    def add_noise(self, part: Part, rows: InverseRows) -> None:
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

    def add_efficiency(self, part: Part) -> None:
        """Variances of the samples around the part's own nodes."""
        sums = part.patch.to_nodes(np.concatenate(sample_variances(part), axis=1))
        here = np.searchsorted(part.patch.nodes, part.region.own)
        self.pointwise[0][:, part.region.own] = sums[:, here, :3]
        self.pointwise[1][:, part.region.own] = sums[:, here, 3:]


def _of_samples(part: Part, k: int, variance: Array) -> Array:
    """Variances of a view's samples that the part owns, in every equation, summed."""
    of_samples = (part.look.seen[k].weights.power(2) @ variance) * part.owned
    if part.model.contravariant:
        found: Array = of_samples @ part.at.estimator[:, :, k] ** 2
        return found
    return np.array([of_samples @ part.at.pointwise.weight[:, k, k]])


def sample_variances(part: Part) -> tuple[Array, Array]:
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
