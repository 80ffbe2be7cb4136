"""Comparison of all views with one smooth field, and the family of tests that tells a wrong one.

Each view is tested for a complex factor of its own (gain and phase at once), for a pose further off
than its bounds, for an origin that is, and as a whole, by leaving it out; a family of four tests a
view that is held to 1 % together (Bonferroni). A moved tripod shows in two or three combinations of
the six numbers of a pose: a test of three numbers sees it better than one of six. They are F-tests
against the misfit that is left, so that noise stated 5 % too low rejects no view; the misfit of all
views together is a test of the stated noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sldvexp.field import PoseErrors, View
from sldvexp.lazy import scipy
from sldvexp.lazy import xarray as xr
from sldvexp.typing import Array
from sldvexp.verdict.beams import MeasuredSurface, PixelBeams
from sldvexp.verdict.explanation import LARGE_MISFIT, LEAST_PIXELS, POSE, ViewTests
from sldvexp.verdict.field_around import FieldAround
from sldvexp.verdict.joint_fit import JointFit, PixelDesign
from sldvexp.verdict.pixel_data import PixelData, compared_beams, pixel_data
from sldvexp.verdict.smooth_field import SmoothField

#: Tests of every view.
TESTS = ("factor", "pose", "origin", "whole")
#: Intervals of the smooth field along the longest side; more are tried while the misfit falls.
INTERVALS = (3, 5, 7, 10, 14, 18)
#: Relative fall of the misfit that a finer field must bring.
FALL = 0.02
#: F of a view that the fit has moved off the surface.
SURELY = 1e9
#: Standard deviations of its prior that a pose is followed to at most.
FARTHEST = 8.0


@dataclass(frozen=True, eq=False)
class Bench:
    """Pixels of all views with what a fit of them needs.

    Attributes
    ----------
    prior : ndarray, shape (6 view + 1, error)
        Factor L of the covariance of the poses and of the surface's height.
    stated : bool
        True if the views state their noise.
    truncation : float
        Part of the misfit's variance that a field of these knots cannot follow, as is expected.
    intervals : int
        Of the smooth field along the longest side.
    few_pixels : bool
        True if more of them were not tried because the pixels are too few.
    at_stated : JointFit, optional
        Fit with designs at the stated poses, where one of these data and this prior is made.
    """

    data: Sequence[PixelData]
    surface: MeasuredSurface
    smooth: SmoothField
    prior: Array
    stated: bool
    truncation: float = 0.0
    intervals: int = 0
    few_pixels: bool = False
    at_stated: JointFit | None = None

    @property
    def names(self) -> list[str]:
        """Names of the views."""
        return [d.view.name for d in self.data]

    @property
    def _made(self) -> JointFit | None:
        """Fit at the stated poses, if it is of these data and this prior."""
        fit = self.at_stated
        same = fit is not None and fit.data is self.data and fit.prior is self.prior
        return fit if same else None

    @cached_property
    def as_stated(self) -> list[PixelDesign]:
        """Designs of all views at the poses and the height that are stated."""
        if (fit := self._made) is not None:
            return list(fit.designs)
        return [PixelDesign.of(data, data.beams, self.smooth) for data in self.data]

    def design(self, k: int, errors: Array) -> PixelDesign:
        """Trace a view whose pose and height are off by `errors`, shape (6 view + 1,)."""
        data, surface = self.data[k], self.surface.raised(errors[-1])
        view = data.view.moved(errors[POSE * k : POSE * (k + 1)])
        return PixelDesign.of(data, PixelBeams.trace(view, surface, data.pixel), self.smooth)

    def designs(self, errors: Array) -> list[PixelDesign]:
        """Trace all views."""
        return [self.design(k, errors) for k in range(len(self.data))]

    def fit(self) -> JointFit:
        """Fit all views, the designs taken again at the estimated poses."""
        return self.again(self._made or JointFit(self.data, self.as_stated, self.prior))

    def without(self, k: int) -> JointFit:
        """Fit all views but one, which this fit predicts from where it is stated to stand."""
        others = [i for i in range(len(self.data)) if i != k]
        return self.again(JointFit(self.data, self.as_stated, self.prior, views=others))

    def with_noise(self, k: int, times: float) -> Bench:
        """Take the noise of a view as so many times the stated one."""
        data = list(self.data)
        of = data[k]
        data[k] = replace(
            of, velocity=of.velocity / times, weight=of.weight / times, std=of.std * times
        )
        return replace(self, data=data)

    def again(self, fit: JointFit) -> JointFit:
        """Fit once more with the designs at the poses that a fit has found.

        A gross mistake throws poses to where nothing is seen; no design follows it there.
        """
        standard = np.clip(fit.standard + fit.step, -FARTHEST, FARTHEST)
        designs = self.designs(self.prior @ standard)
        return JointFit(self.data, designs, self.prior, standard, fit.views)


def bench_of(
    views: Sequence[View], surface: MeasuredSurface, covariance: Array | None
) -> Bench | None:
    """Lay out views for comparison; None if one sees too little, or nothing moves.

    Parameters
    ----------
    covariance : ndarray, shape (6 view, 6 view), optional
        Of the poses; without it they are taken as exact.
    """
    data, stated = pixel_data(views, [compared_beams(view, surface) for view in views])
    if min((len(d.pixel) for d in data), default=0) < LEAST_PIXELS:
        return None
    if not any(np.any(d.velocity) for d in data):
        return None
    prior = prior_factor(covariance, len(data), surface.thickness)
    best: Bench | None = None
    misfit, before = np.inf, 0
    for intervals in INTERVALS:
        smooth = FieldAround.on(surface.nodes, intervals)
        if best is not None and pixels_for(smooth) > sum(len(d.pixel) for d in data):
            best = replace(best, few_pixels=True)
            break  # on a surface that bends a lot functions grow as the cube of intervals
        tried = Bench(data, surface, smooth, prior, stated)
        fit = JointFit(data, tried.as_stated, prior)
        found = fit.squares / max(fit.dof, 1)
        if (best is not None and found > (1 - FALL) * misfit) or fit.dof <= 0:
            break
        left = 0.0 if best is None else _truncation(misfit, found, before / intervals)
        best = replace(tried, truncation=left, intervals=intervals, at_stated=fit)
        misfit, before = found, intervals
    return best


def pixels_for(smooth: SmoothField) -> int:
    """Give how many pixels of all views a smooth field takes, two for each of its unknowns."""
    return 2 * 3 * smooth.count


def pixels_to_follow(bench: Bench, misfit: float) -> int | None:
    """Give how many pixels of all views let the smooth field follow all that is above the noise.

    None if it does so already, or pixels are not what it lacks.

    Parameters
    ----------
    misfit : float
        Squares over their expectation from the noise, of which `Bench.truncation` is a part.
    """
    beyond, allowed = bench.truncation * misfit, LARGE_MISFIT - 1
    if not bench.few_pixels or beyond <= allowed:
        return None
    wanted = bench.intervals * (beyond / allowed) ** (1 / 8)
    enough = next((n for n in INTERVALS if n >= wanted), None)
    return None if enough is None else pixels_for(FieldAround.on(bench.surface.nodes, enough))


def _truncation(coarse: float, fine: float, ratio: float) -> float:
    """Extrapolate what a finer field would still take away, over the misfit of the fine one.

    Cubic splines miss the fourth power of their knots' distance, a variance its eighth.
    """
    part = ratio**8
    return (coarse - fine) * part / (1 - part) / fine


def stated_covariance(pose: xr.Dataset, views: Sequence[View]) -> Array | None:
    """Collect the covariance of the poses of some views, shape (6 view, 6 view); None if exact."""
    errors = PoseErrors.from_dataset(pose, [v.name for v in views])
    return None if errors is None else errors.whole


def prior_factor(covariance: Array | None, views: int, thickness: float) -> Array:
    """Factor the covariance of poses and height, ``L L'``.

    The surface's height is known to a sixth of the volume's thickness, since the volume was laid
    around it to hold it for sure.
    """
    count = POSE * views
    whole = np.zeros((count + 1, count + 1))
    if covariance is not None:
        whole[:count, :count] = covariance
    whole[-1, -1] = (thickness / 6) ** 2
    size = np.sqrt(np.where(np.diag(whole) > 0, np.diag(whole), 1.0))
    values, vectors = np.linalg.eigh(whole / np.outer(size, size))
    kept = values > 1e-12 * values.max()
    return size[:, None] * vectors[:, kept] * np.sqrt(values[kept])


def compare_views(bench: Bench, fit: JointFit) -> ViewTests:
    """Test every view; `fit` is of all, relinearised."""
    variance = max(fit.squares / fit.dof, np.finfo(float).tiny)
    found: dict[str, list[tuple[float, int, float]]] = {name: [] for name in TESTS}
    for k in range(len(bench.data)):
        pose = fit.own_pose_columns(k)
        for name, columns in (
            ("factor", fit.factor_columns(k)),
            ("pose", pose),
            ("origin", pose[:, 3:]),
        ):
            score = fit.score(k, columns)
            freedom = max(score.dof, 1)  # of nothing that moves a factor is no column at all
            found[name].append((score.statistic / freedom / variance, freedom, fit.dof))
        others = JointFit(
            bench.data,
            fit.designs,
            bench.prior,
            fit.standard,
            [i for i in fit.views if i != k],
        )
        freedom, q = max(others.dof, 1), fit.dof - others.dof
        left = max(others.squares / freedom, np.finfo(float).tiny)
        # A view that the fit has moved off the surface is surely wrong.
        excess = (fit.squares - others.squares) / q / left if q > 0 else SURELY
        found["whole"].append((excess, max(q, 1), freedom))
    statistic = {name: np.array([f for f, *_ in of]) for name, of in found.items()}
    p_value = {
        name: np.array([scipy.special.fdtrc(q, n, max(f, 0.0)) for f, q, n in of])
        for name, of in found.items()
    }
    above = scipy.special.chdtrc(fit.dof, fit.squares)
    return ViewTests(statistic, p_value, fit.squares / fit.dof, float(2 * min(above, 1 - above)))
