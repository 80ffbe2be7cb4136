"""One reconstruction set up: views, rows and model, and the estimator of any of its points."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sldvexp.reconstruction.least_squares import PointFit, point_fit
from sldvexp.reconstruction.rows import RowSet
from sldvexp.reconstruction.views import Points, Views

#: Where the size of the noise comes from.
GIVEN, ROWS, VIEWS, NOWHERE = "given", "rows", "views", "none"


@dataclass(frozen=True)
class PointSystem:
    """Views and the linear model that a method fits to their rows.

    Attributes
    ----------
    views : Views
    rows : RowSet
    intercept : bool
    generalised : bool
    tolerance : float
    confidence : float
    """

    views: Views
    rows: RowSet
    intercept: bool
    generalised: bool
    tolerance: float
    confidence: float

    @property
    def parameters(self) -> int:
        """Unknowns at a point: three components, and the intercept in the full model."""
        return 4 if self.intercept else 3

    @property
    def residual_of_rows(self) -> bool:
        """Whether the method's own rows are more than its unknowns; if not, all views are asked."""
        return int(np.linalg.matrix_rank(self.rows.matrix)) > self.parameters

    def fit(self, points: Points) -> PointFit:
        """The method's estimator, with the residual that tells the size of the noise."""
        fit = self._fit(points, self.rows.matrix, self.generalised)
        if not self.residual_of_rows:
            noise = self.best_fit(points, self.intercept)
        elif self.views.std is not None and not self.generalised:
            noise = self._fit(points, self.rows.matrix, True)  # whose residuals are a chi-square
        else:
            return fit
        return replace(fit, residual=noise.residual, redundancy=noise.redundancy, dof=noise.dof)

    def best_fit(self, points: Points, intercept: bool) -> PointFit:
        """The Gauss-Markov estimator of all views, of the smallest variance."""
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
            tolerance=self.tolerance,
        )
