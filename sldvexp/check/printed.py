"""`check=printed`: numbers of Chapter 5 by the conventions that explain the print.

None is used for a result: LINPACK's estimate of the reciprocal condition number, sample deviations
of complex residuals, an F that counts a complex intercept once, and half-widths without a root. The
F of a field, ``(drop of SSE / q) / (SSE / (n - p))`` with n samples, p unknowns and q intercepts,
counts every sample as a measurement of its own, although samples interpolate far fewer pixels.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sldvexp import dataset
from sldvexp.check.base import Check, Examination
from sldvexp.config.registry import register
from sldvexp.errors import UserError, nearest
from sldvexp.lazy import scipy
from sldvexp.lazy import xarray as xr
from sldvexp.typing import Array


@register("check", "printed")
@dataclass
class Printed(Check):
    """LINPACK's condition estimate, sample deviations, F and half-widths as they were printed.

    Parameters
    ----------
    partial, full : str
        Groups of the model without and with the intercept, for Eq 5.17. Those of a field, as
        ``field`` and ``compare/full``, have Table 5.7's F.
    decimals : int
        Eq 5.17 is computed from numbers as tabulated, with so many decimals.
    """

    partial: str = "point"
    full: str = ""
    decimals: int = 4

    def examine(self, run: Examination) -> xr.Dataset:
        """Find one entry of each for every reconstruction of the run."""
        methods = [name for name in run.groups if name.split("/")[0] in ("point", "compare")]
        every = [*methods, "field"] if "field" in run.groups else methods
        for name in (self.partial, self.full):
            if name and name not in every:
                raise UserError(f"check.printed: there is no {name}; {nearest(name, every)}")
        if self.full and self.partial in run.groups and "samples" in run.groups[self.partial].attrs:
            return _of_fields(run.groups[self.partial], run.groups[self.full])
        rows = {name: _conventions(run.groups[name]) for name in methods}
        columns = {
            key: np.array([row[key] for row in rows.values()]) for key in next(iter(rows.values()))
        }
        more = {}
        if self.full:
            partial, full = run.groups[self.partial], run.groups[self.full]
            tabulated = partial.attrs["sse"], full.attrs["sse"], rows[self.full]["std"]
            more["f_statistic"] = printed_f(*(round(x, self.decimals) for x in tabulated))
            more["f_critical"] = float(scipy.special.fdtri(1, full.sizes["row"] - 1, 0.95))
        return dataset.group("examined/printed", {"method": methods}, **columns, **more)


def _of_fields(partial: xr.Dataset, full: xr.Dataset) -> xr.Dataset:
    """Test the intercepts of all nodes as Section 5.4 does, each sample taken for a measurement."""
    added = full.attrs["dof"] - partial.attrs["dof"]
    freedom = full.attrs["samples"] - full.attrs["dof"]
    sse_partial, sse_full = (g["sse"].sum("equation") for g in (partial, full))
    return dataset.group(
        "examined/printed",
        {"frequency": full["frequency"].values},
        f_statistic=((sse_partial - sse_full) / added / (sse_full / freedom)).values,
        f_critical=float(scipy.special.fdtri(added, freedom, 0.95)),
    )


def _conventions(point: xr.Dataset) -> dict[str, Any]:
    """Compute the printed numbers of one reconstruction of a single point."""
    if "matrix" not in point:
        raise UserError("check=printed is for a single point's reconstruction")
    matrix = point["matrix"].values
    residual = point["residual"].values
    least_squares = len(residual) > len(matrix)
    nothing = np.full(3, np.nan)
    std, width = np.nan, nothing
    if least_squares:
        std = sample_std(residual)
    if least_squares and len(matrix) == 3:
        v_ii = np.diag(np.linalg.inv(matrix))
        width = printed_half_width(std, v_ii)
    return {
        "linpack_rcond": linpack_rcond(matrix),
        "std": std,
        "half_width": width,
    }


def sample_std(residuals: ArrayLike) -> float:
    """Compute the std of Tables 5.5 and 5.6: mean removed, divisor n - 1, complex modulus."""
    return float(np.std(np.asarray(residuals), ddof=1))


def printed_f(sse_partial: float, sse_full: float, std_full: float) -> float:
    """Compute F of Eq 5.17: the drop of the sum of squares over the squared `sample_std`.

    That counts the intercept once and leaves n - 1 degrees of freedom; a complex intercept has two
    and leaves 2 (n - 4). The print follows from the numbers as tabulated, to four decimals.
    """
    return (sse_partial - sse_full) / std_full**2


def printed_half_width(s: float, v_ii: ArrayLike) -> Array:
    """Compute half-widths as in Section 5.2.6: 1.96 s v_ii, without Eq 5.18's square root.

    Parameters
    ----------
    s : float
        Sample standard deviation of the residuals.
    v_ii : array_like
        Diagonal of the inverse of ``D^T D``.
    """
    return 1.96 * s * np.asarray(v_ii, float)


def linpack_rcond(matrix: ArrayLike) -> float:
    """Estimate the reciprocal condition number as `dgeco` did, hence MATLAB 5's ``rcond``.

    With ``A = P L U`` it solves ``A^T y = e`` and ``A z = y``, choosing the signs of ``e = +-1``
    one by one so that y grows, and returns ``|y| / (|A| |z|)`` in the 1-norm. ``|z| / |y|`` is a
    lower bound of the inverse's norm: the estimate is never below the true value.

    Parameters
    ----------
    matrix : array_like, shape (n, n)

    Returns
    -------
    float
        0 for a singular matrix.
    """
    a = np.asarray(matrix, float)
    permutation, lower, upper = scipy.linalg.lu(a)
    if not np.all(np.diag(upper)):
        return 0.0
    w = _growing_solution(upper)
    y = permutation @ scipy.linalg.solve_triangular(lower.T, w, unit_diagonal=True)
    z = scipy.linalg.solve_triangular(lower, permutation.T @ y, lower=True, unit_diagonal=True)
    z = scipy.linalg.solve_triangular(upper, z)
    return float(np.abs(y).sum() / (np.abs(a).sum(axis=0).max() * np.abs(z).sum()))


def _growing_solution(upper: np.ndarray) -> np.ndarray:
    """Solve ``U^T w = e`` with each sign of e taken so that what follows is larger."""
    n = len(upper)
    w = np.zeros(n)
    done = np.zeros(n)  # what the w found so far contribute to each equation
    for k in range(n):
        sign = -1.0 if done[k] > 0 else 1.0
        trials = []
        for e in (sign, -sign):
            w_k = (e - done[k]) / upper[k, k]
            following = done[k + 1 :] + w_k * upper[k, k + 1 :]
            trials.append((abs(e - done[k]) + np.abs(following).sum(), w_k, following))
        _, w[k], done[k + 1 :] = max(trials, key=lambda trial: trial[0])
    return w
