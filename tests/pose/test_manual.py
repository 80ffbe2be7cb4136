"""A registration by eye: bounds from the errors that are known beforehand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sldvexp.geometry import rotation_from_euler
from sldvexp.io.registration import RegistrationTable, write
from sldvexp.laser import TwoMirror, project
from sldvexp.pose.manual import Manual
from sldvexp.targets import FiducialPoint, FiducialPoints
from sldvexp.units import LengthUnit

LASER = TwoMirror()
ROTATION, ORIGIN = rotation_from_euler([-1.153, 2.547, 1.913]), np.array([0.862, 0.508, 1.553])
MARKS = {1: (0, 0, 0), 2: (11, 0, 0), 3: (11, 11, 0), 4: (0, 11, 0), 5: (3.5, 3.5, 2), 6: (7, 7, 2)}
TARGET = FiducialPoints(
    unit=LengthUnit.inch,
    accuracy=1 / 64,
    fiducials={n: FiducialPoint(*map(float, xyz)) for n, xyz in MARKS.items()},
)


def pointed(rng, path, pointing=1.0, worse=1.0):
    """An operator's file: marks that stand elsewhere than measured, and a shaky hand."""
    points = TARGET.points()
    true = points.position + worse * points.std * rng.uniform(-1, 1, points.position.shape) * 3**0.5
    angle = project((true - ORIGIN) @ ROTATION.T)
    dac = LASER.dac_from_angle(angle) + worse * pointing * rng.standard_normal(angle.shape)
    write(path, [RegistrationTable("hand", points.number, points.position, dac=dac)])
    return path


@pytest.mark.long
def test_bounds_from_known_errors_cover_the_truth(tmp_path):
    rng, repeats = np.random.default_rng(0), 300
    inside = []
    for _ in range(repeats):
        path = pointed(rng, tmp_path / "hand.csv")
        pose = Manual(path=str(path)).estimate(LASER, TARGET, {}).pose.isel(view=0)
        inside.append(np.abs(pose["origin"] - ORIGIN) <= pose["origin_confidence"])
        assert np.isinf(pose["dof"])
    # Position errors are uniform and seen at a slant: their bound is a little wide.
    share = np.mean(inside, axis=0)
    assert (share > 0.95 - 4 * np.sqrt(0.95 * 0.05 / repeats)).all()
    assert (share < 0.995).all()


def test_larger_residuals_than_stated_are_doubted(tmp_path):
    path = pointed(np.random.default_rng(1), tmp_path / "hand.csv", worse=5.0)
    for target in (TARGET, None):
        found = Manual(path=str(path)).estimate(LASER, target, {})
        (finding,) = (f for f in found.findings if f.kind == "residuals")
        assert "the bounds, which rest on these, are too small" in finding.text
        assert (finding.subject, finding.severity.name) == ("view hand", "doubtful")
    path = pointed(np.random.default_rng(1), tmp_path / "hand.csv")
    assert not Manual(path=str(path)).estimate(LASER, TARGET, {}).findings


def test_marks_known_better_give_smaller_bounds(tmp_path):
    path = pointed(np.random.default_rng(2), tmp_path / "hand.csv")
    method = Manual(path=str(path))
    rough, fine = (
        method.estimate(LASER, replace(TARGET, accuracy=a), {}).pose["origin_std"]
        for a in (1 / 64, 1e-6)
    )
    assert (fine < rough).all()
    alone = method.estimate(LASER, None, {}).pose["origin_std"]
    np.testing.assert_allclose(alone, fine, rtol=1e-4)


def test_pointing_must_be_positive():
    with pytest.raises(Exception, match="must be a positive number"):
        Manual(path="a.reg", pointing=0.0)
