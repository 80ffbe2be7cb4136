"""Face and back of a sheet held against one another: size, power, and the sentences."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import binom

from sldvexp.check import Examination
from sldvexp.check.faces import ComparedFaces, Faces, told
from sldvexp.check.lever_arm import LeverArms
from sldvexp.dataset import Severity, take_findings
from sldvexp.errors import ConfigError, UserError
from sldvexp.shell import Isotropic
from tests.shell import simulated_shell as lab
from tests.shell.test_both_sides import both_sided, estimated

#: Poses as of whole sessions: 3 urad and 4 um.
POSE_STD = np.tile(np.repeat([3e-6, 4e-6], 3), 6)


def session(seed, thickness=0.003, shear=0.0, moved=None):
    """Compare a session of three views of either side, poses drawn, those of the back moved."""
    rng = np.random.default_rng(seed)
    errors = (POSE_STD * rng.normal(size=36)).reshape(6, 6)
    if moved is not None:
        errors[3:] -= moved
    truth = lab.plate(shear=shear)
    views = lab.views_of_both_sides(truth, rng, pixels=(17, 19), errors=errors)
    sheet, covariance = Isotropic(thickness=thickness), np.diag(POSE_STD**2)
    return ComparedFaces.of(estimated(views, both_sided(), sheet=sheet, covariance=covariance))


@pytest.mark.whole
def test_sides_of_one_sheet_agree():
    """Limits are what chance alone exceeds once in a thousand."""
    found, trials = [session(seed) for seed in range(6)], 6
    most = binom.ppf(0.999, trials, 0.05)
    assert sum(f.p_arm < 0.05 for f in found) <= most
    assert sum(f.p_difference < 0.05 for f in found) <= most
    z = np.array([f.change / f.std for f in found])
    assert abs(z.mean()) < 3.3 / np.sqrt(trials)
    finding = told(found[0], 0.01)
    assert finding.severity is Severity.note
    assert finding.text.startswith("face and back of the sheet agree: by their slopes")


def test_shear_is_told_without_a_height_and_within_its_bound():
    """Ten per cent of the slope, 0.3 mm of the lever arm; the plate stretches beside it."""
    found = session(7, shear=0.1)
    assert found.change == pytest.approx(-0.3e-3, abs=3 * found.std)
    finding = told(found, 0.01)
    assert finding.severity is Severity.doubtful
    assert "shear takes" in finding.text
    assert "too far apart" in finding.text


@pytest.mark.whole
def test_sides_that_are_registered_too_close_are_told():
    found = session(8, moved=np.array([0, 0, 0, 0, 0, 0.5e-3]))
    assert found.change == pytest.approx(0.5e-3, abs=3 * found.std)
    finding = told(found, 0.01)
    assert "too close together along the normal" in finding.text
    assert "shear" not in finding.text


@pytest.mark.whole
def test_a_side_that_is_beside_where_it_is_said_is_told_by_its_normal_motion():
    """The back by 1 mm along the plate."""
    found = session(9, moved=np.array([0, 0, 0, 1e-3, 0, 0]))
    assert found.p_beside < 1e-6
    finding = told(found, 0.01)
    assert finding.severity is Severity.doubtful
    assert "most along its normal, as no lever arm explains" in finding.text


@pytest.mark.whole
def test_a_wrong_thickness_shows_nowhere():
    """It moves places and lever arms alike, and a beam sees a rigid normal the same all along."""
    right, wrong = session(10), session(10, thickness=0.00315)
    assert wrong.change == pytest.approx(right.change, abs=0.01 * right.std)
    assert wrong.chi_square[0] == pytest.approx(right.chi_square[0], abs=0.1)


def test_a_difference_that_a_lever_arm_may_explain_is_not_told_as_one_that_none_does():
    """One is just below the level, the other just above."""
    by_component = (0.5, 0.004, 0.5)
    found = ComparedFaces((3, 3), 0.003, -2.4e-5, 1e-5, (82, 48), (73, 47), by_component)
    assert found.p_value < 0.005
    assert found.p_beside > 0.005
    text = told(found, 0.005).text
    assert "no lever arm" not in text
    assert "most along its second direction: poses" in text


def test_a_view_that_sees_neither_side_has_no_say():
    rng = np.random.default_rng(13)
    views = lab.views_of_both_sides(lab.plate(), rng, pixels=(11, 13))
    blind = replace(views[0], flags=np.ones_like(views[0].flags))
    found, right = (
        ComparedFaces.of(estimated(some, both_sided())) for some in ([blind, *views[1:]], views[1:])
    )
    assert found.seen == right.seen
    assert found.chi_square == pytest.approx(right.chi_square)
    assert (found.change, found.std) == pytest.approx((right.change, right.std))


def examined(found, monkeypatch):
    monkeypatch.setattr("sldvexp.check.on_surface.reconstruct_surface", lambda *_: found)
    experiment = SimpleNamespace(
        laser=None, volume=None, material=None, reconstruction=lab.method(), compare={}
    )
    run = Examination({}, rng=np.random.default_rng(0), experiment=experiment)
    group = Faces().examine(run)
    (finding,) = take_findings({"examined/faces": group})
    return group, finding


def test_the_check_leaves_numbers_and_a_finding(monkeypatch):
    views = lab.views_of_both_sides(lab.plate(), np.random.default_rng(11))
    group, finding = examined(estimated(views, both_sided()), monkeypatch)
    assert group["lever_arm"].item() == pytest.approx(3e-3, abs=0.15e-3)
    assert group["component_p_value"].sizes == {"component": 3}
    assert finding.kind == "faces"


def test_one_side_alone_is_a_note(monkeypatch):
    views = lab.views(lab.plate(), np.random.default_rng(12))
    group, finding = examined(estimated(views, lab.volume()), monkeypatch)
    assert np.isnan(group["lever_arm"].item())
    assert finding.severity is Severity.note
    assert finding.text.startswith("the views see the face of the sheet alone")


@pytest.mark.whole
def test_the_command_holds_the_face_against_the_back(sldvexp):
    """Few pixels miss what all of them are expected to reach; their sentence is the same."""
    few = ("scan.pixels=[11,13]", "volume.shape=[5,4]")
    done = sldvexp("experiment=plate_faces", *few)
    assert done.status in (0, 2), done.err
    told = sldvexp("show", str(done.folder)).out
    assert "note: face and back of the sheet agree: by their slopes the faces are " in told
    faces = done.tree["examined/faces"]
    arm, std = faces["lever_arm"].item(), faces["lever_arm_std"].item()
    assert arm == pytest.approx(3e-3, abs=3.3 * std)
    assert std < 0.15e-3


@pytest.mark.whole
def test_the_lever_arm_of_the_face_is_that_of_views_of_the_face():
    truth = lab.plate(stretch=0.0)
    views = lab.views_of_both_sides(truth, np.random.default_rng(13))
    arms = LeverArms.of(estimated(views, both_sided()), np.array([0]))
    assert arms.change[0] == pytest.approx(0.0, abs=3.3 * np.sqrt(arms.covariance[0, 0]))
    assert arms.covariance[0, 0] < 0.1e-3**2
    behind = estimated(views[3:], both_sided())
    with pytest.raises(UserError, match="all stand behind the sheet"):
        LeverArms.of(behind, np.array([0]))


@pytest.mark.parametrize("level", [0.0, 1.0])
def test_levels_that_cannot_be(level):
    with pytest.raises(ConfigError):
        Faces(level=level)


@pytest.mark.long
@pytest.mark.parametrize(
    ("shear", "moved", "least", "most"),
    [(0.0, 0.0, 0.0, 0.10), (0.1, 0.0, 0.95, 1.0), (0.0, 0.3e-3, 0.95, 1.0)],
)
def test_size_and_power_in_sixty_sessions(shear, moved, least, most):
    """Whole fits, poses drawn; at a level of 5 %."""
    off = np.array([0, 0, 0, 0, 0, moved])
    found = [session(1000 + seed, shear=shear, moved=off) for seed in range(60)]
    share = np.mean([f.p_value < 0.05 for f in found])
    change, std = np.array([[f.change, f.std] for f in found]).T
    print(shear, moved, share, change.mean(), change.std(), std.mean())
    assert least <= share <= most
    assert np.mean(np.abs(change + 3e-3 * shear - moved) < 1.96 * std) >= 0.88
