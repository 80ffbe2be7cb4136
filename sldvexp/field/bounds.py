"""How far nodal values may be off: noise of the pixels, and poses that are not known exactly.

The samples' velocities are interpolated from the same pixels, so that their errors are correlated.
With ``b = sum_k R_k v_k`` the noise of the pixels, independent of one another, gives the nodal
covariance ``sum_k K_k S_k K_k^T``, ``K_k = M^-1 R_k`` and S_k the pixels' variances. A small change of
a pose moves image points and directions; the nodal values' derivatives J by all poses give
``J C J^T``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sldvexp.field.frequency_modes import FrequencyModes
from sldvexp.field.inverse_rows import InverseRows
from sldvexp.field.looks import Looks
from sldvexp.field.model import FieldModel
from sldvexp.field.parts import Part

Array = NDArray[np.float64]

#: Parameters of a pose.
POSE = 6


@dataclass(eq=False)
class Bounds:
    """Variances of nodal values, filled part by part.

    Attributes
    ----------
    noise : ndarray, shape (layer, surface_node, parameter, view)
        From the noise of each view's pixels.
    pose : ndarray, shape (layer, surface_node, parameter, column)
        From the poses.
    expected : ndarray, shape (equation, view)
        Sum of squared residuals of one real part that each view's noise lets expect.
    pointwise : ndarray, shape (2, layer, surface_node, 3)
        Variances at the samples around a node, summed: the least possible, and the method's.
    """

    noise: Array
    pose: Array
    expected: Array
    pointwise: Array

    @classmethod
    def empty(cls, looks: Looks, model: FieldModel, columns: int) -> Bounds:
        """Zeros."""
        shape = (looks.prisms.layers, looks.prisms.surface_nodes, model.parameters)
        equations = model.parameters if model.contravariant else 1
        views = len(looks.views)
        return cls(
            np.zeros((*shape, views)),
            np.zeros((*shape, columns)),
            np.zeros((equations, views)),
            np.zeros((2, *shape[:2], 3)),
        )

    @property
    def efficiency(self) -> Array:
        """Gauss-Markov bound over variance, shape (layer, surface_node, component)."""
        least, own = self.pointwise
        return np.divide(least, own, out=np.full_like(own, np.nan), where=own > 0)

    def add_noise(self, part: Part, rows: InverseRows) -> None:
        """Noise of the part's own nodes, and of the residuals of the samples it owns."""
        at, own = part.at, part.region.own
        for k, (r, std) in enumerate(zip(part.influences, part.model.pixel_std, strict=True)):
            variance = std**2
            covariance, fitted = rows.covariance(r, variance)
            self.noise[..., k][:, own] = np.diagonal(covariance, axis1=2, axis2=3)
            of_samples = (part.look.seen[k].weights.power(2) @ variance) * part.owned
            if part.model.contravariant:
                self.expected[:, k] += of_samples @ at.estimator[:, :, k] ** 2 - fitted
            else:
                self.expected[0, k] += of_samples @ at.pointwise.weight[:, k, k] - fitted.sum()

    def add_efficiency(self, part: Part) -> None:
        """Variances of the samples around the part's own nodes."""
        sums = part.patch.to_nodes(np.concatenate(sample_variances(part), axis=1))
        here = np.searchsorted(part.patch.nodes, part.region.own)
        self.pointwise[0][:, part.region.own] = sums[:, here, :3]
        self.pointwise[1][:, part.region.own] = sums[:, here, 3:]

    def add_pose(
        self,
        part: Part,
        rows: InverseRows,
        right: Array,
        modes: FrequencyModes,
        covariance: Array,
    ) -> None:
        """Effect of the poses on the part's own nodes.

        Parameters
        ----------
        part : Part
        rows : InverseRows
        right : ndarray
            See `pose_right_sides`.
        modes : FrequencyModes
        covariance : ndarray, shape (6 views, 6 views)
        """
        j = rows.times(right.reshape(*right.shape[:3], -1))
        j = j.reshape(*j.shape[:3], len(covariance), -1)
        gram = np.swapaxes(j, 3, 4) @ (covariance @ j)
        self.pose[:, part.region.own] = np.maximum(modes.quadratic(gram), 0.0)


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


def pose_right_sides(part: Part, theta: Array, data: list[Array]) -> Array:
    """Right-hand sides of the nodal values' derivatives by all poses, ``M dtheta = ...``.

    A change of the pose of view k changes its velocity at a sample by ``dv = grad v . d dac`` and its
    row of X by dx. With what the view's rows leave, r = v - X u, the sample adds
    ``dx (Q r)_k + T_k (dv - dx . u)``. For the contravariant method u is what the sample's own rows
    give, and their inverse stands before dx.

    Parameters
    ----------
    part : Part
    theta : ndarray, shape (layer, surface_node, parameter, column)
    data : list of ndarray, shape (pixel, column)

    Returns
    -------
    ndarray, shape (layer, patch_node, parameter, 6 views, column)
    """
    at, look = part.at, part.look
    samples, parameters, views = at.estimator.shape
    columns = theta.shape[-1]
    shape = (part.patch.layers, len(part.patch.nodes), parameters)
    v = part.velocities(data)
    u = part.field(theta) if at.inverse is None else at.estimator @ v
    balance = at.pointwise.weight @ (v - at.pointwise.design @ u)
    found = np.empty((*shape, views, POSE, columns))
    for k, (view, seen) in enumerate(zip(part.looks.views, look.seen, strict=True)):
        by_dac, turn = seen.pose_derivative(view, part.looks.laser, look.position)
        if part.model.local:
            turn = look.frame @ turn
        slope = np.stack([g @ data[k] for g in seen.gradient], axis=1)
        change = np.swapaxes(by_dac, 1, 2) @ slope - np.swapaxes(turn, 1, 2) @ u[:, :3]
        side = at.estimator[:, :, k, None, None] * change[:, None]
        before = turn if at.inverse is None else at.inverse[:, :, :3] @ turn
        side[:, : before.shape[1]] += before[..., None] * balance[:, k, None, None]
        found[:, :, :, k] = part.patch.to_nodes(side.reshape(samples, -1)).reshape(
            *shape, POSE, columns
        )
    return found.reshape(*shape, views * POSE, columns)
