"""Each view predicted by the others: their joint fit, seen from where the view is stated to stand.

What is left of the pixels, ``y_k - A_k m_(-k)``, is their noise, the error of the prediction, and
what the view's own pose, gain or phase are off. A view that is wrong spoils the predictions of the
others, too, so that the largest misfit need not be its own: the verdict's own tests say whether any
view is wrong (`sldvexp.verdict.comparison`), and its diagnosis names it (`diagnosis`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sldvexp.errors import UserError
from sldvexp.field.visibility.view import views_of
from sldvexp.laser import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.typing import Array, BoolArray
from sldvexp.verdict.beams import MeasuredSurface, PixelBeams
from sldvexp.verdict.comparison import Bench, bench_of, compare_views, stated_covariance
from sldvexp.verdict.diagnosis import diagnose
from sldvexp.verdict.explanation import LEAST_PIXELS, LEAST_VIEWS, tells_views_apart
from sldvexp.verdict.joint_fit import JointFit
from sldvexp.verdict.lines import at_few_lines
from sldvexp.volume import Volume


@dataclass(frozen=True, eq=False)
class Prediction:
    """What views measured against what the others say that they should, root mean squares.

    Of few frequencies; where their noise differs, each counts by its own.

    Attributes
    ----------
    views : list of str
    error : ndarray, shape (view,), m/s
        Of measured minus predicted velocity.
    expected : ndarray, shape (view,), m/s
        That of a view that is right: its noise, with what noise and poses do to the prediction.
    measured : ndarray, shape (view,), m/s
        Of the velocity itself.
    noise : ndarray, shape (view,), m/s
        That is stated; NaN where none is.
    p_value : ndarray, shape (view,)
        Smallest of the verdict's tests of the view, times their number.
    named : ndarray of bool, shape (view,)
        True for the view that the verdict names, or for each of two.
    """

    views: list[str]
    error: Array
    expected: Array
    measured: Array
    noise: Array
    p_value: Array
    named: BoolArray


def predict_views(groups: Mapping[str, xr.Dataset], laser: TwoMirror, volume: Volume) -> Prediction:
    """Leave out each view in turn.

    Parameters
    ----------
    groups : mapping of str to xarray.Dataset
        With the groups ``pose`` and ``image/<view>``.

    Raises
    ------
    UserError
        If too few views see enough of the surface, or nothing that they see moves.
    """
    few, surface = at_few_lines(groups), MeasuredSurface.of(volume, laser)
    views = [
        view
        for view in views_of(few, laser)
        if len(PixelBeams.trace(view, surface, np.flatnonzero(view.usable)).pixel) >= LEAST_PIXELS
    ]
    if len(views) < LEAST_VIEWS:
        raise UserError(
            f"a view can only be predicted from three others at least; {len(views)} have "
            f"{LEAST_PIXELS} usable pixels on the surface, scan more views"
        )
    bench = bench_of(views, surface, stated_covariance(few["pose"], views))
    if bench is None:
        raise UserError("no view can be predicted from the others: nothing that they see moves")
    fit = bench.fit()
    tests = compare_views(bench, fit)
    p_value = np.array(list(tests.p_value.values()))
    each = np.array([_left_out(bench, k) for k in range(len(views))])
    error, expected, measured, noise = each.T
    return Prediction(
        bench.names,
        error,
        expected,
        measured,
        noise,
        np.minimum(1, len(p_value) * p_value.min(axis=0)),
        _named(bench, fit) if tests.rejects else np.zeros(len(views), bool),
    )


def _named(bench: Bench, fit: JointFit) -> BoolArray:
    """Name the view whose mistake explains a disagreement best, or two if it is not clear."""
    named, ranked = np.zeros(len(bench.data), bool), diagnose(bench, fit)
    if ranked[0].view:
        for found in tells_views_apart(ranked):
            named[list(found.view if found else ())] = True
    return named


def _left_out(bench: Bench, k: int) -> Array:
    """Predict one view: root mean squares of error, that expected, velocity and noise, m/s."""
    others, data = bench.without(k), bench.data[k]
    seen, std = others.velocity(k), data.std[others.designs[k].present]
    noise = np.ones_like(seen) if bench.stated else np.full_like(seen, np.nan)
    expected = noise * np.sqrt(others.prediction_variance(k))
    each = np.stack([seen - others.predicted(k), expected, seen, noise])
    numbers = len(std) * data.view.velocity.shape[1]  # pixels and frequencies, of both parts
    return np.asarray(np.linalg.norm(std[:, None] * each, axis=(1, 2)) / np.sqrt(numbers))
