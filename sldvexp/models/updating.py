"""Named parameters of a model corrected so that its frequencies fit, with their covariance.

Generalised least squares of ``m = J_adjusted x + e``, x the logarithms of the factors on the
adjusted parameters; e has the covariance of `sldvexp.models.frequency_agreement` with the
tolerances of all parameters that are not adjusted. Parameters that change all frequencies alike
cannot be told from one another: what the data does not determine is refused, and said by names.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sldvexp.errors import UserError
from sldvexp.models.frequency_agreement import FrequencyData
from sldvexp.statistics import chi_square_p_value
from sldvexp.typing import Array

#: Smallest eigenvalue of the correlations' inverse from which parameters are told apart.
APART = 1e-6
#: Share of a direction from which a parameter is named.
NOTABLE = 0.3


@dataclass(frozen=True, eq=False)
class UpdatedParameters:
    """Parameters that fit the measured frequencies.

    Attributes
    ----------
    names : tuple of str
    factor : ndarray, shape (parameter,)
        On the model's own value of each.
    covariance : ndarray, shape (parameter, parameter)
        Of the factors' logarithms.
    chi2, p_value : float
        Of what the parameters leave.
    dof : int
    """

    names: tuple[str, ...]
    factor: Array
    covariance: Array
    chi2: float
    dof: int
    p_value: float

    @property
    def std(self) -> Array:
        """Relative standard errors, shape (parameter,)."""
        return np.sqrt(np.diag(self.covariance))


def update_parameters(data: FrequencyData, adjust: Mapping[str, float]) -> UpdatedParameters:
    """Adjust parameters to measured frequencies.

    Parameters
    ----------
    adjust : mapping of str to float
        Parameters, each with the relative standard uncertainty of what is known of it beforehand;
        0 if that is nothing.

    Raises
    ------
    UserError
        If the frequencies do not determine them.

    Examples
    --------
    >>> f = np.array([100.0, 250.0])
    >>> column = {"E": np.full(2, 0.5), "rho": np.full(2, -0.5)}
    >>> exact = {"E": 0.0, "rho": 0.0}
    >>> data = FrequencyData(1.01 * f, 1e-10 * np.eye(2), f, np.zeros(2), column, exact)
    >>> update_parameters(data, {"E": 0.0}).factor.round(4).tolist()
    [1.0201]
    >>> update_parameters(data, {"E": 0.0, "rho": 0.0})
    Traceback (most recent call last):
    sldvexp.errors.UserError: adjust: E and rho change the frequencies of these 2 modes alike, so \
that only a combination of them is determined; adjust one of them, or say what is known of the \
others beforehand, as in adjust={rho: 0.01}
    """
    names = list(adjust)
    columns = np.stack([data.sensitivity[name] for name in names], axis=1)
    inverse = np.linalg.inv(data.covariance(names))
    of_data = columns.T @ inverse @ columns
    information = of_data + np.diag([1 / std**2 if std else 0.0 for std in adjust.values()])
    size = np.sqrt(np.diag(information))
    if not (size > 0).all():
        lost = names[int(np.argmin(size))]
        raise UserError(
            f"adjust.{lost}: changes none of the frequencies, so that they tell nothing"
        )
    values, vectors = np.linalg.eigh(information / np.outer(size, size))
    if values[0] < APART:
        some = [n for n, x in zip(names, np.abs(vectors[:, 0]), strict=True) if x > NOTABLE]
        raise UserError(
            f"adjust: {' and '.join(some)} change the frequencies of these {len(columns)} modes "
            "alike, so that only a combination of them is determined; adjust one of them, or say "
            f"what is known of the others beforehand, as in adjust={{{some[-1]}: 0.01}}"
        )
    covariance = np.asarray(np.linalg.inv(information))
    x = covariance @ columns.T @ inverse @ data.difference
    left = data.difference - columns @ x
    chi2 = float(left @ inverse @ left)
    chi2 += sum(float(a / s) ** 2 for a, s in zip(x, adjust.values(), strict=True) if s)
    dof = len(left) - sum(not std for std in adjust.values())
    return UpdatedParameters(
        tuple(names), np.exp(x), covariance, chi2, dof, float(chi_square_p_value(chi2, dof))
    )
