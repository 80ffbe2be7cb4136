"""Modes of lines whose poles and shapes are known."""

from __future__ import annotations

import numpy as np
import pytest
from synthetic import (
    DAMPING,
    FREQUENCY,
    LINE,
    identified,
    image,
    plate_shapes,
    quiet,
    responses,
    session,
)

from sldvexp import modes


def poles(found):
    return found.modes["natural_frequency"].values, found.modes["damping_ratio"].values


def test_modes_without_noise_are_exact():
    shape = plate_shapes(80, 5)
    damping = np.array([0.01, 0.02, 0.005, 0.01, 0.03])
    rest = np.linspace(1e-5, 3e-5, 80)
    seen = responses(LINE, FREQUENCY, damping, shape, above=rest, below=rest)
    found = identified(image(LINE, seen[:40], 1e-12), image(LINE, seen[40:], 1e-12))
    assert poles(found)[0] == pytest.approx(FREQUENCY, rel=1e-9)
    assert poles(found)[1] == pytest.approx(damping, rel=1e-7)
    whole = np.concatenate([image["velocity"].values for image in found.images.values()])
    assert np.abs(whole - shape).max() < 1e-7 * np.abs(shape).max()
    assert [finding.kind for finding in found.findings] == ["noise"]  # less than stated


def test_frequencies_of_the_modal_images_are_those_of_the_modes():
    _, _, found = quiet()
    assert found.images["view0"]["frequency"].values.tolist() == poles(found)[0].tolist()
    assert (
        found.images["view0"]["scale_std"].values.tolist()
        == np.diag(found.modes["mixing_std"].values[0]).tolist()
    )


def test_views_are_taken_together_and_their_order_does_not_matter():
    """Those of the second part first and of the first part then are those of the whole."""
    view, _, whole = quiet()
    first, second = view.isel(pixel=slice(0, 120)), view.isel(pixel=slice(120, None))
    frequency, damping = poles(identified(second, first))
    assert frequency == pytest.approx(poles(whole)[0], rel=1e-10)
    assert damping == pytest.approx(poles(whole)[1], rel=1e-8)


def test_lines_that_are_not_evenly_spaced_and_come_in_any_order_serve_as_well():
    rng = np.random.default_rng(5)
    line = np.sort(rng.choice(np.arange(55.0, 1331.0), 200, replace=False))
    seen, _ = session(2, 0.02, line=line)
    found = identified(seen.isel(frequency=rng.permutation(200)))
    error = (poles(found)[0] - FREQUENCY) / found.modes["natural_frequency_std"].values
    assert len(error) == 5
    assert np.abs(error).max() < 4


@pytest.mark.whole
def test_damping_from_a_thousandth_to_a_tenth_is_found():
    damping = np.array([0.001, 0.003, 0.01, 0.03, 0.09])
    frequency = np.array([150.0, 300.0, 500.0, 750.0, 1100.0])
    found = identified(
        session(3, 0.02, frequency=frequency, damping=damping, line=np.arange(50.0, 1400.0, 2.5))[0]
    )
    error = (poles(found)[1] - damping) / found.modes["damping_ratio_std"].values
    assert len(error) == 5
    assert np.abs(error).max() < 4


def test_flagged_pixels_have_no_say_and_get_what_their_lines_give():
    clean, _ = session(4, 0.1)
    spoilt = clean.copy(deep=True)
    spoilt["velocity"].values[::9] = 7.0
    spoilt["velocity"].values[0, 3] = np.nan
    spoilt["flags"].values[::9] = 2
    good = np.ones(300, bool)
    good[::9] = False
    found, without = identified(spoilt), identified(clean.isel(pixel=good))
    assert np.array_equal(poles(found)[0], poles(without)[0])
    whole = found.images["view0"]
    assert np.array_equal(whole["flags"].values, spoilt["flags"].values)
    assert whole["velocity"].values[good] == pytest.approx(
        without.images["view0"]["velocity"].values, rel=1e-12
    )
    assert np.isnan(whole["velocity"].values[0]).all()
    assert np.isfinite(whole["velocity"].values[9]).all()


@pytest.mark.whole
@pytest.mark.parametrize("noise", [0.005, 0.5])
def test_none_is_missed_and_none_is_false_in_noise(noise):
    for seed in range(2):
        frequency, _ = poles(identified(session(seed, noise)[0]))
        assert frequency == pytest.approx(FREQUENCY, rel=2e-3), seed


@pytest.mark.whole
def test_modes_of_little_motion_are_found():
    for seed in range(2):
        rng = np.random.default_rng(seed)
        shape = plate_shapes(300, 5, seed) * [1, 0.05, 1, 0.1, 1]
        seen = responses(LINE, FREQUENCY, DAMPING, shape)
        noise = 0.05 * np.sqrt(np.mean(np.abs(seen) ** 2))
        frequency, _ = poles(identified(image(LINE, seen, noise, rng)))
        assert frequency == pytest.approx(FREQUENCY, rel=2e-3), seed


@pytest.mark.one_in(6)
@pytest.mark.parametrize("seeds", [1, 2])
@pytest.mark.parametrize(("gap", "noise"), [(10.0, 0.2), (2.0, 0.1), (1.0, 0.05)])
def test_two_modes_closer_than_the_lines_are_both_found(gap, noise, seeds):
    frequency = np.array([197.0, 545.0, 545.0 + gap, 842.0])
    for seed in range(seeds):
        found = identified(session(seed, noise, pixels=500, frequency=frequency, damping=0.01)[0])
        error = poles(found)[0] - frequency
        assert np.abs(error / found.modes["natural_frequency_std"].values).max() < 4.5


def test_shapes_of_close_modes_that_may_be_mixed_are_told():
    frequency = np.array([545.0, 545.5])
    found = identified(session(0, 0.02, frequency=frequency, damping=0.01)[0])
    told = [f for f in found.findings if f.kind == "close_modes"]
    assert [f.subject for f in told] == ["modes 1 and 2"]
    assert told[0].size == pytest.approx(found.modes["mixing_std"].values[:, [0, 1], [1, 0]].max())


@pytest.mark.parametrize("seeds", [1, pytest.param(4, marks=pytest.mark.whole)])
def test_one_mode_is_not_taken_for_two(seeds):
    for seed in range(seeds):
        found = identified(session(seed, 0.3, frequency=[400.0], damping=[0.02])[0])
        assert len(poles(found)[0]) == 1


def test_a_mode_beside_the_band_stands_in_the_model_and_not_in_the_result():
    whole, shape = session(6, 0.02, pixels=400)
    found = identified(whole, band=[500.0, 600.0])
    assert poles(found)[0] == pytest.approx([545.0], rel=1e-4)
    error = (poles(found)[1] - 0.01) / found.modes["damping_ratio_std"].values
    assert abs(error[0]) < 4
    assert float(found.modes["misfit"]) < 1.3
    seen = found.images["view0"]["velocity"].values[:, 0]
    assert np.abs(seen - shape[:, 2]).max() < 0.05 * np.abs(shape).max()


def test_a_mode_of_all_phases_has_the_complexity_of_its_shape():
    rng = np.random.default_rng(7)
    shape = plate_shapes(300, 2, 7).astype(complex)
    shape[:, 1] += 0.2j * plate_shapes(300, 3, 7)[:, 2]
    turned = shape * np.exp(0.7j)
    seen = responses(LINE, [300.0, 800.0], [0.01, 0.01], turned.real)
    # The response of an imaginary residue: R -> i R, with the conjugate at the other pole.
    omega, pole = 2 * np.pi * LINE, modes.model.poles_of(2 * np.pi * np.array([300.0, 800.0]), 0.01)
    residue = turned / modes.model.velocity_per_residue(pole)
    iw = 1j * omega[:, None]
    seen = residue @ (iw / (iw - pole)).T + residue.conj() @ (iw / (iw - pole.conj())).T
    found = identified(image(LINE, seen, 3e-5, rng)).modes
    xx, yy, xy = (
        (a * b).sum(axis=0)
        for a, b in ((shape.real,) * 2, (shape.imag,) * 2, (shape.real, shape.imag))
    )
    true = 1 - ((xx - yy) ** 2 + 4 * xy**2) / (xx + yy) ** 2
    error = (found["complexity"].values - true) / found["complexity_std"].values
    assert true[1] > 0.05
    assert np.abs(error).max() < 4
    assert np.abs(found["complexity"].values[0]) < 1e-3
    assert found["phase"].values[0] == pytest.approx(0.7, abs=0.01)


def test_a_reference_that_is_not_flat_is_divided_out_and_tells_the_scale():
    clean, shape, flat = quiet()
    level = np.linspace(0.5, 2.0, len(LINE))
    level /= np.sqrt(np.mean(level**2))
    uneven = clean.assign(
        velocity=clean["velocity"] * level,
        velocity_std=clean["velocity_std"] * level,
        reference_amplitude=("frequency", 3.0 * level),
    )
    found = identified(uneven)
    assert poles(found)[0] == pytest.approx(poles(flat)[0], rel=1e-9)
    assert "modal_scale" not in flat.modes
    assert found.images["view0"]["velocity"].values == pytest.approx(
        flat.images["view0"]["velocity"].values, rel=1e-8
    )
    true = np.sqrt(np.mean(shape**2, axis=0)) / 3.0
    error = (found.modes["modal_scale"].values - true) / found.modes["modal_scale_std"].values
    assert np.abs(error).max() < 4
