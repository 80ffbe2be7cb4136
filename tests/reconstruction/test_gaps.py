"""Points that a view has not measured are solved from the others, if these are enough."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp import dataset
from sldvexp.errors import UserError
from sldvexp.reconstruction import Absolute, Combined, Contravariant, Relative

VIEWS, POINTS, FREQUENCIES = 5, 4, 3
METHODS = {
    "absolute": Absolute(),
    "relative": Relative(),
    "combined": Combined(),
    "contravariant": Contravariant(rows="1,2,3"),
}


def measured(std=True):
    rng = np.random.default_rng(3)
    d = rng.normal(size=(VIEWS, POINTS, 3)) * [0.5, 0.5, 0] + [0, 0, 1]
    d /= np.linalg.norm(d, axis=-1, keepdims=True)
    v = rng.normal(size=(2, POINTS, 3, FREQUENCIES))
    z = np.einsum("vpa,paf->vpf", d, v[0] + 1j * v[1])
    z = z + 1e-3 * rng.normal(size=z.shape)
    return dataset.group(
        "line_of_sight",
        {
            "view": [str(i + 1) for i in range(VIEWS)],
            "point": list("abcd"),
            "frequency": 100.0 * np.arange(1, FREQUENCIES + 1),
        },
        direction_cosines=d,
        velocity=z,
        **({"velocity_std": rng.uniform(1e-3, 2e-3, z.shape)} if std else {}),
    )


NAMES = [str(i + 1) for i in range(VIEWS)]


def marked(group, gone):
    """Leave velocities out where `gone` says so, shape (view, point, frequency)."""
    made = group.copy(deep=True)
    made["velocity"].values[gone] = np.nan
    made["direction_cosines"].values[gone.all(axis=2)] = np.nan
    if "velocity_std" in made:
        made["velocity_std"].values[gone] = np.nan
    return made


@pytest.mark.one_in(8)
@pytest.mark.parametrize("std", [True, False])
@pytest.mark.parametrize("name", METHODS)
def test_each_point_and_frequency_is_solved_from_the_views_that_are_there(name, std):
    whole, method = measured(std), METHODS[name]
    gone = np.zeros((VIEWS, POINTS, FREQUENCIES), bool)
    gone[3, 2], gone[4, 0, 1], gone[3:, 1, 2], gone[1:4, 3, 0] = True, True, True, True
    found = method.group(marked(whole, gone))
    for p in range(POINTS):
        for f in range(FREQUENCIES):
            there = ~gone[:, p, f]
            own = found["velocity"].isel(point=p, frequency=f)
            if there.sum() < 3:
                assert np.isnan(own).all()
                continue
            # Rows may be chosen by the directions of all points that are solved together.
            same = (gone == gone[:, p, f][:, None, None]).all(axis=0).any(axis=1)
            alike = np.flatnonzero(same)
            one = whole.isel(view=there, point=alike, frequency=[f])
            right = method.group(one).isel(point=int(np.searchsorted(alike, p)))
            for variable in ("velocity", "velocity_std", "confidence", "sse", "dof"):
                np.testing.assert_allclose(
                    found[variable].isel(point=p, frequency=f),
                    right[variable].isel(frequency=0),
                    rtol=1e-9,
                    err_msg=variable,
                )
    assert found["observable"].values.all()
    assert found["velocity"].attrs == method.group(whole)["velocity"].attrs
    assert found.attrs["rcond"] <= float(found["rcond"].min())


@pytest.mark.parametrize("std", [True, False])
def test_headline_numbers_rest_on_no_stand_in(std):
    """They are those of the variables, where a view lacks one frequency of a point."""
    gone = np.zeros((VIEWS, POINTS, FREQUENCIES), bool)
    gone[4, 0, 1] = True
    found = METHODS["absolute"].group(marked(measured(std), gone))
    assert found.attrs["s"] == found["s"].max() < 0.01
    assert found.attrs["sse"] == pytest.approx(found["sse"].sum().item())
    if std:
        assert found.attrs["lowest_p_value"] == found["chi2_p_value"].min() > 1e-4


def test_what_is_told_of_open_components_rests_on_no_stand_in():
    """All views look along one plane at a point that lacks one of them at one frequency."""
    whole = measured()
    cosines = whole["direction_cosines"].values
    cosines[:, 1, 1] = 0.0
    cosines[:, 1] /= np.linalg.norm(cosines[:, 1], axis=-1, keepdims=True)
    gone = np.zeros((VIEWS, POINTS, FREQUENCIES), bool)
    gone[4, 1, 2] = True
    right = METHODS["absolute"].group(whole)["observed_velocity"].values
    found = METHODS["absolute"].group(marked(whole, gone))
    assert found["deficient_point"].values.tolist() == [1]
    np.testing.assert_allclose(found["observed_velocity"].values[..., :2], right[..., :2])
    assert np.isnan(found["observed_velocity"].values[..., 2]).all()


def test_points_of_fewer_views_are_counted():
    whole = measured()
    gone = np.zeros((VIEWS, POINTS, FREQUENCIES), bool)
    gone[4, 1:3], gone[3:, 3], gone[:3, 0] = True, True, True
    found = METHODS["absolute"].group(marked(whole, gone))
    assert found.attrs["notes"].splitlines() == [
        "points that not all 5 views have measured are determined from fewer: 2 from 4, 1 from 3; "
        "1 without a result, as too few are left"
    ]
    assert found["observable"].values.tolist() == [[0] * 3, [1] * 3, [1] * 3, [1] * 3]
    assert np.isnan(found["velocity"].values[0]).all()


def test_fewer_views_have_wider_bounds():
    whole = measured()
    gone = np.zeros((VIEWS, POINTS, FREQUENCIES), bool)
    gone[4, 1] = True
    all_views, fewer = (METHODS["absolute"].group(g) for g in (whole, marked(whole, gone)))
    wider = (fewer["confidence"] / all_views["confidence"]).values
    assert (wider[1] > 1.0).all()
    np.testing.assert_allclose(wider[[0, 2, 3]], 1.0, rtol=1e-10)


def test_no_point_needs_all_views():
    whole = measured()
    gone = np.zeros((VIEWS, POINTS, FREQUENCIES), bool)
    for p in range(POINTS):
        gone[p, p] = True
    found = METHODS["absolute"].group(marked(whole, gone))
    right = METHODS["absolute"].group(whole)["velocity"]
    assert abs(found["velocity"] - right).max() < 0.05
    assert found.attrs["notes"].endswith("are determined from fewer: 4 from 4")


@pytest.mark.one_in(2)
@pytest.mark.parametrize("labels", [NAMES, list("vwxyz")])
def test_number_of_a_row_is_of_the_same_view_where_another_is_missing(labels):
    whole = measured().assign_coords(view=labels)
    gone = np.zeros((VIEWS, POINTS, FREQUENCIES), bool)
    gone[0, 1], gone[1, 2] = True, True
    found = Absolute(rows="2,3,4").group(marked(whole, gone))
    right = Absolute(rows="2,3,4").group(whole)
    lost = np.zeros((POINTS, 3, FREQUENCIES), bool)
    lost[2] = True  # two rows are left
    some = found["velocity"].values
    np.testing.assert_allclose(some[~lost], right["velocity"].values[~lost], rtol=1e-10)
    rows = ",".join(labels[2:4])
    two = Absolute(rows=rows).group(whole.isel(view=[0, 2, 3, 4], point=[2]))
    np.testing.assert_allclose(some[2], two["velocity"].values[0])
    assert found["deficient_point"].values.tolist() == [2]


def test_frequencies_of_one_point():
    whole = measured().isel(point=0)
    gone = np.zeros((VIEWS, FREQUENCIES), bool)
    gone[4, 1], gone[1:4, 2] = True, True
    made = whole.copy(deep=True)
    made["velocity"].values[gone] = np.nan
    found = METHODS["absolute"].group(made)
    right = METHODS["absolute"].group(whole.isel(view=slice(0, 4), frequency=[1]))
    np.testing.assert_allclose(found["velocity"].values[:, 1], right["velocity"].values[:, 0])
    assert np.isnan(found["velocity"].values[:, 2]).all()
    assert np.isnan(found["residual"].values[:, 1:]).all()
    assert found.attrs["notes"] == (
        "frequencies that not all 5 views have measured are determined from fewer: 1 from 4; "
        "1 without a result, as too few are left"
    )


def test_one_velocity_of_one_point():
    whole = measured().isel(point=0, frequency=0)
    made = whole.copy(deep=True)
    made["velocity"].values[2] = np.nan
    found = METHODS["absolute"].group(made)
    right = METHODS["absolute"].group(whole.isel(view=[0, 1, 3, 4]))
    for variable in ("velocity", "confidence", "residual"):
        np.testing.assert_allclose(found[variable].values, right[variable].values)


def test_bounds_of_points_of_fewer_views_hold_as_often_as_they_say():
    rng = np.random.default_rng(11)
    points, sigma = 4000, 1e-3
    d = rng.normal(size=(VIEWS, 1, 3)) * [0.5, 0.5, 0] + [0, 0, 1]
    d = np.repeat(d / np.linalg.norm(d, axis=-1, keepdims=True), points, axis=1)
    z = sigma * (rng.normal(size=(VIEWS, points)) + 1j * rng.normal(size=(VIEWS, points)))
    z[rng.integers(0, VIEWS, points), np.arange(points)] = np.nan
    group = dataset.group(
        "line_of_sight",
        {"view": NAMES, "point": [str(i) for i in range(points)]},
        direction_cosines=d,
        velocity=z,
    )
    found = Absolute().group(group)
    inside = abs(found["velocity"].values.real) <= found["confidence"].values
    rate, limit = inside.mean(axis=0), 3.3 * np.sqrt(0.95 * 0.05 / points)  # 0.1 % two-sided
    assert (abs(rate - 0.95) < limit).all(), rate


def test_nothing_is_left():
    group = measured()
    group["velocity"].values[:3] = np.nan
    with pytest.raises(UserError, match="no point has velocities of 3 views"):
        METHODS["absolute"].group(group)
