"""Difference of what views of the face and views of the back tell of a shell's motion.

By Love's theory both faces move as one middle surface does, w along the normal and ``u -+ (h/2)
grad w`` along themselves, so that ``u_face - u_back = -h grad w`` whatever the middle does. What
each side tells for itself may differ by d(s, t): by half of it up on the face and down on the back.
And the lever arm may be another than the distance of the faces, by a:

    v = D . (V + side/2 d) - side/2 a D_t . grad w + J e,

with the errors e of poses, calibration, height and thickness, which views share as far as their
covariance says, and low-order waves for d along t1, t2 and n. With the splines of u0, v0 and w
eliminated under their priors, the score test of d = 0 compares the two sides' predictions with the
covariance of both. Motion of the middle along itself does not shift a, as it would from one side.

A normal that stays straight and normal turns like a rigid body, which moves alike along a beam at
all of the beam's points: a pixel sees the middle where its beam would cross it. So a thickness that
is wrong for the faces' places and for their lever arms alike shows nowhere, to first order.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.field.bounds.pose_uncertainty import POSE
from sldvexp.shell.lever import MEMBRANE, SmallSystem, low_order, prediction_changes
from sldvexp.shell.surface_fit import SurfaceFit
from sldvexp.typing import Array, IntArray

#: Components of the difference: along both axes of the surface and its normal.
COMPONENTS = 3


@dataclass(frozen=True, eq=False)
class TwoSides:
    """Lever arm between both sides and difference of them, with the field eliminated.

    Attributes
    ----------
    system : SmallSystem
        Of the change a of the lever arm, m, the errors in their own standard deviations, and the
        waves of every column of data, m/s, component after component.
    errors : int
        How many errors there are.
    """

    system: SmallSystem
    errors: int

    @classmethod
    def of(cls, fit: SurfaceFit) -> TwoSides:
        """Put all columns of data together, which have lever arm and errors in common."""
        factor = fit.errors.factor
        common, waves = 1 + factor.shape[1], COMPONENTS * MEMBRANE
        parts = _systems(fit, factor)
        size = common + waves * len(parts)
        information, score = np.zeros((size, size)), np.zeros(size)
        for c, part in enumerate(parts):
            own = common + waves * c
            place = np.r_[:common, own : own + waves]
            information[np.ix_(place, place)] += part.information
            score[place] += part.score
        return cls(SmallSystem(information, score), factor.shape[1])

    def lever_arm(self) -> tuple[float, float]:
        """Estimate the lever arm less the distance of the faces, m, and its standard error."""
        kept = np.arange(1 + self.errors)
        own = SmallSystem(self.system.information[np.ix_(kept, kept)], self.system.score[kept])
        change, covariance = own.without(kept[1:], np.eye(self.errors)).estimate()
        return float(change[0]), float(np.sqrt(covariance[0, 0]))

    def difference_test(self, free_arm: bool, component: int | None = None) -> tuple[float, int]:
        """Test that both sides tell the same; chi-square and degrees of freedom.

        Parameters
        ----------
        free_arm : bool
            Whether the lever arm may be any, or is the distance of the faces.
        component : int, optional
            The one that may differ; without it all.
        """
        errors = np.arange(1, 1 + self.errors)
        posed = self._with_waves(component).without(errors, np.eye(self.errors))
        if free_arm:
            return posed.without(np.array([0])).score_test()
        own = np.arange(1, len(posed.score))
        return SmallSystem(posed.information[np.ix_(own, own)], posed.score[own]).score_test()

    def _with_waves(self, component: int | None) -> SmallSystem:
        """Keep lever arm, errors and the waves of one component, or of all."""
        if component is None:
            return self.system
        place = np.arange(len(self.system.score))
        of_wave = (place - 1 - self.errors) // MEMBRANE % COMPONENTS
        kept: IntArray = place[(place < 1 + self.errors) | (of_wave == component)]
        return SmallSystem(self.system.information[np.ix_(kept, kept)], self.system.score[kept])


def _systems(fit: SurfaceFit, factor: Array) -> list[SmallSystem]:
    """Eliminate the splines from every column of data.

    Parameters
    ----------
    factor : ndarray, shape (6 view + calibration + 2, error)
        Of the covariance of poses, calibration, height and thickness.
    """
    columns = fit.posterior.reduced.shape[1]
    theta = fit.posterior.mean()
    crossed: list[Array] = [np.zeros(())] * columns
    products: list[Array] = [np.zeros(())] * columns
    begin = 0
    for k, pixels in enumerate(fit.pixels):
        here = slice(begin, begin := begin + len(pixels.pixel))
        if not len(pixels.pixel):
            continue
        weight = 1 / fit.measured.pixel_std[here][:, None]
        where = pixels.coordinates
        design = pixels.design(fit.shell, fit.face) * weight
        changes = prediction_changes(fit, k, theta.astype(complex)).real * weight[:, None]
        own = np.r_[POSE * k : POSE * (k + 1), POSE * len(fit.pixels) : len(fit.at)]
        turns = fit.shell.values(theta, where, fit.shell.motion_by_height(where))
        arm = pixels.side / 2 * np.einsum("pa,pac->pc", pixels.cosine, turns) * weight
        waves = low_order(fit, where)
        up = [pixels.side / 2 * of_axis[:, None] * waves for of_axis in pixels.cosine.T]
        for c in range(columns):
            change = changes[..., c]
            data = fit.columns.data[here, c] + change @ fit.at[own]
            errors = change @ factor[own]
            x = np.hstack([arm[:, [c]], errors, np.hstack(up) * weight, data[:, None]])
            crossed[c] = crossed[c] + design.T @ x
            products[c] = products[c] + x.T @ x
    found = []
    for c in range(columns):
        left = products[c] - crossed[c].T @ fit.posterior.solve(crossed[c], c)
        found.append(SmallSystem(left[:-1, :-1], left[:-1, -1]))
    return found
