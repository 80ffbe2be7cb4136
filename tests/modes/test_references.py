"""Modes of several places of excitation: modes of one pole, participation, bounds, refusals."""

from __future__ import annotations

import numpy as np
import pytest
from synthetic import DAMPING, identified, image, plate_shapes, responses

from sldvexp import modes
from sldvexp.errors import UserError

#: A square plate: its modes (1, 2) and (2, 1) have one frequency.
SQUARE = np.array([197.0, 439.0, 545.0, 545.0, 842.0])
LINE = np.arange(150.0, 901.0, 5.0)
#: Part of every mode in two places of excitation.
PART = np.array([[1.0, 0.8, 1.0, 0.5, 0.7], [0.6, -1.0, 0.4, -1.0, 0.9]])


def two_references(seed, frequency=SQUARE, part=PART, noise=0.05, pixels=200):
    """Make images of one view with two places of excitation, and the shapes."""
    rng = np.random.default_rng(seed)
    shape, made = plate_shapes(pixels, len(frequency), seed), []
    for own in part:
        above, below = 2e-5 * rng.normal(size=(2, pixels))
        seen = responses(LINE, frequency, DAMPING[: len(frequency)], shape * own, above, below)
        made.append(image(LINE, seen, noise * np.sqrt(np.mean(np.abs(seen) ** 2)), rng))
    return made, shape


def together(first, second, **settings):
    """Find the modes of one view's two references."""
    method = modes.MostLikelyModes(**settings)
    return modes.estimate_modes({"view0": first}, method, {"2+Z": {"view0": second}})


@pytest.mark.whole
def test_two_modes_of_one_pole_are_two_with_two_references_and_one_with_one():
    (first, second), shape = two_references(0, SQUARE[1:], PART[:, 1:])
    assert identified(first).modes.sizes["mode"] == identified(second).modes.sizes["mode"] == 3
    found = together(first, second)
    assert found.modes["natural_frequency"].values == pytest.approx(SQUARE[1:], rel=3e-5)
    assert found.modes["natural_frequency"].values[1] == found.modes["natural_frequency"].values[2]
    told = [f for f in found.findings if f.kind == "repeated_modes"]
    assert [f.subject for f in told] == ["modes 2 and 3"]
    assert "those that first and 2+Z excite" in told[0].text
    # What each reference excites spans a plane, which both true shapes are in.
    seen = found.images["view0"]["velocity"].values[:, 1:3]
    for mode in (1, 2):
        rest = shape[:, mode] - seen @ np.linalg.lstsq(seen, shape[:, mode] + 0j, rcond=None)[0]
        assert np.linalg.norm(rest) < 0.01 * np.linalg.norm(shape[:, mode])
    error = (seen - shape[:, 1:3] @ PART[:, 2:4].T) / found.images["view0"]["velocity_std"][:, 1:3]
    assert np.mean(np.abs(error.values.real) < 1.96) == pytest.approx(0.95, abs=0.05)


@pytest.mark.parametrize(
    "gap",
    [pytest.param(0.0, marks=pytest.mark.whole), pytest.param(0.5, marks=pytest.mark.long)],
)
def test_bounds_of_several_references_hold_the_truth(gap):
    seeds, errors, shares = (20 if gap else 2), [], []
    frequency = SQUARE + np.array([0, 0, 0, gap, 0])
    for seed in range(200, 200 + seeds):
        (first, second), _ = two_references(seed, frequency)
        found = together(first, second).modes
        assert found.sizes["mode"] == 5
        own = found["natural_frequency"].values - frequency
        errors += [*(own / found["natural_frequency_std"].values)]
        errors += [*((found["damping_ratio"].values - 0.01) / found["damping_ratio_std"].values)]
        for mode in (0, 1, 4):
            share, std = (found[f"participation{end}"].values[:, mode] for end in ("", "_std"))
            pivot = int(np.argmin(std))
            true = PART[1 - pivot, mode] / PART[pivot, mode]
            error = (share[1 - pivot] - true) / std[1 - pivot]
            shares += [error.real, error.imag]
    for values in (errors, shares):  # two sided: within three standard errors of 95 %
        assert abs(np.mean(np.abs(values) < 1.96) - 0.95) < 3 * np.sqrt(0.95 * 0.05 / len(values))


@pytest.mark.whole
def test_a_second_reference_of_the_same_motion_narrows_bounds_by_the_root_of_two():
    """Of the same motion and independent noise; the same numbers once more are refused."""
    frequency = SQUARE[[0, 1, 2, 4]]
    (first, second), _ = two_references(3, frequency, np.ones((2, 4)))
    (once, both) = identified(first).modes, together(first, second).modes
    assert both.sizes["mode"] == 4
    for name in ("natural_frequency", "damping_ratio"):
        ratio = once[f"{name}_std"].values / both[f"{name}_std"].values
        assert ratio == pytest.approx(np.sqrt(2), rel=0.03)
        apart = (both[name].values - once[name].values) / once[f"{name}_std"].values
        assert np.abs(apart).max() < 3
    assert both["participation"].values.real == pytest.approx(1.0, abs=0.01)
    with pytest.raises(UserError, match=r"reference 2\+Z has the numbers of reference first"):
        together(first, first.assign(velocity=2j * first["velocity"]))


@pytest.mark.whole
def test_one_reference_alone_gives_the_modes_that_it_gives_together_with_a_silent_one():
    frequency = SQUARE[[0, 1, 2, 4]]
    (first, second), _ = two_references(4, frequency, np.array([np.ones(4), np.zeros(4)]))
    once, both = identified(first).modes, together(first, second).modes
    assert both["natural_frequency"].values == pytest.approx(
        once["natural_frequency"].values, rel=1e-6
    )
    assert both["damping_ratio_std"].values == pytest.approx(
        once["damping_ratio_std"].values, rel=0.05
    )


def test_references_of_other_pixels_lines_or_views_are_refused():
    (first, second), _ = two_references(5)
    for other, said in (
        (second.isel(pixel=slice(1, None)), "has other pixels than reference first"),
        (second.isel(frequency=slice(1, None)), "has other lines than reference first"),
        (second.assign(dac=second["dac"] + 1.0), "measure the same pixels with every place"),
    ):
        with pytest.raises(UserError, match=said):
            together(first, other)
    with pytest.raises(UserError, match=r"reference 2\+Z: has the views b, reference first has"):
        modes.estimate_modes({"view0": first}, modes.MostLikelyModes(), {"2+Z": {"b": second}})


@pytest.mark.whole
def test_a_pixel_that_one_reference_flags_has_no_say():
    alone = [0, 1, 2, 4]
    (first, second), _ = two_references(6, SQUARE[alone], PART[:, alone])
    spoilt = second.copy(deep=True)
    spoilt["flags"].values[::9] = 2
    spoilt["velocity"].values[::9] = 7.0
    found = together(first, spoilt)
    assert found.modes["natural_frequency"].values == pytest.approx(SQUARE[alone], rel=5e-5)
    assert np.array_equal(found.images["view0"]["flags"].values, spoilt["flags"].values)
