"""One reconstruction set up: settings, views and rows, and the estimator of any of its points.

A method's rows A are applied to both sides of ``v = D V``, so that ``A v = A X theta`` is solved
with ``X = D`` or, with an intercept, ``X = [D 1]``. Where the rows are no more than the unknowns
they fit exactly and leave no residual; then the size of the noise is taken from the least squares
of all views, whose model is the same.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from sldvexp.errors import Checks
from sldvexp.reconstruction.least_squares import PointFit, point_fit
from sldvexp.reconstruction.rows import RowSet
from sldvexp.reconstruction.views import Points, Views


class Model(Enum):
    """Partial: ``v = D V`` (Eq 5.4). Full: ``v = D V + beta0`` with an intercept (Eq 5.12)."""

    partial = "partial"
    full = "full"


class Weights(Enum):
    """Equal: ordinary least squares of the rows. Noise: weighted by the rows' covariance."""

    equal = "equal"
    noise = "noise"


class Robust(Enum):
    """Pixels of a field's images that dropped out unnoticed, and patches at rest.

    Attributes
    ----------
    auto
        They are found, left out and counted.
    off
        Every pixel without a flag counts.
    """

    auto = "auto"
    off = "off"


@dataclass
class ReconstructionSettings:
    """Velocity vector from line-of-sight velocities, ``A v = A D V`` with a method's rows A.

    Parameters
    ----------
    rows : str
        ``1,2,3``, ``2-1,3-1``, ``1-5,2,4`` by number or by the views' names; ``best`` searches the
        set with the largest reciprocal condition number; ``all``, where the method has it.
    model : Model
        `partial` has no intercept; `full` adds one (Eq 5.12) and tests it.
    weights : Weights
        `noise` is generalised least squares: rows that share a view are correlated, and views
        with a smaller std count more. `equal` is the dissertation's. Bounds are honest in both.
    confidence : float
        Two-sided level of the bounds.
    robust : Robust
        Whether pixels of a field that dropped out unnoticed are left out.
    rank_tolerance : float
        Relative singular value below which a direction counts as not determined. The default is
        the angle of one DAC step in rad: no view is known to point elsewhere than another by less.
    """

    rows: str = "all"
    model: Model = Model.partial
    weights: Weights = Weights.noise
    confidence: float = 0.95
    rank_tolerance: float = 1e-4
    robust: Robust = Robust.auto

    def __post_init__(self) -> None:
        checks = Checks()
        self._check(checks)
        checks.done()

    def _check(self, checks: Checks) -> None:
        """Collect what is wrong with the fields; strategies add to it."""
        checks.require(
            bool(self.rows.strip()), "rows", "must name rows as in 1-5,2,4, or be best or all"
        )
        checks.require(
            0 < self.confidence < 1,
            "confidence",
            f"must lie between 0 and 1 as in 0.95, not {self.confidence}",
        )
        checks.require(
            1e-12 <= self.rank_tolerance < 1,
            "rank_tolerance",
            f"must lie between 1e-12 (round-off) and 1, not {self.rank_tolerance}",
        )


#: Where the size of the noise comes from.
GIVEN, ROWS, VIEWS, NOWHERE = "given", "rows", "views", "none"


@dataclass(frozen=True)
class PointSystem:
    """Views and the linear model that a method fits to their rows.

    Attributes
    ----------
    settings : ReconstructionSettings
        Which model is fitted, and how; `rows` are its rows for these views.
    """

    views: Views
    rows: RowSet
    settings: ReconstructionSettings

    @property
    def intercept(self) -> bool:
        """Whether there is a fourth unknown, the intercept."""
        return self.settings.model is Model.full

    @property
    def generalised(self) -> bool:
        """Whether rows are weighted by the inverse of their covariance."""
        return self.settings.weights is Weights.noise

    @property
    def is_best(self) -> bool:
        """Whether the method's estimator itself is `best_fit` without an intercept."""
        all_views = np.array_equal(self.rows.matrix, np.eye(len(self.views.names)))
        return all_views and self.generalised and not self.intercept

    @property
    def parameters(self) -> int:
        """Unknowns at a point: three components, and the intercept in the full model."""
        return 4 if self.intercept else 3

    @property
    def residual_of_rows(self) -> bool:
        """Whether the method's own rows are more than its unknowns; if not, all views are asked."""
        return int(np.linalg.matrix_rank(self.rows.matrix)) > self.parameters

    def fit(self, points: Points) -> PointFit:
        """Set up the method's estimator, with the residual that tells the size of the noise."""
        fit = self._fit(points, self.rows.matrix, self.generalised)
        if not self.residual_of_rows:
            noise = self.best_fit(points, self.intercept)
        elif self.views.std is not None and not self.generalised:
            noise = self._fit(points, self.rows.matrix, True)  # whose residuals are a chi-square
        else:
            return fit
        return replace(fit, residual=noise.residual, redundancy=noise.redundancy, dof=noise.dof)

    def best_fit(self, points: Points, intercept: bool) -> PointFit:
        """Set up the Gauss-Markov estimator of all views, of the smallest variance."""
        return self._fit(points, np.eye(len(self.views.names)), True, intercept)

    def _fit(
        self, points: Points, rows: np.ndarray, generalised: bool, intercept: bool | None = None
    ) -> PointFit:
        directions, std = self.views.geometry(points)
        return point_fit(
            directions,
            rows,
            std=std,
            intercept=self.intercept if intercept is None else intercept,
            generalised=generalised,
            tolerance=self.settings.rank_tolerance,
        )
