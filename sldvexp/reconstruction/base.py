"""What all reconstruction methods share: their fields, and the way from views to a velocity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, ClassVar

from sldvexp.errors import Checks

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import ArrayLike

    from sldvexp.reconstruction.result import PointVelocity
    from sldvexp.reconstruction.rows import RowChoice, RowSet


class Model(Enum):
    """Partial: ``v = D V`` (Eq 5.4). Full: ``v = D V + beta0`` with an intercept (Eq 5.12)."""

    partial = "partial"
    full = "full"


class Weights(Enum):
    """Equal: ordinary least squares of the rows. Noise: weighted by the rows' covariance."""

    equal = "equal"
    noise = "noise"


@dataclass
class Reconstruction:
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
    rank_tolerance : float
        Relative singular value below which a direction counts as not determined. The default is
        the angle of one DAC step in rad: no view is known to point elsewhere than another by less.
    """

    rows: str = "all"
    model: Model = Model.partial
    weights: Weights = Weights.noise
    confidence: float = 0.95
    rank_tolerance: float = 1e-4

    #: Whether a field takes the velocity at each sample from its own rows alone, or fits all rows
    #: of all samples together.
    sample_by_sample: ClassVar[bool] = False

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

    def row_choice(self, view_names: Sequence[str]) -> RowChoice:
        """Rows that this method may use: the hook that makes a strategy."""
        raise NotImplementedError

    def row_set(self, directions: ArrayLike, view_names: Sequence[str]) -> RowSet:
        """The rows A that this method applies to these views; see `rows.select`."""
        from sldvexp.reconstruction.select import select_rows

        return select_rows(self, directions, view_names)

    def reconstruct(
        self,
        directions: ArrayLike,
        velocity: ArrayLike,
        std: ArrayLike | None = None,
        view_names: Sequence[str] | None = None,
    ) -> PointVelocity:
        """Velocity vectors with bounds at any number of points and frequencies (Section 5.2).

        Parameters
        ----------
        directions : array_like, shape (view, point, axis) or, for one point, (view, axis)
            Direction cosines from the surface to the instrument.
        velocity : array_like, shape (view, point[, frequency]), for one point (view[, frequency])
            Line-of-sight velocity, positive towards the instrument, real or complex; peak, m/s.
        std : array_like, optional, m/s
            Its standard error, of real and imaginary part each: (view,), (view, point),
            (view, point, frequency) or, for one point, (view[, frequency]). Without it the noise
            is estimated from the residuals.
        view_names : sequence of str, optional
            Names of the views, "1", "2" and so on without them.

        Returns
        -------
        PointVelocity

        Raises
        ------
        UserError
            If arrays do not fit one another, are not finite, direction cosines are not of unit
            length, or the rows cannot be formed from these views.
        """
        from sldvexp.reconstruction.solve import solve
        from sldvexp.reconstruction.views import Views

        views = Views.checked(directions, velocity, std, view_names)
        rows = self.row_set(views.directions, views.names)
        return solve(views, rows, self)

    def group(self, line_of_sight: xr.Dataset) -> xr.Dataset:
        """The group ``point`` of a run, from its group ``line_of_sight``; see `reconstruct`."""
        from sldvexp.reconstruction.to_dataset import reconstruct_group

        return reconstruct_group(self, line_of_sight)
