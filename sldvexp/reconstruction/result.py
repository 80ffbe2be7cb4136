"""Result of a reconstruction at points: velocities with bounds, and how good they can be.

Conditioning is of the matrix that is solved, with the condition numbers of Tables 5.2 to 5.6
computed exactly, not estimated: they cost little for three or four unknowns. Efficiency compares
variances instead of matrices, so that methods with different rows can be ranked.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sldvexp import dataset
from sldvexp.lazy import xarray as xr
from sldvexp.reconstruction.least_squares import design
from sldvexp.reconstruction.observability import ObservedSubspace
from sldvexp.reconstruction.rows import RowSet
from sldvexp.reconstruction.system import PointSystem
from sldvexp.reconstruction.views import Points
from sldvexp.statistics import FTest, chi_square_p_value, f_test
from sldvexp.typing import Array, BoolArray


@dataclass(frozen=True)
class PointVelocity:
    """Velocity vectors at points; the geometry's numbers are computed when they are asked for.

    Bounds hold for real and imaginary part each. What could not be determined is NaN and has a
    flag, and `messages` says why.

    Attributes
    ----------
    velocity : ndarray, shape (point, component, frequency), m/s
    std : ndarray, shape (point, component, frequency), m/s
        Standard error.
    confidence : ndarray, shape (point, component, frequency), m/s
        Half-width of the confidence interval, ``factor * std`` (Eq 5.18). Exact for normal noise
        where `noise_from` is given, or rows and the rows are independent or weighted by noise. For
        equal weights of correlated rows it is Satterthwaite's approximation; where `noise_from` is
        views, estimate and noise depend on each other and the interval is on the safe side.
    intercept, intercept_std : ndarray, shape (point, frequency), optional, m/s
        Only in the full model; NaN where it is not determined.
    squares : ndarray, shape (point, frequency)
        What `sse` is computed from: it is itself, or the chi-square of given std.
    expected_squares : ndarray, shape (point,)
        Its expectation over the variance of the noise: `dof`, but for correlated rows that are
        weighted equally.
    dof : ndarray, shape (point,)
        Real degrees of freedom of `s`: 2 (n - p) for complex data, n - p for real.
    factor : ndarray, shape (point,)
        Student's t at `dof`, the normal quantile for given std.
    observable : ndarray of bool, shape (point, component)
        Whether the rows determine the component.
    bounded : ndarray of bool, shape (point,)
        Whether bounds can be given: the std are known, or there is a residual.
    noise_from : str
        Where the noise was taken from: ``given`` std, residuals of the method's ``rows``, residuals
        of all ``views`` where the rows leave none, or ``none``.
    along : ObservedSubspace, optional
        Velocities along determined directions where not all components are.
    messages : tuple of str
        What a user must know about flagged points, in sentences.
    system : PointSystem
        The views, rows and model that this was computed from.
    """

    GROUP: ClassVar[str] = "point"

    velocity: NDArray[np.inexact]
    std: Array
    confidence: Array
    intercept: NDArray[np.inexact] | None
    intercept_std: Array | None
    squares: Array
    expected_squares: Array
    dof: Array
    factor: Array
    observable: BoolArray
    bounded: BoolArray
    noise_from: str
    along: ObservedSubspace | None
    messages: tuple[str, ...]
    system: PointSystem

    def __repr__(self) -> str:
        """Say how many, how well conditioned, and how good."""
        points, _, frequencies = self.velocity.shape
        lines = [
            f"PointVelocity: x, y, z at {points} point{'s' * (points > 1)} and {frequencies} "
            f"frequenc{'y' if frequencies == 1 else 'ies'}, rows {self.rows}",
            f"  rcond {np.min(self.rcond):.3g} or more, noise from {self.noise_from}",
        ]
        if np.isfinite(self.confidence).any():
            level = self.system.settings.confidence
            lines.append(f"  largest bound {np.nanmax(self.confidence):.3g} m/s ({level:.0%})")
        return "\n".join([*lines, *(f"  {message}" for message in self.messages)])

    @property
    def rows(self) -> RowSet:
        """Rows A that were used, the same at all points."""
        return self.system.rows

    @property
    def sse(self) -> Array:
        """Sum of squared residuals that `s` comes from, shape (point, frequency), (m/s)^2.

        Of the rows, for equal weights. Of the views' errors that the rows imply, for noise weights:
        the same thing for single views. With given std these weights have a mean of one. Of all
        views where `noise_from` is views, since the rows leave no residual.
        """
        return self.squares if self._reference is None else self.squares * self._reference

    @property
    def s(self) -> Array:
        """Standard deviation of a view's velocity, shape (point, frequency), m/s.

        Of real and imaginary part each. Estimated from `sse`, also where the std are given (then of
        a view of mean weight); NaN without degrees of freedom.
        """
        return self._per_expectation(self.sse, slice(None))

    def noise(self, points: Points = slice(None)) -> Array:
        """Compute the size of the noise that bounds are in units of, shape (point, frequency).

        `s`, or 1 if the std are given.
        """
        squares = self.squares[points]
        if self._reference is not None:
            return np.ones_like(squares)
        return self._per_expectation(squares, points)

    def _per_expectation(self, squares: Array, points: Points) -> Array:
        expected = self.expected_squares[points]
        expected = np.where(expected > 0, expected, np.nan).astype(squares.dtype)
        return np.sqrt(squares / expected[:, None])

    @property
    def _reference(self) -> Array | None:
        """Variance of a view of mean weight, shape (1 or point, 1 or frequency)."""
        std = self.system.views.std
        return None if std is None else 1 / np.mean(std**-2.0, axis=0)

    @cached_property
    def covariance(self) -> Array:
        """Covariance of the components, shape (point, component, component, frequency), (m/s)^2.

        Of the real parts, and of the imaginary parts; the two do not correlate. NaN where a
        component is not determined.
        """
        fit = self.system.fit(slice(None))
        cofactor = self.system.views.fold(fit.cofactor[:, :3, :3, None])
        both = self.observable[:, :, None] & self.observable[:, None]
        return np.where(both[..., None], cofactor * self.noise()[:, None, None] ** 2, np.nan)

    def residuals(self) -> NDArray[np.inexact]:
        """Compute ``A v - A X theta``, shape (row, point, frequency), m/s; anew at each call."""
        views, rows = self.system.views, self.system.rows.matrix
        fit = self.system.fit(slice(None))
        model = design(views.geometry(slice(None))[0], self.system.intercept)
        leaves = rows - rows @ model @ fit.solution
        left = np.einsum("prv,vpf->prf", leaves, views.samples(slice(None)))
        return np.moveaxis(views.fold(left), 1, 0)

    @cached_property
    def efficiency(self) -> Array:
        """Least possible variance over this method's, shape (point, component, 1 or frequency).

        The numerator is the Gauss-Markov bound of the same views without an intercept: 1 says that
        no linear unbiased estimate does better. NaN where a component is not determined.
        """
        if self.system.is_best:
            each = self.velocity.shape[-1] if self.system.views.std_by_frequency else 1
            return np.where(self.observable[..., None], np.ones(each), np.nan)
        best = self.system.best_fit(slice(None), intercept=False).root
        with np.errstate(divide="ignore", invalid="ignore"):  # where nothing is determined
            ratio = self.system.views.fold(((best / self._root) ** 2)[..., None])
        return np.where(self.observable[..., None], ratio, np.nan)

    @cached_property
    def _root(self) -> Array:
        return self.system.fit(slice(None)).root[:, :3]

    @cached_property
    def matrix(self) -> Array:
        """Matrix that is solved, shape (point, parameter, parameter); see `solved_matrix`."""
        directions = self.system.views.directions
        return solved_matrix(directions, self.rows.matrix, self.system.intercept)

    @cached_property
    def rcond(self) -> Array:
        """Exact reciprocal condition number of `matrix` in the 1-norm, shape (point,)."""
        return reciprocal_condition(self.matrix)

    @cached_property
    def hadamard(self) -> Array:
        """Hadamard condition number of `matrix`, shape (point,)."""
        return hadamard_condition(self.matrix)

    @cached_property
    def basis(self) -> Array | None:
        """Contravariant basis g^j of three rows, shape (point, 3, axis); None for other numbers."""
        if len(self.rows) != 3 or self.system.intercept:
            return None
        return contravariant_basis(self.matrix)

    @property
    def chi_square(self) -> Array | None:
        """Residuals against the given std, shape (point, frequency); None if none were given."""
        return None if self._reference is None else self.squares

    @property
    def chi_square_p_value(self) -> Array | None:
        """Probability of larger residuals if the given std are right, shape (point, frequency)."""
        if self.chi_square is None:
            return None
        return chi_square_p_value(self.chi_square, self.dof[:, None])

    @cached_property
    def intercept_test(self) -> FTest | None:
        """F-test of the full against the partial model (Eq 5.17 in the right degrees of freedom).

        ``F = |beta0|^2 / (k std^2)`` with (k, dof) degrees of freedom; k is 2 for complex data,
        whose intercept is two real parameters. Equal to the drop of the sum of squares over k, over
        the full model's s^2, if all rows weigh alike. None in the partial model.
        """
        if self.intercept is None or self.intercept_std is None:
            return None
        k = self.system.views.real_components
        statistic = np.abs(self.intercept) ** 2 / (k * self.intercept_std**2)
        dof = np.inf if self.system.views.std is not None else self.dof[:, None]
        return f_test(statistic, k, dof, self.system.settings.confidence)

    def to_dataset(
        self, point: ArrayLike | None = None, frequency: ArrayLike | None = None
    ) -> xr.Dataset:
        """Make the group ``point`` of a run.

        Parameters
        ----------
        point : array_like, shape (point,), optional
            Labels of the points. Without them there is no such dimension, and the result is that
            of its first point.
        frequency : array_like, shape (frequency,), Hz, optional
            Without it there is no such dimension, and the result is that of its first frequency.

        Returns
        -------
        xarray.Dataset
            Attributes hold the worst `rcond`, `hadamard` and `dof`, the total `sse`, how many
            components every point has, the lowest p-value of a test of the model, and what was
            used.
        """
        labels = {"point": point, "frequency": frequency}
        coords: dict[str, Any] = {name: at for name, at in labels.items() if at is not None}
        rows = {"row": list(self.rows.labels)}
        group = dataset.group("point", coords | rows, **_variables(self, coords))
        group.attrs |= _attributes(self)
        return group


def _variables(result: PointVelocity, coords: dict[str, Any]) -> dict[str, ArrayLike | None]:
    """Collect arrays of the group, without the dimensions that the data does not have."""

    def by_point(array: np.ndarray) -> np.ndarray:
        """Keep (point, ...) as it is, or take that of the one point."""
        return array if "point" in coords else array[0]

    def fields(array: np.ndarray | None) -> np.ndarray | None:
        """Leave out of (point, ..., frequency) what is not there."""
        if array is None:
            return None
        array = by_point(array)
        return array if "frequency" in coords else array[..., 0]

    frequencies = result.velocity.shape[-1]
    efficiency = np.broadcast_to(result.efficiency, result.velocity.shape)
    test = result.intercept_test
    made: dict[str, ArrayLike | None] = {
        "velocity": fields(result.velocity),
        "velocity_std": fields(result.std),
        "confidence": fields(result.confidence),
        "intercept": fields(result.intercept),
        "intercept_std": fields(result.intercept_std),
        "f_statistic": None if test is None else fields(test.statistic),
        "f_p_value": None if test is None else fields(test.p_value),
        "sse": fields(result.sse),
        "s": fields(result.s),
        "dof": fields(np.repeat(result.dof[:, None], frequencies, axis=1)),
        "rcond": by_point(result.rcond),
        "hadamard": by_point(result.hadamard),
        "efficiency": fields(efficiency),
        "observable": by_point(result.observable),
    }
    if result.basis is not None:
        made["basis"] = by_point(result.basis)
    if result.chi_square_p_value is not None:
        made["chi2_p_value"] = fields(result.chi_square_p_value)
    if (along := result.along) is not None:
        last: Any = slice(None) if "frequency" in coords else 0
        made |= {
            "deficient_point": along.point,
            "observed_rank": along.rank,
            "observed_direction": along.direction,
            "observed_velocity": along.velocity[..., last],
            "observed_velocity_std": along.std[..., last],
            "observed_confidence": along.confidence[..., last],
        }
    if "point" not in coords:
        residual = np.moveaxis(result.residuals(), 1, 0)
        made |= {"residual": fields(residual), "matrix": result.matrix[0]}
    return made


def _attributes(result: PointVelocity) -> dict[str, Any]:
    """Collect headline numbers and what stands behind them."""
    settings = result.system.settings
    found: dict[str, Any] = {
        "rcond": float(np.min(result.rcond)),
        "hadamard": float(np.min(result.hadamard)),
        "dof": float(np.min(result.dof)),
        "sse": float(np.nansum(result.sse)),
        "s": _worst(np.max, result.s),
        "components": int(result.observable.sum(axis=-1).min()),
        "rows": str(result.rows),
        "model": settings.model.name,
        "weights": settings.weights.name,
        "noise_from": result.noise_from,
        "confidence_level": settings.confidence,
        "notes": "\n".join(result.messages),
    }
    test = result.intercept_test
    tests = [result.chi_square_p_value, None if test is None else test.p_value]
    if p_values := [p for p in tests if p is not None]:
        found["lowest_p_value"] = _worst(np.min, *p_values)
    if test is not None and test.statistic.size == 1:
        found["f_statistic"] = float(test.statistic.item())
    return found


def _worst(choose: Callable[[np.ndarray], Any], *arrays: np.ndarray) -> float:
    """Choose the extreme of the numbers that there are; NaN if there are none."""
    values = np.concatenate([np.ravel(a) for a in arrays])
    known = values[np.isfinite(values)]
    return float(choose(known)) if known.size else np.nan


def solved_matrix(directions: Array, rows: Array, intercept: bool) -> Array:
    """Compute the matrix whose conditioning Tables 5.2 to 5.6 state, at each point.

    ``A X`` if the rows are as many as the unknowns, otherwise ``(A X)^T (A X)``, the matrix of
    the normal equations. X has the intercept's column in the full model.

    Parameters
    ----------
    directions : ndarray, shape (view, point, axis)
    rows : ndarray, shape (row, view)

    Returns
    -------
    ndarray, shape (point, parameter, parameter)
    """
    matrix = rows @ design(directions, intercept)
    square = matrix.shape[-2] == matrix.shape[-1]
    return matrix if square else np.swapaxes(matrix, -1, -2) @ matrix


#: Components of a velocity.
AXES = 3


def reciprocal_condition(matrix: Array) -> Array:
    """Compute ``1 / (|M| |M^-1|)`` in the 1-norm, exactly; 1 is ideal, 0 singular.

    Parameters
    ----------
    matrix : ndarray, shape (..., n, n)

    Examples
    --------
    >>> from sldvexp.reconstruction import reciprocal_condition
    >>> round(float(reciprocal_condition([[2, 0], [0, 0.5]])), 3)
    0.25
    """
    if np.shape(matrix)[-1] != AXES:
        return np.asarray(1 / np.linalg.cond(matrix, 1), float)
    # Columns a, b, c have the inverse with the rows b x c, c x a, a x b over |a b c|: all matrices
    # at once that is ten times as fast as LAPACK, one after the other.
    m = np.moveaxis(np.asarray(matrix, float), (-2, -1), (0, 1)).copy()
    rows = [np.cross(m[:, i - 2], m[:, i - 1], axis=0) for i in range(AXES)]
    determinant = np.abs(np.sum(m[:, 0] * rows[0], axis=0))
    size = np.abs(m).sum(axis=0).max(axis=0) * np.abs(rows).sum(axis=0).max(axis=0)
    return np.divide(determinant, size, out=np.zeros_like(determinant), where=size != 0)


def hadamard_condition(matrix: Array) -> Array:
    """Compute the Hadamard condition number ``|det M| / product of the rows' Euclidean lengths``.

    It is 1 for orthogonal rows and 0 for dependent ones, by Hadamard's inequality. Kreis, cited in
    Section 5.2.1, asks for more than 0.1.

    Parameters
    ----------
    matrix : ndarray, shape (..., n, n)

    Examples
    --------
    >>> from sldvexp.reconstruction import hadamard_condition
    >>> round(float(hadamard_condition([[1, 0], [1, 1]])), 3)
    0.707
    """
    length = np.prod(np.linalg.norm(matrix, axis=-1), axis=-1)
    return np.abs(np.linalg.det(matrix)) / np.where(length > 0, length, 1.0)


def contravariant_basis(rows: Array) -> Array:
    """Compute base vectors g^j with ``g_i . g^j = delta_ij`` (Eqs 5.13 and 5.16).

    ``g^1 = g_2 x g_3 / (g_1 . (g_2 x g_3))`` and in turn: the rows of the inverse transposed.

    Parameters
    ----------
    rows : ndarray, shape (..., 3, axis)
        The base vectors g_i: direction cosines, or differences of them.

    Returns
    -------
    ndarray, shape (..., 3, axis)
        NaN where the three rows are coplanar: they have no such basis.
    """
    g1, g2, g3 = np.moveaxis(rows, -2, 0)
    crossed = np.stack([np.cross(g2, g3), np.cross(g3, g1), np.cross(g1, g2)], axis=-2)
    volume = np.einsum("...i,...i->...", g1, crossed[..., 0, :])[..., None, None]
    return crossed / np.where(volume == 0, np.nan, volume)
