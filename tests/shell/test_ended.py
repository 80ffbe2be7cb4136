"""A structure that ends before its margin does is found in the images, and told with its end."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sldvexp.dataset import Severity
from tests.shell import simulated_shell as lab
from tests.shell.test_beyond_rim import HALF, resting
from tests.shell.test_surface_fields import compared, estimated

ALL = range(5)


def ends_at(distance, sides=(0, 1, 2, 3)):
    """Places beyond sides of the surface from a distance on: low x, low y, high x, high y."""

    def beyond(place):
        far = np.concatenate([-HALF - place, place - HALF], axis=1)
        return (far.max(axis=1) > distance) & np.isin(far.argmax(axis=1), sides)

    return beyond


@pytest.mark.one_in(2)
@pytest.mark.parametrize("sides", [(0, 1, 2, 3), (2,)])
def test_a_structure_that_ends_early_is_told_with_the_margin_that_is_right(sides):
    truth, volume = lab.plate(), lab.volume()
    views = lab.views(truth, np.random.default_rng(2), lab.FINE)
    short = list(resting(views, ends_at(0.004, sides), np.random.default_rng(3), ALL))
    found = estimated(short, volume)
    (said,) = found.findings
    assert (said.kind, said.subject, said.severity) == ("margin", "volume.margin", Severity.note)
    assert said.remedy == f"volume.margin={said.size:g}"
    assert said.size <= 0.004
    assert said.size > 0.001 or len(sides) > 1  # no pixel of a side may be as near as that
    assert f"before volume.margin={volume.margin:g} m does" in said.text
    errors, held = compared(found, truth)
    right, _ = compared(estimated(views, replace(volume, margin=float(said.size))), truth)
    assert np.all(errors < 1.3 * right)
    assert held.mean() > 0.9


@pytest.mark.whole
def test_a_shadow_in_one_view_is_no_end_of_the_structure():
    truth, volume = lab.plate(), lab.volume()
    views = lab.views(truth, np.random.default_rng(2), lab.FINE)
    shaded = list(resting(views, ends_at(0.004, (2,)), np.random.default_rng(3), (1,)))
    assert not estimated(shaded, volume).findings


@pytest.mark.whole
def test_a_structure_that_goes_on_is_not_said_to_end():
    truth, volume = lab.plate(), lab.volume()
    for seed in range(8):
        views = lab.views(truth, np.random.default_rng(seed), lab.FINE)
        assert not estimated(views, volume).findings
