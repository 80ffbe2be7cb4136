"""Models are mapped on pixels as the virtual lab sees them, and wrong shapes are found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from sldvexp.geometry import rotation_from_vector
from sldvexp.models import StackedPixels, assurance_matrix, examine_shape, join_shapes
from sldvexp.models.mapping import map_shapes, modal_pixels
from sldvexp.models.seen_surface import SeenSurface
from tests.models.made_models import (
    LASER,
    POSE_STD,
    THICKNESS,
    VELOCITY,
    Measured,
    closed_form,
    true_plate,
)

#: 0.2 % of the plate's mass, kg.
MASS = 0.002 * 2700 * 0.003 * 0.3 * 0.25


@pytest.fixture(scope="module")
def measured():
    return Measured(true_plate())


def mapped(measured, model, seed, pose_std=None):
    pixels = modal_pixels(measured.tree(seed, pose_std=pose_std), LASER)
    return [map_shapes(model, one) for one in pixels]


def examined(measured, model, seed, pose_std=None):
    stacked = StackedPixels.of_views(mapped(measured, model, seed, pose_std))
    return [examine_shape(stacked, k, k) for k in range(model.modes)]


@pytest.mark.whole
@pytest.mark.parametrize("rotations", [True, False])
@pytest.mark.parametrize("triangles", [True, False])
def test_pixels_see_the_closed_form_with_an_error_of_fourth_order(measured, rotations, triangles):
    error = []
    for n in ((12, 10), (24, 20)):
        model = closed_form(n, rotations=rotations, triangles=triangles)
        views = mapped(measured, model, 0)
        own = []
        for view, true in zip(views, measured.velocity, strict=True):
            assert not len(view.beside.pixel)
            off = view.shape * VELOCITY - true.real
            own.append(np.sqrt(np.mean(off**2, axis=0) / np.mean(true.real**2, axis=0)))
        error.append(np.max(own, axis=0))
    assert np.all(error[0] < 0.006)
    assert np.all(error[1] < 3e-4)
    assert np.all(error[0][1:] > 7 * error[1][1:])


def test_surface_half_a_thickness_beside_the_elements_moves_along_them_too(measured):
    model = closed_form((24, 20))
    seen = SeenSurface(model, THICKNESS / 2)
    plate, names = measured.plate, measured.plate.mode_names
    for k, (name, f) in enumerate(zip(names, model.frequency, strict=True)):
        true = plate.in_modes({n: float(n == name) for n in names}).velocity(seen.position, f)
        inside = np.isfinite(true).all(axis=1)
        assert np.abs(true[inside]).max(axis=0).min() > 1e-4
        np.testing.assert_allclose(VELOCITY[k] * seen.motion[inside, :, k], true[inside], atol=1e-9)


@pytest.mark.whole
def test_turning_about_the_elements_is_not_felt_along_the_beam(measured):
    """All points of a rigid line along a beam have one velocity along it."""
    views = mapped(measured, closed_form((24, 20)), 0)
    flat = mapped(measured, closed_form((24, 20), thickness=1e-9), 0)
    for view, other in zip(views, flat, strict=True):
        apart = np.linalg.norm(view.place - other.place, axis=1)
        assert np.median(apart) > 1.5e-3  # along the beam
        assert np.abs(view.shape - other.shape).max() < 2e-3


def test_effect_of_a_pose_is_that_of_a_pose_that_is_off(measured):

    model, (pixels, *_) = closed_form(), modal_pixels(measured.tree(0), LASER)
    step = np.array([4e-5, -2e-5, 6e-5, 2e-5, 4e-5, -2e-5])

    moved = replace(
        pixels,
        rotation=rotation_from_vector(step[:3]) @ pixels.rotation,
        origin=pixels.origin + step[3:],
    )
    here, there = map_shapes(model, pixels), map_shapes(model, moved)
    change = there.shape - here.shape
    assert np.abs(change).max() > 1e-3
    np.testing.assert_allclose(here.by_pose @ step, change, atol=1e-5)


@pytest.mark.whole
@pytest.mark.parametrize("sessions", [3, pytest.param(6, marks=pytest.mark.whole)])
def test_right_model_leaves_noise_also_with_poses_that_are_off(measured, sessions):
    found = [join_shapes(examined(measured, closed_form(), s, POSE_STD)) for s in range(sessions)]
    values = [p for one in found for p in (one.p_value, one.directed_p_value)]
    assert stats.kstest(values[::2], "uniform").pvalue > 1e-3
    assert min(values) > 0.05 / (len(values) * 20)
    # Without the poses' part the same data would reject it: the test has to know them.
    blind = mapped(measured, closed_form(), 0, 4 * POSE_STD)
    stacked = StackedPixels.of_views(blind)

    without = replace(stacked, by_pose=0 * stacked.by_pose)
    known, unknown = (
        join_shapes([examine_shape(s, k, k) for k in range(5)]) for s in (stacked, without)
    )
    assert known.p_value > 1e-3 > 1e-6 > unknown.p_value


@pytest.mark.whole
def test_added_mass_of_two_thousandths_is_found_and_mixes_neighbouring_modes():
    tests = examined(Measured(true_plate(MASS)), closed_form(), 0, POSE_STD)
    assert join_shapes(tests).p_value < 1e-12
    assert [t.p_value < 1e-6 for t in tests] == [False, True, True, True, True]
    last = tests[4]
    assert int(np.argmax(np.abs(last.mixed))) == 3
    assert np.abs(last.mixed[3]) > 10 * last.mixed_std[3]


def test_assurance_of_a_right_model_is_near_its_expected_value(measured):
    stacked = StackedPixels.of_views(mapped(measured, closed_form((24, 20)), 3))
    mac = assurance_matrix(stacked)
    off = (mac.value - mac.expected).diagonal() / mac.std.diagonal()
    assert np.abs(off).max() < 3.5
    assert np.all(mac.value.diagonal() < 1)


@pytest.mark.whole
def test_poses_that_are_off_together_are_known_by_their_joint_covariance(measured):
    """All stand beside where they are said to stand, as after a bundle without a fixed world."""
    std, off = 1e-3, np.array([1e-3, -1e-3, 0.5e-3])
    tree = measured.tree(5, pose_std=POSE_STD)
    tree["pose"] = tree["pose"].assign(origin=tree["pose"].origin + off)
    views = [map_shapes(closed_form(), one) for one in modal_pixels(tree, LASER)]
    common = np.kron(np.ones((5, 5)), np.diag([0, 0, 0, std**2, std**2, std**2]))
    joint = common + np.kron(np.eye(5), np.diag(POSE_STD**2))
    for covariance, right in ((joint, True), (None, False)):
        stacked = StackedPixels.of_views(views, covariance)
        found = join_shapes([examine_shape(stacked, k, k) for k in range(5)])
        assert (found.p_value > 1e-3) == right


@pytest.mark.whole
def test_mixing_that_uncertain_poles_make_is_known_and_no_fault_of_the_model(measured):
    tree, share = measured.tree(4), 0.01
    for name, image in list(tree.items()):
        if name.startswith("modes/image/"):
            velocity = image["velocity"].copy()
            velocity[:, 3] = velocity[:, 3] + share * velocity[:, 4]
            tree[name] = image.assign(velocity=velocity)
    views = [map_shapes(closed_form(), one) for one in modal_pixels(tree, LASER)]
    mixing = np.zeros((2, 5, 5))
    assert examine_shape(StackedPixels.of_views(views, None, mixing), 3, 3).p_value < 1e-3
    mixing[0, 3, 4] = share
    assert examine_shape(StackedPixels.of_views(views, None, mixing), 3, 3).p_value > 1e-2
    assert examine_shape(StackedPixels.of_views(views, None, mixing[::-1]), 3, 3).p_value < 1e-3
