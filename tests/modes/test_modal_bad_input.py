"""Input that has no modes to find is refused in a sentence that says what would be right."""

from __future__ import annotations

import numpy as np
import pytest
from synthetic import LINE, identified, image, session

from sldvexp import modes
from sldvexp.errors import ConfigError, UserError


def refused(match, *views, **settings):
    with pytest.raises(UserError, match=match):
        identified(*views, **settings)


def noise_alone():
    return image(LINE, np.zeros((50, len(LINE))), 1e-5, np.random.default_rng(0))


def test_no_images_are_refused():
    refused("needs velocity images")


def test_fewer_lines_than_poles_are_refused():
    whole, _ = session(0, 0.05)
    refused("5 lines are too few to find modes; measure at least 8", whole, band=[530, 550])


def test_fewer_lines_than_the_poles_of_all_signals_are_told():
    whole, _ = session(0, 0.05)
    few = whole.isel(frequency=np.linspace(0, len(LINE) - 1, 12).astype(int))
    told = "signals stand out of the noise, for whose poles 12 lines are too few: measure at least"
    refused(told, few)


def test_a_band_of_noise_has_no_mode():
    refused("nothing stands out of the noise between 55 and 1330 Hz", noise_alone())


def test_a_band_without_resonances_has_no_mode():
    whole, _ = session(1, 0.01)
    refused("no mode lies between 300 and 340 Hz", whole, band=[300, 340])


def test_a_band_without_lines_is_refused():
    refused("no line lies between 2000 and 3000 Hz", noise_alone(), band=[2000, 3000])


def test_views_with_other_lines_are_refused():
    whole, _ = session(0, 0.05)
    refused("view view1: has other lines than view view0", whole, whole.isel(frequency=slice(9)))


def test_one_line_without_a_name_is_refused():
    whole, _ = session(0, 0.05)
    refused("has one line without a name", whole.isel(frequency=0, drop=True))


def test_a_line_twice_is_refused():
    whole, _ = session(0, 0.05)
    refused("the line at 55 Hz is there twice", whole.isel(frequency=[0, 0, *range(1, 40)]))


def test_a_line_to_leave_out_that_is_not_there_is_refused():
    refused("leave_out: there is no line at 56 Hz", noise_alone(), leave_out=[56.0])


def test_pixels_of_unknown_noise_are_refused():
    whole, _ = session(0, 0.05)
    whole["velocity_std"].values[4] = np.nan
    refused("view view0: has unflagged pixels of unknown noise", whole)


def test_all_pixels_flagged_are_refused():
    whole, _ = session(0, 0.05)
    whole["flags"].values[:] = 2
    refused("no pixel without a flag", whole)


@pytest.mark.parametrize(
    ("settings", "match"),
    [
        ({"band": [500.0, 400.0]}, "band: must be two rising frequencies"),
        ({"order": 2}, "order: must be 0 or at least 4"),
        ({"share": 1.5}, "share: must lie between 0 and 1"),
        ({"leave_out": [-5.0]}, "leave_out: must be a positive number"),
    ],
)
def test_impossible_settings_are_refused(settings, match):
    with pytest.raises(ConfigError, match=match):
        modes.MostLikelyModes(**settings)
