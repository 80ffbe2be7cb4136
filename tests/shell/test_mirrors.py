"""Errors of the mirrors' calibration in a shell's bounds, and found together with its field."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sldvexp.field.bounds.pose_uncertainty import PoseErrors
from sldvexp.laser import Mirror, TwoMirror
from sldvexp.shell import estimate_surface
from sldvexp.shell.calibration import calibration_errors
from sldvexp.shell.method import PoseTreatment
from tests.shell import simulated_shell as lab

#: Of the gain, deg per unit, and of the zero, deg: a milliradian at the structure's edge.
GAIN, ZERO = 0.1, 0.02


def laser(up_down=0.0, left_right=0.0, gain_std=GAIN, zero_std=ZERO):
    """The lab's with gains that are off by so many degrees per unit."""
    one, other = (
        Mirror(25.0 + off, gain_std=gain_std, zero_std=zero_std) for off in (up_down, left_right)
    )
    return TwoMirror(up_down=one, left_right=other)


def estimated(views, own, poses=PoseTreatment.propagate):
    return estimate_surface(
        views, own, lab.volume(), lab.method(poses=poses), lab.SHEET, frequency=[lab.FREQUENCY]
    )


@pytest.mark.whole
def test_bounds_hold_what_each_error_does():
    """Of both gains and zeros, against fields that are solved with them."""
    views = lab.views(lab.plate(), np.random.default_rng(1))
    found = estimated(views, laser())
    group = found.field()
    of_source = group["variance"].sel(source="calibration").values[..., 0]
    errors = calibration_errors(views, laser(), None)
    assert len(errors) == 4
    square = np.zeros((2, *of_source.shape))
    for error in errors:
        high, low = (
            estimated(views, side[1]).field()["velocity"].values[..., 0]
            for side in (error.more, error.less)
        )
        change = (high - low) * error.part
        square += np.stack([change.real**2, change.imag**2])
    parts = found.fit.by_source(np.concatenate(_rows(found)))[1]["calibration"][..., 0]
    wanted = np.moveaxis(square, -1, 1).reshape(2, -1)
    strong = wanted > 0.1 * wanted.max(axis=1, keepdims=True)
    assert np.median(np.abs(parts - wanted)[strong] / wanted[strong]) < 0.03
    assert "calibration" not in group.attrs["not_included"]
    total = group["variance"].sum("source").values
    assert total == pytest.approx(group["velocity_std"].values ** 2, rel=1e-12)


def _rows(found):
    place, height = found.fit.outline.chart.place(found.prisms.position)
    return found.fit.shell.velocity(place, height)


@pytest.mark.whole
def test_bounds_hold_an_error_of_the_gain():
    """One standard deviation and a half; undeclared it is more wrong than its bounds say.

    What views say of one another narrows the bounds where poses and mirrors are adjusted.
    """
    truth = lab.plate()
    views = lab.views(truth, np.random.default_rng(2))
    off = {"up_down": 1.5 * GAIN, "left_right": -GAIN}
    true = truth.velocity(lab.volume().prisms().position, lab.FREQUENCY)[..., 2]
    errors, std = {}, {}
    for name, stated, poses in (
        ("silent", {"gain_std": 0.0, "zero_std": 0.0}, PoseTreatment.propagate),
        ("bounds", {}, PoseTreatment.propagate),
        ("adjusted", {}, PoseTreatment.adjust),
    ):
        found = estimated(views, laser(**off, **stated), poses)
        group = found.field()
        errors[name] = np.abs(group["velocity"].values[:, 2, 0] - true)
        std[name] = group["velocity_std"].values[:, 2, 0]
    assert np.mean(errors["silent"] < 2.45 * std["silent"]) < 0.5
    for name in ("bounds", "adjusted"):
        assert np.mean(errors[name] < 2.45 * std[name]) > 0.93
    assert np.median(std["adjusted"]) < np.median(std["bounds"]) / 1.5


def test_intrinsics_adjusted_with_the_poses_have_them_go_along():
    views = [
        replace(v, intrinsics=np.array([0.0, 1.0, 0.0, 1.0, 0.0]))
        for v in lab.views(lab.plate(), np.random.default_rng(3))
    ]
    pose = np.zeros((1, 5, 6))
    pose[0, :, 5] = 1e-4
    intrinsic = np.zeros((1, 5, 5))
    intrinsic[0, :, 1] = 1e-3
    known = PoseErrors(np.zeros((30, 30)), pose, intrinsic)
    (error,) = calibration_errors(views, lab.LASER, known)
    begin, way = error.of_beams(0, np.arange(9))
    assert begin == pytest.approx(np.broadcast_to([0, 0, 1e-4], begin.shape), abs=1e-12)
    assert 1e-5 < np.abs(way).max() < 1e-3


@pytest.mark.whole
def test_bounds_hold_what_pointing_does():
    """Pixels whose mirrors stand beside where they are sent: against fields of such errors.

    Less than the noise, so that the fields are as smooth.
    """
    step, truth = 0.2, lab.plate()
    own = replace(lab.LASER, pointing_std=step)
    views = lab.views(truth, np.random.default_rng(4))
    found = estimated(views, own)
    rows = np.concatenate(_rows(found))
    variance = found.fit.by_source(rows)[1]["pointing"][..., 0]
    rng, changes = np.random.default_rng(5), []
    still = found.fit.evaluate(rows)[0][:, 0]
    for _ in range(16):
        shaken = [replace(v, dac=v.dac + step * rng.normal(size=v.dac.shape)) for v in views]
        changes.append(estimated(shaken, lab.LASER).fit.evaluate(rows)[0][:, 0] - still)
    spread = (
        np.mean(np.square(np.real(changes)), axis=0),
        np.mean(np.square(np.imag(changes)), axis=0),
    )
    for part in range(2):
        # 16 fields against 64, over all nodes
        assert variance[part].mean() == pytest.approx(spread[part].mean(), rel=0.3)
    assert "pointing" not in found.field().attrs["not_included"]
