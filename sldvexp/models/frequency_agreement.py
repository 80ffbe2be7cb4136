"""Test of a model's natural frequencies, with tolerances of what it was made with.

With ``m = ln f_measured - ln f_model`` over the paired modes and the sensitivities
``J = d ln f / d ln theta`` of the frequencies to parameters of relative standard uncertainty
sigma_theta, the covariance of m for a right model is

    C = C_measured + C_discretisation + J diag(sigma_theta^2) J'.

``T = m' C^-1 m`` is chi-square of as many degrees of freedom as modes; a fault common to all modes
is seen best by ``z = 1' C^-1 m / sqrt(1' C^-1 1)``. A parameter of sensitivity J_j that is off by x
shows with 95 % power at the 5 % level if ``x sqrt(J_j' C_-j^-1 J_j) = 3.605``, C_-j without its own
tolerance: less than that cannot be told.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sldvexp.lazy import scipy
from sldvexp.lazy import xarray as xr
from sldvexp.statistics import chi_square_p_value
from sldvexp.typing import Array, IntArray

#: Distance in standard errors that a two-sided test at 5 % sees in 95 % of all cases.
SEEN = 3.605


@dataclass(frozen=True, eq=False)
class FrequencyData:
    """Frequencies of the paired modes, and what is known of a right model's.

    Parameters
    ----------
    measured : ndarray, shape (pair,), Hz
    measured_covariance : ndarray, shape (pair, pair)
        Of the logarithms of the measured frequencies.
    computed : ndarray, shape (pair,), Hz
    discretisation : ndarray, shape (pair,)
        Relative standard uncertainty of each computed frequency from the mesh.
    sensitivity : mapping of str to ndarray, shape (pair,)
        Of each parameter, ``d ln f / d ln theta``.
    tolerance : mapping of str to float
        Relative standard uncertainty of each parameter.
    """

    measured: Array
    measured_covariance: Array
    computed: Array
    discretisation: Array
    sensitivity: Mapping[str, Array]
    tolerance: Mapping[str, float]

    @property
    def difference(self) -> Array:
        """Logarithms of measured over computed frequencies, shape (pair,)."""
        return np.asarray(np.log(self.measured / self.computed))

    def covariance(self, without: Sequence[str] = ()) -> Array:
        """Compute C, with the tolerances of all parameters but some, shape (pair, pair)."""
        found = self.measured_covariance + np.diag(self.discretisation**2)
        for name, column in self.sensitivity.items():
            if name not in without:
                found += self.tolerance[name] ** 2 * np.outer(column, column)
        return np.asarray(found)


@dataclass(frozen=True, eq=False)
class KnownFrequencies:
    """Frequencies of all modes of a model, and what is known of them.

    Parameters
    ----------
    computed, discretisation, sensitivity, tolerance
        As of `FrequencyData`, of all modes.
    value : mapping of str to float
        Of each parameter, that the model was made with.
    """

    computed: Array
    discretisation: Array
    sensitivity: Mapping[str, Array]
    tolerance: Mapping[str, float]
    value: Mapping[str, float]

    @property
    def std(self) -> Array:
        """Standard uncertainty of each frequency, shape (mode,), Hz."""
        variance = self.discretisation**2
        for name, column in self.sensitivity.items():
            variance = variance + (self.tolerance[name] * column) ** 2
        return np.asarray(self.computed * np.sqrt(variance))

    def of_pairs(self, modes: xr.Dataset, paired: IntArray, partner: IntArray) -> FrequencyData:
        """Take the frequencies of measured modes and their partners, from 0 both.

        Parameters
        ----------
        modes : xarray.Dataset
            The group ``modes``.
        """
        measured = modes["natural_frequency"].values
        if "pole_covariance" in modes:
            covariance = modes["pole_covariance"].values[np.ix_(paired, paired)]
        else:
            relative = modes["natural_frequency_std"].values[paired] / measured[paired]
            covariance = np.diag(relative**2)
        return FrequencyData(
            measured[paired],
            covariance,
            self.computed[partner],
            self.discretisation[partner],
            {name: column[partner] for name, column in self.sensitivity.items()},
            self.tolerance,
        )


@dataclass(frozen=True)
class FrequencyTest:
    """Outcome of the test of all frequencies.

    Attributes
    ----------
    chi2, p_value : float
    dof : int
    common, common_std : float
        Difference common to all modes, relative: generalised least squares.
    common_p_value : float
    unseen : dict of str to float
        By how much each parameter may be off, relative, without being seen in 95 % of all cases.
    """

    chi2: float
    dof: int
    p_value: float
    common: float
    common_std: float
    common_p_value: float
    unseen: dict[str, float]


def examine_frequencies(data: FrequencyData) -> FrequencyTest:
    """Test measured frequencies against those of a model.

    Examples
    --------
    >>> f = np.array([100.0, 250.0])
    >>> data = FrequencyData(
    ...     1.02 * f, 1e-10 * np.eye(2), f, np.zeros(2), {"E": np.full(2, 0.5)}, {"E": 0.01}
    ... )
    >>> found = examine_frequencies(data)
    >>> round(found.common, 4), round(found.common_std, 4), found.common_p_value < 0.001
    (0.0198, 0.005, True)
    """
    m, c = data.difference, data.covariance()
    weighted = np.linalg.solve(c, np.column_stack([m, np.ones_like(m)]))
    chi2, information = float(m @ weighted[:, 0]), float(weighted[:, 1].sum())
    z = float(weighted[:, 0].sum()) / np.sqrt(information)
    unseen = {}
    for name, column in data.sensitivity.items():
        seen = column @ np.linalg.solve(data.covariance([name]), column)
        unseen[name] = float(SEEN / np.sqrt(seen)) if seen > 0 else np.inf
    return FrequencyTest(
        chi2,
        len(m),
        float(chi_square_p_value(chi2, len(m))),
        float(z / np.sqrt(information)),
        float(1 / np.sqrt(information)),
        float(2 * scipy.special.ndtr(-abs(z))),
        unseen,
    )
