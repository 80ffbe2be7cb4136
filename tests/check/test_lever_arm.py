"""Love's theory held against images: size and power of its tests, and the sentences they give."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import binom

from sldvexp.check import Examination
from sldvexp.check.lever_arm import LeverArm, LeverArms, told
from sldvexp.check.middle_surface import by_lever_arm
from sldvexp.dataset import Severity, take_findings
from sldvexp.errors import ConfigError, UserError
from sldvexp.shell.lever import SmallSystem, strongest
from tests.shell import simulated_physics as physics
from tests.shell import simulated_shell as lab

MODES = {197.0: (1, 1), 439.0: (2, 1), 520.0: (1, 2), 790.0: (2, 2)}
#: Square of the wave number of the first mode.
FIRST = np.pi**2 * (1 / physics.SIZE**2).sum()
#: Poses in whole sessions: 3 urad and 4 um, which moves lever arms by 0.012 mm.
POSES = (3e-6, 4e-6)


def plate(lines=(197.0,), **settings):
    return physics.SinePlate({f: physics.mode(*MODES[f]) for f in lines}, **settings)


def arms_of(found):
    return LeverArms.of(found, strongest(found.fit, 8))


def rejected(arms, level=0.05):
    return min(arms.p_love, arms.p_arm) < level / 2


def most_by_chance(trials, rate):
    return binom.ppf(0.999, trials, rate)


@pytest.fixture(scope="module")
def one_line():
    return physics.estimated(plate(), np.random.default_rng(0))


@pytest.fixture(scope="module")
def four_lines():
    return physics.estimated(plate(tuple(MODES)), np.random.default_rng(1), tuple(MODES))


@pytest.mark.whole
def test_as_many_good_sheets_are_rejected_as_stated(one_line):
    """By either test, and lever arms scatter as they say."""
    rng, trials = np.random.default_rng(2), 40
    found = [arms_of(physics.renoised(one_line, plate(), rng)) for _ in range(trials)]
    assert sum(a.p_love < 0.05 for a in found) <= most_by_chance(trials, 0.05)
    assert sum(a.p_arm < 0.05 for a in found) <= most_by_chance(trials, 0.05)
    off = np.array([a.change[0] for a in found]) / np.sqrt(found[0].covariance[0, 0])
    assert abs(off.mean()) < 3.3 / np.sqrt(trials)
    assert 0.6 < off.std() < 1.4


@pytest.mark.one_in(2)
@pytest.mark.parametrize(("offset", "shear"), [(1e-3, 0), (-1e-3, 0), (1e-4, 0), (0, 0.1 / FIRST)])
def test_a_wrong_surface_and_shear_are_rejected(offset, shear):
    """A millimetre, a tenth of it, and a tenth of the slope."""
    truth = plate(shear=shear)
    found = physics.estimated(truth, np.random.default_rng(3), offset=offset)
    arms = arms_of(found)
    assert rejected(arms)
    arm = offset - shear * FIRST * arms.stated
    assert arms.change[0] == pytest.approx(arm, abs=4 * np.sqrt(arms.covariance[0, 0]))
    text = told(arms, 0.01).text
    assert text.endswith("one wave number cannot tell them apart")
    assert ("shear takes" in text) == (arm < 0)


def told_of(truth, seed, **settings):
    found = physics.estimated(truth, np.random.default_rng(seed), tuple(MODES), **settings)
    return told(arms_of(found), 0.01)


@pytest.mark.whole
def test_a_trend_tells_shear_from_height():
    lines = tuple(MODES)
    sheared = told_of(plate(lines, shear=0.02 / FIRST), 4)
    assert "shear takes" in sheared.text
    assert "the surface lies" not in sheared.text
    lower = told_of(plate(lines), 5, offset=0.2e-3)
    assert "mm lower than given" in lower.text
    assert "it is no shear" in lower.text
    assert lower.size == pytest.approx(0.2, abs=0.04)
    both = told_of(plate(lines, shear=0.05 / FIRST), 6, offset=-0.3e-3)
    assert "shear takes" in both.text
    assert "mm higher than given" in both.text


def test_a_declared_height_is_no_reason_for_doubt():
    found = told_of(plate(tuple(MODES)), 7, offset=0.1e-3, height_tolerance=0.1e-3)
    assert found.severity is Severity.note


def test_motion_of_the_middle_in_phase_is_named_and_let_free():
    """It shifts the arm of one line by eleven standard errors; with low ones free it does not."""
    found = physics.estimated(
        plate(tuple(MODES), along=5e-5), np.random.default_rng(8), tuple(MODES)
    )
    arms = arms_of(found)
    std = np.sqrt(np.diag(arms.covariance))
    assert np.abs(arms.change / std).max() > 8
    change, own = arms.beside
    assert np.all(np.abs(change) < 4 * own)
    assert "the middle moves along itself too" in told(arms, 0.01).text


def test_motion_of_the_middle_a_quarter_of_a_period_off_shifts_nothing(four_lines):
    truth = plate(tuple(MODES), along=2e-4j)
    arms = arms_of(physics.renoised(four_lines, truth, np.random.default_rng(9)))
    assert not rejected(arms, 0.001)
    assert np.all(arms.chi_square[1] > 3 * arms.freedom[1])


@pytest.mark.whole
def test_poses_are_in_the_bounds_and_common_to_all_lines():
    found = physics.estimated(
        plate(tuple(MODES)), np.random.default_rng(10), tuple(MODES), pose_std=(1.5e-5, 2e-5)
    )
    arms = arms_of(found)
    common = arms.covariance - np.diag(np.diag(arms.covariance))
    assert np.sqrt(common[0, 1]) == pytest.approx(0.06e-3, abs=0.01e-3)
    assert np.abs(arms.change).max() < 4 * 0.065e-3
    assert not rejected(arms, 0.001)


def test_one_view_does_not_tell():
    (view, *_) = lab.views(plate(), np.random.default_rng(12))
    found = physics.field_of([view], lab.volume(), (197.0,))
    finding = told(arms_of(found), 0.01)
    assert finding.severity is Severity.note
    assert finding.text.startswith("the images do not tell the lever arm of the slopes")
    with pytest.raises(UserError, match="do not tell where the middle surface lies"):
        by_lever_arm(found, (2, 2), 1)


def test_the_check_leaves_numbers_and_a_finding(monkeypatch, four_lines):
    monkeypatch.setattr("sldvexp.check.on_surface.reconstruct_surface", lambda *_: four_lines)
    experiment = SimpleNamespace(
        laser=None, volume=None, material=None, reconstruction=lab.method(), compare={}
    )
    run = Examination({}, rng=np.random.default_rng(0), experiment=experiment)
    group = LeverArm(lines=2).examine(run)
    assert group.sizes["frequency"] == 2
    assert group["lever_arm"].values == pytest.approx(1.5e-3, abs=0.1e-3)
    groups = {"examined/lever_arm": group}
    (finding,) = take_findings(groups)
    assert finding.kind == "lever_arm"
    assert finding.severity is Severity.note
    assert finding.p_value >= 0.01


def test_unknowns_are_eliminated_as_the_whole_system_would():
    rng = np.random.default_rng(11)
    design, data = rng.normal(size=(50, 5)), rng.normal(size=50)
    whole = SmallSystem(design.T @ design, design.T @ data)
    part = whole.without(np.array([1, 3]))
    assert part.estimate()[0] == pytest.approx(whole.estimate()[0][[0, 2, 4]])
    assert part.estimate()[1] == pytest.approx(whole.estimate()[1][np.ix_([0, 2, 4], [0, 2, 4])])
    fitted = design @ whole.estimate()[0]
    assert whole.score_test() == (pytest.approx(fitted @ data), 5)


@pytest.mark.parametrize("settings", [{"lines": 0}, {"level": 0.0}, {"level": 1.0}])
def test_settings_that_cannot_be(settings):
    with pytest.raises(ConfigError):
        LeverArm(**settings)


@pytest.mark.long
@pytest.mark.parametrize(
    ("offset", "shear", "least", "most"),
    [
        (0.0, 0.0, 0.0, 0.10),
        (1e-3, 0.0, 1.0, 1.0),
        (1e-4, 0.0, 0.95, 1.0),
        (0.0, 0.1 / FIRST, 1.0, 1.0),
    ],
)
def test_size_and_power_in_sixty_sessions(offset, shear, least, most):
    """Whole fits, poses drawn; at a level of 5 %."""
    found, truth = [], plate(shear=shear)
    for seed in range(60):
        rng = np.random.default_rng(1000 + seed)
        found.append(arms_of(physics.estimated(truth, rng, offset=offset, pose_std=POSES)))
    share = np.mean([rejected(a) for a in found])
    change = np.array([a.change[0] for a in found])
    std = np.sqrt([a.covariance[0, 0] for a in found])
    print(offset, shear, share, change.mean(), change.std(), std.mean())
    assert least <= share <= most
    assert np.mean(np.abs(change - offset + shear * FIRST * 1.5e-3) < 2 * std) > 0.85
