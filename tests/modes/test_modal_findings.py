"""Lines that no linear modes have are found out, named, and make bounds wider."""

from __future__ import annotations

import numpy as np
import pytest
from synthetic import FREQUENCY, LINE, identified, quiet, session

from sldvexp import modes
from sldvexp.dataset import Severity


def kinds(found):
    return {finding.kind: finding for finding in found.findings}


def with_harmonics(seen, share):
    """Add to every even multiple of a line a share of that line, in the phase of its square."""
    spoilt = seen.copy(deep=True)
    values = spoilt["velocity"].values
    for k, hertz in enumerate(LINE):
        twice = np.flatnonzero(np.isclose(LINE, 2 * hertz))
        if twice.size:
            own = seen["velocity"].values[:, k]
            values[:, twice[0]] += share * own**2 / np.abs(own)
    return spoilt


def test_clean_lines_have_no_findings():
    assert quiet()[2].findings == []


@pytest.mark.whole
def test_clean_lines_of_more_noise_have_no_findings():
    for seed in range(4):
        assert identified(session(seed, 0.05)[0]).findings == []


def test_harmonics_on_other_lines_are_named_with_their_ratio_and_lines_count_for_less():
    clean, _, before = quiet()
    found = identified(with_harmonics(clean, 0.005))
    told = kinds(found)["harmonics"]
    assert told.severity is Severity.note
    assert "880 (2 x 440)" in told.text
    assert "1090 (2 x 545)" in told.text
    assert found.modes["harmonic"].values.tolist() == [2]
    assert found.modes["harmonic_ratio"].values == pytest.approx([0.005], rel=0.25)
    by_line = found.modes["harmonics_rms"].values
    even = np.isin(LINE, 2 * LINE)
    assert np.all(by_line[even] > 0)
    assert np.all(by_line[~even] == 0)
    # Lines lose some of their weight, which widens bounds, and nothing else does.
    ratio = found.modes["natural_frequency_std"] / before.modes["natural_frequency_std"]
    assert np.all((ratio.values > 1.0) & (ratio.values < 1.5))
    assert before.modes.sizes["harmonic"] == 0


@pytest.mark.parametrize(
    "seeds",
    [pytest.param(4, marks=pytest.mark.whole), pytest.param(40, marks=pytest.mark.long)],
)
def test_bounds_hold_with_harmonics_and_would_not_without_their_weights(seeds):
    """Errors over standard errors of sessions, with lines weighted and not."""
    weighted, plain = [], []
    for seed in range(seeds):
        spoilt = with_harmonics(session(seed, 0.01, 150)[0], 0.02)
        found = identified(spoilt)
        responses = modes.Responses.from_images({"a": spoilt})
        principal = modes.compress(responses)
        alike = modes.likelihood.most_likely(principal, found.fit.pole)
        for fit, to in ((found.fit, weighted), (alike, plain)):
            error = np.log(np.abs(fit.pole) / (2 * np.pi * FREQUENCY))
            to.append(error / np.sqrt(np.diag(fit.covariance)[:5]))
    chance = 3.3 / np.sqrt(2 * 5 * seeds)
    assert abs(np.std(weighted) - 1) < chance
    assert np.std(plain) > 1 + chance


@pytest.mark.whole
def test_harmonics_do_not_hide_a_missed_mode():
    whole, _ = session(2, 0.01, frequency=np.array([300.0, 700.0]), damping=0.01)
    spoilt = with_harmonics(whole, 0.005)
    responses = modes.Responses.from_images({"a": spoilt})
    principal = modes.compress(responses)
    one = modes.model.poles_of(2 * np.pi * np.array([300.0]), 0.01)
    fit = modes.likelihood.most_likely(principal, one)
    found = modes.harmonics.find_harmonics(responses, principal, fit.by_line)
    principal = modes.harmonics.weigh(principal, responses, found)
    assert modes.likelihood.most_likely(principal, one).misfit > 2


def test_a_missed_mode_makes_the_modes_doubtful():
    whole, _ = session(2, 0.01, frequency=np.array([300.0, 700.0]), damping=0.01)
    method = modes.MostLikelyModes()
    responses = modes.Responses.from_images({"a": whole})
    fit = modes.likelihood.most_likely(
        modes.compress(responses), modes.model.poles_of(2 * np.pi * np.array([300.0]), 0.01)
    )
    assert len(fit.pole) == 1
    assert fit.misfit > 10
    both = method.identify(responses)
    assert both.chi_square / both.dof < 1.2


@pytest.mark.whole
def test_harmonics_so_strong_that_the_structure_may_not_be_linear_are_doubtful():
    clean, _ = session(3, 0.002)
    told = kinds(identified(with_harmonics(clean, 0.02)))["harmonics"]
    assert told.severity is Severity.doubtful
    assert "compare with a weaker one" in told.text


@pytest.mark.whole
def test_a_misfit_that_wider_bounds_do_not_repair_is_doubtful():
    clean, _ = session(3, 0.002)
    values = clean["velocity"].values
    values += 2e-3 * np.abs(values).max() * np.sign(np.sin(0.3 * LINE))  # of no line's multiple
    told = kinds(identified(clean))["misfit"]
    assert told.severity is Severity.doubtful
    assert told.statistic > 2
    assert told.size == pytest.approx(np.sqrt(told.statistic))


@pytest.mark.one_in(2)
@pytest.mark.parametrize("stated", [0.5, 2.0])
def test_noise_that_is_not_as_stated_is_found(stated):
    clean, _ = session(4, 0.1)
    wrong = clean.assign(velocity_std=stated * clean["velocity_std"])
    found = identified(wrong)
    told = kinds(found)["noise"]
    # Signals below the stated noise are not counted as such, and add to what is found of it.
    chance = 3.3 / np.sqrt(2 * 2 * clean["velocity"].size)
    assert 1 - chance < told.size * stated < 1.02
    std = [each.modes["natural_frequency_std"].values for each in (found, identified(clean))]
    assert std[0] / std[1] == pytest.approx(max(1.0, stated), rel=0.02)


def test_noise_that_goes_with_pixel_and_line_leaves_a_misfit_of_one_and_honest_bounds():
    rng = np.random.default_rng(5)
    clean, shape = session(5, 1e-6)
    rms = np.sqrt(np.mean(np.abs(clean["velocity"].values) ** 2))
    std = 0.1 * rms * rng.uniform(0.2, 2.0, (len(shape), 1)) * (55 / LINE) ** 0.5
    noise = rng.normal(size=(2, *std.shape))
    seen = clean.assign(
        velocity=clean["velocity"] + std * (noise[0] + 1j * noise[1]),
        velocity_std=(("pixel", "frequency"), std),
    )
    found = identified(seen)
    assert found.findings == []
    assert float(found.modes["misfit_p_value"]) > 1e-3
    left = found.images["view0"]["velocity"].values - shape
    ratio = np.abs(left) ** 2 / found.images["view0"]["velocity_std"].values ** 2 / 2
    assert ratio.mean() == pytest.approx(1.0, abs=5 / np.sqrt(ratio.size))


@pytest.mark.whole
def test_resonances_narrower_than_lines_are_apart_are_said():
    found = identified(session(6, 0.02, damping=np.array([0.002, 0.01, 0.01, 0.01, 0.01]))[0])
    assert "197" in kinds(found)["coarse_lines"].text
    assert found.modes["natural_frequency"].values == pytest.approx(FREQUENCY, rel=1e-3)
