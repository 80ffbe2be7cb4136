"""Bounds of mode shapes hold the error of their poles too, and tell how much it is."""

from __future__ import annotations

import numpy as np
import pytest
from synthetic import identified, session

from sldvexp import dataset, modes
from sldvexp.lazy import xarray as xr
from sldvexp.modes.images import ModalProjection
from sldvexp.modes.model import poles_of
from sldvexp.modes.shape_bounds import pole_variance

CLOSE = np.array([545.0, 549.0])


def test_shapes_change_with_their_poles_as_told():
    """Fits of the same lines at slightly other poles."""
    view, _ = session(3, 0.05, 40, frequency=CLOSE, damping=0.01)
    found = identified(view)
    responses = modes.Responses.from_images({"view0": view})
    fit, step = found.fit, 1e-6
    size, damping = np.abs(fit.pole), -fit.pole.real / np.abs(fit.pole)
    unknowns = np.log([*size, *damping])

    def image(at):
        poles = poles_of(np.exp(at[:2]), np.exp(at[2:]))
        other = ModalProjection(poles, fit.beyond, responses.frequency, fit.weight, fit.harmonics)
        return next(iter(other.images(responses))).velocity

    shape = image(unknowns)
    for k in range(4):
        moved = np.eye(4)[k] * step
        slope = (image(unknowns + moved) - image(unknowns - moved)) / (2 * step)
        told = shape[:, [k % 2]] * found.projection.changes[k]
        # What poles do besides, a pixel's noise times their error, is small of second order.
        assert np.abs(slope - told).max() < 0.2 * np.abs(told).max()


def as_field(image: xr.Dataset) -> xr.Dataset:
    """Take the pixels of a modal image for the nodes of a field, with its bounds."""
    velocity, std = image["velocity"].values[:, None], image["velocity_std"].values[:, None]
    both = np.stack([std, std])
    return dataset.group(
        "field",
        {
            "component": ["z"],
            "frequency": image["frequency"].values,
            "part": ["real", "imaginary"],
            "source": ["noise"],
        },
        velocity=velocity,
        velocity_std=std,
        confidence=1.96 * std,
        velocity_std_by_part=both,
        confidence_by_part=1.96 * both,
        variance=std[None] ** 2,
    )


def check_coverage(seeds, pixels):
    """Compare mean squares of errors with told variances, and with those of pixels alone."""
    whole, narrow = [], []
    for seed in seeds:
        view, shape = session(seed, 0.02, pixels, frequency=CLOSE, damping=0.01)
        found = identified(view)
        field = modes.with_pole_errors(as_field(found.images["view0"]), found.modes)
        error = field["velocity"].values[:, 0] - shape
        parts = np.stack([error.real, error.imag])
        std = field["velocity_std_by_part"].values[:, :, 0]
        whole.append(np.mean((parts / std) ** 2))
        narrow.append(np.mean((parts / found.images["view0"]["velocity_std"].values) ** 2))
    return np.array(whole), np.array(narrow)


@pytest.mark.parametrize(
    ("seeds", "pixels"),
    [
        pytest.param(8, 100, marks=pytest.mark.whole),
        pytest.param(60, 400, marks=pytest.mark.long),
    ],
)
def test_intervals_of_shapes_hold_the_error_that_all_pixels_share(seeds, pixels):
    whole, narrow = check_coverage(range(seeds), pixels)
    # Errors of one session go together: its mean square scatters as of a few numbers.
    chance = 3.3 * whole.std(ddof=1) / np.sqrt(seeds)
    assert abs(whole.mean() - 1) < chance
    assert narrow.mean() > 1 + chance


def test_the_budget_adds_up_and_each_bound_is_of_the_larger_part():
    view, _ = session(1, 0.02, 60, frequency=CLOSE, damping=0.01)
    found = identified(view)
    before = as_field(found.images["view0"])
    after = modes.with_pole_errors(before, found.modes)
    assert after["source"].values.tolist() == ["noise", "poles"]
    square = after["velocity_std"] ** 2
    assert after["variance"].sum("source").values == pytest.approx(square.values, rel=1e-9)
    assert np.array_equal(after["confidence"], after["confidence_by_part"].max("part"))
    assert np.all(after["velocity_std_poles"] <= after["velocity_std"])
    assert np.all(after["confidence"] >= before["confidence"])
    assert after["confidence"].dims == before["confidence"].dims


def test_variances_are_those_of_drawn_poles():
    rng = np.random.default_rng(0)
    root = rng.normal(size=(4, 4))
    shape = rng.normal(size=(3, 2)) + 1j * rng.normal(size=(3, 2))
    change = rng.normal(size=(4, 2)) + 1j * rng.normal(size=(4, 2))
    drawn = rng.normal(size=(20000, 4)) @ root.T
    moved = np.einsum("si,nia->sna", drawn, np.tile(shape, 2)[:, :, None] * change)
    told = pole_variance(shape, change, root @ root.T)
    found = np.stack([moved.real.var(axis=0), moved.imag.var(axis=0)])
    assert found == pytest.approx(told, rel=5 * np.sqrt(2 / 20000))


def test_strains_are_widened_with_their_sizes_and_a_direction_is_not():
    strain = dataset.group(
        "strain",
        {
            "frequency": [100.0],
            "strain_component": ["ss", "tt", "st"],
            "principal": ["first", "second"],
            "part": ["real", "imaginary"],
        },
        strain=np.full((1, 3, 1), 1e-6 + 0j),
        strain_std=np.full((1, 3, 1), 3e-8),
        strain_std_by_part=np.full((2, 1, 3, 1), 3e-8),
        confidence=np.full((1, 3, 1), 6e-8),
        principal_strain=np.full((1, 2, 1), 2e-6),
        principal_strain_std=np.full((1, 2, 1), 6e-8),
        principal_confidence=np.full((1, 2, 1), 12e-8),
        principal_direction=np.full((1, 1), 30.0),
        principal_direction_std=np.full((1, 1), 1.0),
    )
    about = dataset.group(
        "modes",
        {"part": ["real", "imaginary"], "pole_parameter": ["f", "z"], "mode": [1], "mode2": [1]},
        pole_covariance=np.diag([0.0, 1.0]),
        shape_change=[[[0], [0.04]], [[0], [0]]],
        mixing_std=[[[0.04]], [[0.0]]],
    )
    after = modes.with_pole_errors(strain, about)
    assert after["strain_std"].values == pytest.approx(np.full((1, 3, 1), 5e-8))
    assert after["principal_strain_std"].values == pytest.approx(np.full((1, 2, 1), 1e-7))
    wider = np.hypot(12e-8, 1.959964 * 8e-8)
    assert after["principal_confidence"].values == pytest.approx(np.full((1, 2, 1), wider))
    assert after["principal_direction_std"].item() == 1.0


def test_poles_without_a_covariance_are_named_as_not_included():
    view, _ = session(1, 0.02, 40)
    found = identified(view)
    untold = found.modes.assign(pole_covariance=np.nan * found.modes["pole_covariance"])
    field = as_field(found.images["view0"]).assign_attrs(not_included="drift")
    after = modes.with_pole_errors(field, untold)
    assert after.attrs["not_included"] == "drift; frequencies and damping of the modes"
    assert np.array_equal(after["confidence"], field["confidence"])
