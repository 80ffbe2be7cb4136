"""`check=equivalent_methods`: whether two methods give the same velocity (Section 5.2.6).

The dissertation calls two solutions "statistically equivalent" where one lies within the confidence
intervals of the other. Both come from the same views, ``V1 = H1 v`` and ``V2 = H2 v``, so that
their difference has the standard error ``sigma |h|`` with h a row of ``(H1 - H2) diag(std)``. Where
sigma is estimated, the difference is itself one of the residuals' directions: it is compared with
what is left of the sum of squares without it, ``F = |d|^2 / (k |h|^2) / ((SSE - |d|^2 / |h|^2) /
(dof - k))`` with k and dof - k degrees of freedom, k being 2 for complex data.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp import dataset
from sldvexp.check.base import Check, Examination
from sldvexp.check.single_point import SinglePoint
from sldvexp.config.registry import register
from sldvexp.errors import Checks, UserError
from sldvexp.lazy import xarray as xr
from sldvexp.statistics import f_test
from sldvexp.typing import Array

#: Part of the views' weights below which two methods are one.
ALIKE = 1e-9


@register("check", "equivalent_methods")
@dataclass
class EquivalentMethods(Check):
    """Two reconstructions of one point: within intervals, and by the test of their difference.

    Parameters
    ----------
    first : str
        Group of the solution whose intervals count, the best of least squares.
    other : str
        Group of the solution that is looked for in them.
    confidence : float
        One minus the size of the test.
    """

    other: str
    first: str = "point"
    confidence: float = 0.95

    def __post_init__(self) -> None:
        checks = Checks()
        checks.probability("confidence", self.confidence)
        checks.done()

    def examine(self, run: Examination) -> xr.Dataset:
        """Find ``difference``, ``inside``, and the test of each component.

        Raises
        ------
        UserError
            If the run has no such methods of a single point, or the two are one.
        """
        point = SinglePoint.from_run(run, "equivalent_methods")
        first = point.method(self.first, "check.equivalent_methods.first")
        other = point.method(self.other, "check.equivalent_methods.other")
        apart = point.fit(other).solution[0, :3] - point.fit(first).solution[0, :3]
        noise = apart if point.std is None else apart * point.std
        length = (noise**2).sum(axis=1)[:, None]
        if (np.abs(apart) < ALIKE).all():
            raise UserError(
                f"check.equivalent_methods: {self.first} and {self.other} are one estimator of "
                "these views; choose two that differ"
            )
        difference = apart @ point.velocity
        bound = first["confidence"].values.reshape(3, -1)
        inside = (np.abs(difference.real) <= bound) & (np.abs(difference.imag) <= bound)
        test = f_test(*self._statistic(point, np.abs(difference) ** 2 / length), self.confidence)
        shape = first["velocity"].shape
        coords = {"component": list("xyz")} | {
            str(d): first[d].values for d in first["velocity"].dims if d == "frequency"
        }
        return dataset.group(
            "examined/equivalent_methods",
            coords,
            difference=difference.reshape(shape),
            inside=inside.reshape(shape),
            f_statistic=test.statistic.reshape(shape),
            f_critical=test.critical.reshape(shape),
            f_p_value=test.p_value.reshape(shape),
            reject=test.reject.reshape(shape),
        )

    def _statistic(self, point: SinglePoint, square: Array) -> tuple[Array, Array, Array]:
        """Compute F with its degrees of freedom from ``|d|^2 / |h|^2``, (component, frequency)."""
        k = point.components
        if point.std is not None:
            return square / k, np.full_like(square, k), np.full_like(square, np.inf)
        residual = point.fit_of_all().residual[0] @ point.velocity
        left = k * len(residual) - k
        rest = (np.abs(residual) ** 2).sum(axis=0) - square
        with np.errstate(divide="ignore", invalid="ignore"):
            statistic = square / k / (rest / left)
        return statistic, np.full_like(square, k), np.full_like(square, left)
