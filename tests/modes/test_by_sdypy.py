"""Poles of sdypy-EMA beside our own, where it is installed, and a sentence where it is not."""

from __future__ import annotations

import numpy as np
import pytest
from synthetic import DAMPING, FREQUENCY, session

from sldvexp import modes
from sldvexp.config import registry
from sldvexp.errors import ConfigError, UserError


def method(**settings):
    pytest.importorskip("sdypy.EMA")
    return registry.get("modal", "sdypy")(**settings)


def test_without_the_package_there_is_a_sentence(monkeypatch):
    monkeypatch.setattr("sldvexp.modes.by_sdypy.find_spec", lambda name: None)
    with pytest.raises(ConfigError, match=r"needs the package sdypy-EMA: pip install 'sldvexp\["):
        registry.get("modal", "sdypy")()


def test_its_poles_are_ours_where_there_is_hardly_noise_and_ours_are_better_in_noise():
    for noise, worst in ((1e-4, 0.01), (0.2, 1.0)):
        view, _ = session(1, noise)
        error = {}
        for name, by in (("own", modes.MostLikelyModes()), ("sdypy", method())):
            found = modes.estimate_modes({"a": view}, by).modes
            assert found["natural_frequency"].values == pytest.approx(FREQUENCY, rel=1e-2)
            error[name] = np.abs(found["damping_ratio"].values / DAMPING - 1).max()
        assert error["own"] <= error["sdypy"] < worst


def test_lines_that_are_not_multiples_of_a_spacing_are_refused():
    line = np.arange(56.0, 1331.0, 5.0)
    with pytest.raises(UserError, match="modal=sdypy needs lines at multiples of one spacing"):
        modes.estimate_modes({"a": session(1, 0.1, line=line)[0]}, method())
