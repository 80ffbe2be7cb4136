"""`check=needed_components`: whether a point's velocity needs some of its components (5.2.7).

Reading a regressed V_x as what a beam along x would measure takes V_y and V_z for zero in the model
``v = D V``. The hypothesis is tested as any linear one, ``F = V_0^* C_0^-1 V_0 / q`` with C_0 the
covariance of the components in question and q their real numbers, which is Eq 5.17's drop of the
sum of squares. V is the least squares of all views, whose error is independent of the residuals.
The dissertation rejects the hypothesis, and concludes that regressed coefficients may not be read
as components; what is rejected is only that the point moves along x alone.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from sldvexp import dataset
from sldvexp.check.base import Check, Examination
from sldvexp.check.single_point import SinglePoint
from sldvexp.config.registry import register
from sldvexp.errors import Checks, nearest
from sldvexp.lazy import xarray as xr
from sldvexp.statistics import f_test


@register("check", "needed_components")
@dataclass
class NeededComponents(Check):
    """Test of the hypothesis that some components of one point's velocity are zero.

    Parameters
    ----------
    zero : list of str
        Components that are zero by the hypothesis, of x, y and z.
    confidence : float
        One minus the size of the test.
    """

    zero: list[str] = field(default_factory=lambda: ["y", "z"])
    confidence: float = 0.95

    def __post_init__(self) -> None:
        checks = Checks()
        checks.probability("confidence", self.confidence)
        checks.require(bool(self.zero), "zero", "must name components, as in [y, z]")
        for name in self.zero:
            told = f"{name!r} is no component; {nearest(name, 'xyz')}"
            checks.require(name in ("x", "y", "z"), "zero", told)
        once = "names a component twice"
        checks.require(len(set(self.zero)) == len(self.zero), "zero", once)
        checks.done()

    def examine(self, run: Examination) -> xr.Dataset:
        """Find F of the hypothesis, its critical value and p-value.

        Raises
        ------
        UserError
            If the run has no single point.
        """
        point = SinglePoint.from_run(run, "needed_components")
        fit = point.fit_of_all()
        which = ["xyz".index(name) for name in self.zero]
        velocity = (fit.solution[0] @ point.velocity)[which]
        weighed = np.linalg.solve(fit.cofactor[0][np.ix_(which, which)], velocity)
        k, square = point.components, (velocity.conj() * weighed).real.sum(axis=0)
        if point.std is not None:
            variance, dof = np.ones_like(square), np.inf
        else:
            residual = fit.residual[0] @ point.velocity
            dof = k * len(residual)
            variance = (np.abs(residual) ** 2).sum(axis=0) / dof if dof else square * np.nan
        with np.errstate(divide="ignore", invalid="ignore"):
            statistic = square / (k * len(which)) / variance
        test = f_test(statistic, k * len(which), dof, self.confidence)
        known = point.methods["point"]
        shape = known["s"].shape
        coords = {"frequency": known["frequency"].values} if shape else {}
        return dataset.group(
            "examined/needed_components",
            coords,
            f_statistic=test.statistic.reshape(shape),
            f_critical=test.critical.reshape(shape),
            f_p_value=test.p_value.reshape(shape),
            reject=test.reject.reshape(shape),
        ).assign_attrs(zero=", ".join(self.zero))
