"""Advice is given where the budget says that it helps, and nowhere else."""

from __future__ import annotations

import numpy as np

from sldvexp.field.bounds.advice import advice

AXES = ("x", "y", "z")


def squares(noise: float, elements: float, interpolation: float) -> np.ndarray:
    """Of errors that are the same wave: their product has their sign; the first two of noise."""
    of_z = [noise**2, 0.0, elements**2, elements * interpolation, interpolation**2]
    return np.stack([[1.0, 0.0, 0.0, 0.0, 0.0]] * 2 + [of_z], axis=1)


def test_nothing_is_advised_against_noise() -> None:
    assert advice(squares(1.0, 0.3, 0.2), AXES, cubic=False) == []


def test_coarse_elements_are_to_be_halved() -> None:
    (sentence,) = advice(squares(1.0, 3.0, 0.0), AXES, cubic=True)
    assert "90% of the variance of z" in sentence
    assert "elements of half the size" in sentence
    # sqrt((2 + 9 / 16) / 10)
    assert "by the budget 51% of what they are" in sentence


def test_coarse_pixels_ask_for_cubic_interpolation_or_for_more_of_them() -> None:
    (sentence,) = advice(squares(0.2, 0.1, -3.0), AXES, cubic=False)
    assert "volume.sight.interpolation=cubic" in sentence
    (sentence,) = advice(squares(0.2, 0.1, -3.0), AXES, cubic=True)
    assert "twice as many pixels" in sentence


def test_a_change_that_would_uncover_the_other_error_is_not_advised() -> None:
    """Elements raise a wave by what linear interpolation flattens it: cubic would make it worse."""
    assert advice(squares(0.5, 3.0, -3.5), AXES, cubic=False) == []


def test_a_change_that_raises_the_noise_as_much_is_not_advised() -> None:
    assert advice(squares(1.0, 0.7, 0.0), AXES, cubic=True) == []
