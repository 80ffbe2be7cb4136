"""The spread of an image's phases, where it is known."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp import dataset
from sldvexp.check import Examination
from sldvexp.check.phase_image import PhaseImage
from sldvexp.errors import UserError

PIXELS = 400


def image(phase, uncorrected, frequency=(450.0,), flags=0):
    """Pixels of amplitudes from 0 to 1, half of them in opposite phase."""
    rng = np.random.default_rng(0)
    amplitude = rng.uniform(0, 1, PIXELS) * rng.choice([-1, 1], PIXELS)
    coords = {"pixel": np.arange(PIXELS), "frequency": np.array(frequency)}
    shape = (PIXELS, len(frequency))
    arrays = {
        "velocity": np.broadcast_to((amplitude * np.exp(1j * phase))[:, None], shape),
        "uncorrected": np.broadcast_to((amplitude * np.exp(1j * uncorrected))[:, None], shape),
    }
    return dataset.group("image", coords, flags=np.full(PIXELS, flags), **arrays)


def examine(tree):
    return PhaseImage().examine(Examination(tree, rng=np.random.default_rng(0)))


def test_two_phases_half_a_turn_apart_are_one():
    rng = np.random.default_rng(1)
    found = examine({"image/a": image(0.4, rng.uniform(0, 2 * np.pi, PIXELS))})
    after = found.sel(stage="corrected", view="a", frequency=450.0)
    assert float(after["phase"]) == pytest.approx(0.4)
    assert float(after["phase_std"]) < 1e-7
    assert float(after["p_uniform"]) < 1e-50
    before = found.sel(stage="uncorrected", view="a", frequency=450.0)
    assert float(before["phase_std"]) > 0.5
    assert float(before["p_uniform"]) > 0.001


@pytest.mark.parametrize("std", [0.05, 0.2])
def test_the_spread_is_the_standard_deviation_of_normal_phases(std):
    phase = std * np.random.default_rng(2).standard_normal(PIXELS)
    found = examine({"image/a": image(phase, phase)})
    # Weights of squared uniform amplitudes leave 5/9 of the pixels: a standard deviation of them.
    within = 4 * std / np.sqrt(2 * PIXELS * 5 / 9)
    np.testing.assert_allclose(found["phase_std"], std, atol=within)
    np.testing.assert_allclose(found["phase"], 0, atol=4 * std / np.sqrt(PIXELS * 5 / 9))


@pytest.mark.whole
def test_the_p_value_is_uniform_where_phases_are():
    rng = np.random.default_rng(3)
    repeats = 300
    trees = ({"image/a": image(0.0, rng.uniform(0, 2 * np.pi, PIXELS))} for _ in range(repeats))
    p = [examine(tree)["p_uniform"].sel(stage="uncorrected").item() for tree in trees]
    # Kolmogorov and Smirnov: a distance of 1.95 / sqrt(n) is exceeded by one in a thousand.
    distance = np.abs(np.sort(p) - (np.arange(repeats) + 0.5) / repeats).max()
    assert distance < 1.95 / np.sqrt(repeats)


def test_flagged_pixels_do_not_count():
    bad = image(np.linspace(0, 9, PIXELS), 0.0, flags=1)
    good = image(0.1, 0.0)
    both = {
        name: (v.dims, np.concatenate([v.values, bad[name].values])) for name, v in good.items()
    }
    merged = good.drop_dims("pixel").assign(both)
    found = examine({"image/a": merged})
    assert found["phase_std"].sel(stage="corrected").item() < 1e-7


def test_images_of_other_frequencies_are_refused():
    tree = {"image/a": image(0.0, 0.0), "image/b": image(0.0, 0.0, (450.0, 500.0))}
    with pytest.raises(UserError, match="the same frequencies in all views"):
        examine(tree)
    with pytest.raises(UserError, match="needs velocity images"):
        examine({})
