"""Checks of Sections 5.2.6 and 5.2.7: on points whose noise is known, and on the measured one."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from sldvexp.check import Examination
from sldvexp.check.equivalent_methods import EquivalentMethods
from sldvexp.check.kreis import Kreis
from sldvexp.check.needed_components import NeededComponents
from sldvexp.errors import ConfigError, UserError
from sldvexp.reconstruction import Absolute, Combined, Weights

DIRECTIONS = np.array(
    [
        [-0.0095, 0.2203, 0.9754],
        [0.3488, 0.2398, 0.9060],
        [0.1771, 0.1265, 0.9760],
        [-0.1378, -0.0837, 0.9869],
        [0.3337, -0.0712, 0.9400],
    ]
)
NAMES = list("12345")
#: As many frequencies are as many draws of the noise.
DRAWS = 4000
STD = np.array([1.0, 2.0, 0.5, 1.0, 1.5]) * 1e-3
#: Three standard errors of a share of 5 %.
NEAR = 3 * np.sqrt(0.05 * 0.95 / DRAWS)


def run_of(true, methods, *, std=None, is_complex=True, seed=1) -> Examination:
    """Make a run of one point: the same velocity with other noise at each frequency."""
    rng = np.random.default_rng(seed)
    noise = (
        rng.normal(size=(2, len(NAMES), DRAWS))
        * (STD if std is not None else 1e-3 + 0 * STD)[:, None]
    )
    velocity = (DIRECTIONS @ np.asarray(true))[:, None] + noise[0]
    velocity = velocity + 1j * noise[1] if is_complex else velocity
    frequency = 1.0 + np.arange(DRAWS)
    seen = xr.Dataset(
        {
            "direction_cosines": (("view", "axis"), DIRECTIONS),
            "velocity": (("view", "frequency"), velocity),
        },
        {"view": NAMES, "axis": list("xyz"), "frequency": frequency},
    )
    if std is not None:
        seen["velocity_std"] = ("view", "frequency"), np.repeat(std[:, None], DRAWS, axis=1)
    groups = {n: m.group(seen) for n, m in methods.items()}
    return Examination(groups | {"line_of_sight": seen}, rng=np.random.default_rng(0))


def methods_of(weights):
    return {
        "point": Absolute(weights=weights),
        "compare/three": Combined("1-5,2,4", weights=weights),
        "compare/four": Combined("1-5,2,3,4", weights=weights),
    }


@pytest.mark.one_in(4)
@pytest.mark.parametrize("is_complex", [True, False])
@pytest.mark.parametrize("std", [None, STD])
@pytest.mark.parametrize("other", ["compare/three", "compare/four"])
def test_equal_velocities_are_told_apart_as_often_as_the_test_says(other, std, is_complex):
    methods = methods_of(Weights.equal if std is None else Weights.noise)
    run = run_of([1.0, -2.0, 5.0], methods, std=std, is_complex=is_complex)
    found = EquivalentMethods(other).examine(run)
    np.testing.assert_allclose(found["reject"].mean("frequency"), 0.05, atol=NEAR)
    known = run.groups[other]["velocity"] - run.groups["point"]["velocity"]
    np.testing.assert_allclose(found["difference"], known, atol=1e-12)


def test_a_pose_that_is_wrong_tells_methods_apart():
    run = run_of([1.0, -2.0, 5.0], methods_of(Weights.noise), std=STD)
    run.groups["line_of_sight"]["velocity"][0] += 0.1
    groups = {n: m.group(run.groups["line_of_sight"]) for n, m in methods_of(Weights.noise).items()}
    run = Examination(groups | {"line_of_sight": run.groups["line_of_sight"]}, rng=run.rng)
    found = EquivalentMethods("compare/three").examine(run)
    assert (found["reject"].mean("frequency") > 0.9).all()


@pytest.mark.one_in(2)
@pytest.mark.parametrize("is_complex", [True, False])
@pytest.mark.parametrize("std", [None, STD])
def test_components_that_are_zero_are_needed_as_often_as_the_test_says(std, is_complex):
    methods = methods_of(Weights.equal if std is None else Weights.noise)
    run = run_of([3.0, 0.0, 0.0], methods, std=std, is_complex=is_complex)
    found = NeededComponents().examine(run)
    assert found["reject"].mean().item() == pytest.approx(0.05, abs=NEAR)
    assert NeededComponents(["x"]).examine(run)["reject"].all()
    assert found.attrs["zero"] == "y, z"


def test_needed_components_are_the_drop_of_the_sum_of_squares():
    """Eq 5.17's F, with V_y and V_z left out of the columns."""
    run = run_of([1.0, 2e-3, 1e-3], methods_of(Weights.equal))
    found = NeededComponents(["y", "z"]).examine(run)
    velocity = run.groups["line_of_sight"]["velocity"].values
    sse = []
    for columns in (DIRECTIONS[:, :1], DIRECTIONS):
        left = velocity - columns @ np.linalg.lstsq(columns, velocity, rcond=None)[0]
        sse.append((np.abs(left) ** 2).sum(axis=0))
    expected = (sse[0] - sse[1]) / 4 / (sse[1] / 4)
    np.testing.assert_allclose(found["f_statistic"], expected, rtol=1e-9)


def test_kreis_judges_as_many_rows_as_unknowns():
    methods = methods_of(Weights.equal) | {"compare/first": Absolute("1,2,3")}
    run = run_of([1.0, 0.0, 0.0], methods)
    found = Kreis().examine(run)
    at = dict(zip(found["method"].values.tolist(), range(4), strict=True))
    assert found["judged"].values.tolist() == [0, 1, 0, 1]
    assert found["meets_by_rcond"].values[at["compare/three"]] == 1
    assert found["meets_by_rcond"].values[at["compare/first"]] == 0
    assert found["hadamard"].values[at["compare/three"]] == pytest.approx(0.5399, abs=1e-4)
    assert found.attrs["notes"] == (
        "Kreis's criterion, a reciprocal condition number above 0.1, is met by compare/three and "
        "not by compare/first: the views' errors grow more there"
    )
    assert Kreis(0.02).examine(run).attrs["notes"] == ""
    assert "is met by no method" in Kreis(0.7).examine(run).attrs["notes"]


def test_what_cannot_be_compared_is_said():
    run = run_of([1.0, 0.0, 0.0], methods_of(Weights.equal))
    with pytest.raises(UserError, match="there is no compare/thre; did you mean compare/three"):
        EquivalentMethods("compare/thre").examine(run)
    with pytest.raises(UserError, match="point and point are one estimator"):
        EquivalentMethods("point").examine(run)
    with pytest.raises(ConfigError, match="'w' is no component"):
        NeededComponents(["w"])
    with pytest.raises(ConfigError, match="names a component twice"):
        NeededComponents(["y", "y"])
    several = run.groups["point"].expand_dims(point=["a", "b"])
    with pytest.raises(UserError, match="is for the views of a single point"):
        NeededComponents().examine(Examination(run.groups | {"point": several}, rng=run.rng))
