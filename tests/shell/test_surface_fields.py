"""Shells and free splines from simulated views: errors, coverage, poses, height, and bad input."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sldvexp.errors import UserError
from sldvexp.shell import Isotropic, Shell, Spline, estimate_surface
from sldvexp.shell.material import Tolerance
from sldvexp.shell.method import GivenSurface, PoseTreatment
from tests.shell import simulated_shell as lab


def compared(found, truth, level=1.96):
    """Relative errors of motion and strain on the face, and what their intervals hold, by part."""
    place = found.fit.outline.corners
    frames = found.fit.outline.chart.frames(place)
    rows = found.fit.shell.velocity(place, found.fit.face)
    face = found.prisms.surface + (found.fit.face - found.fit.outline.given) * frames[:, 2]
    true = np.einsum("pij,pj->pi", frames, truth.velocity(face, lab.FREQUENCY))
    strain = truth.strain(face, lab.FREQUENCY)
    errors, held = [], []
    for i in range(3):
        value, own, others = found.fit.evaluate(rows[i])
        error = value[:, 0] - true[:, i]
        bound = level * np.sqrt((own + others)[..., 0])
        errors.append(np.linalg.norm(error) / np.linalg.norm(true[:, i]))
        held.append([np.abs(error.real) <= bound[0], np.abs(error.imag) <= bound[1]])
    group = found.strain()
    for i in range(3):
        error = group["strain"].values[:, i, 0] - strain[:, i]
        bound = level * group["strain_std_by_part"].values[:, :, i, 0]
        errors.append(np.linalg.norm(error) / np.linalg.norm(strain[:, i]))
        held.append([np.abs(error.real) <= bound[0], np.abs(error.imag) <= bound[1]])
    return np.array(errors), np.array(held)


def estimated(views, volume, method=None, sheet=lab.SHEET, **known):
    return estimate_surface(
        views, lab.LASER, volume, method or lab.method(), sheet, frequency=[lab.FREQUENCY], **known
    )


@pytest.mark.one_in(2)
@pytest.mark.parametrize("radius", [None, 0.5])
def test_motion_and_strain_of_a_sheet(radius):
    truth = lab.plate(radius)
    views = lab.views(truth, np.random.default_rng(1))
    errors, _ = compared(estimated(views, lab.volume(radius)), truth)
    assert np.all(errors[:2] < 0.10)
    assert errors[2] < 0.001
    assert np.all(errors[3:] < 0.12)


@pytest.mark.whole
def test_a_shell_beats_free_splines():
    truth = lab.plate()
    views = lab.views(truth, np.random.default_rng(2))
    shell, _ = compared(estimated(views, lab.volume()), truth)
    free, _ = compared(estimated(views, lab.volume(), Spline()), truth)
    assert np.all(shell[:2] < free[:2])
    assert np.all(1.2 * shell[3:] < free[3:])


@pytest.mark.whole
def test_without_noise_the_motion_is_exact():
    """To what the splines can follow."""
    truth = lab.plate()
    views = lab.views(truth, np.random.default_rng(3), noise=1e-9)
    errors, _ = compared(estimated(views, lab.volume()), truth)
    assert np.all(errors[:3] < 1e-4)
    assert np.all(errors[3:] < 1e-3)


@pytest.mark.whole
def test_a_faster_structure_comes_out_alike():
    """All velocities times 1000: relative errors are nearly the same."""
    truth = lab.plate()
    views = lab.views(truth, np.random.default_rng(4))
    once, _ = compared(estimated(views, lab.volume()), truth)
    faster = [replace(v, velocity=1e3 * v.velocity, std=1e3 * np.asarray(v.std)) for v in views]
    found = estimated(faster, lab.volume())
    group = found.strain()
    strain = truth.strain(found.prisms.surface, lab.FREQUENCY)
    error = group["strain"].values[..., 0] / 1e3 - strain
    again = np.linalg.norm(error, axis=0) / np.linalg.norm(strain, axis=0)
    assert again == pytest.approx(once[3:], rel=0.02)


def shares_held(stretch, seeds):
    """Shares of intervals that hold, (session, quantity, part): places of a session are alike."""
    truth, volume, held = lab.plate(stretch=stretch), lab.volume(shape=(9, 7)), []
    for seed in range(seeds):
        views = lab.views(truth, np.random.default_rng(100 + seed), pixels=(17, 19))
        held.append(compared(estimated(views, volume), truth)[1].mean(axis=-1))
    return np.array(held)


@pytest.mark.whole
def test_intervals_hold_in_some_sessions():
    held = shares_held(0.1, 5)
    spread = held.std(axis=0, ddof=1) / np.sqrt(5)
    assert np.all(held.mean(axis=0) + 3 * spread >= 0.93)
    assert held.mean() >= 0.94


@pytest.mark.long
@pytest.mark.parametrize("stretch", [0.2, 0.067, 0.04])
def test_intervals_hold_in_fifty_sessions(stretch):
    """Shrinkage leaves them wider than they need be where there is little to find."""
    share = shares_held(stretch, 50).mean(axis=0)
    print(stretch, share.round(3).tolist())
    assert np.all(share >= 0.90)
    assert share.mean() >= 0.93


def turned(rng, angle, way):
    """PriorErrors of the poses, and their covariance."""
    std = np.tile([angle] * 3 + [way] * 3, len(lab.PLACES))
    return (std * rng.normal(size=len(std))).reshape(-1, 6), np.diag(std**2)


def test_poses_are_adjusted_with_the_field():
    """Twenty times worse than automated ones; the adjusted ones are nearly as good as the true."""
    truth, rng = lab.plate(), np.random.default_rng(5)
    errors, covariance = turned(rng, 0.3e-3, 0.5e-3)
    views = lab.views(truth, rng, errors=errors)
    adjusted = estimated(views, lab.volume(), covariance=covariance)
    kept = lab.method(poses=PoseTreatment.propagate)
    propagated = estimated(views, lab.volume(), kept, covariance=covariance)
    own, held = compared(adjusted, truth)
    others, _ = compared(propagated, truth)
    assert np.all(own[:2] < 0.08)
    assert own[2] < others[2] / 2
    assert held.mean() > 0.9
    assert np.abs(adjusted.fit.nuisances.mean).max() > 0
    assert np.all(propagated.fit.nuisances.mean == 0)


@pytest.mark.whole
def test_a_declared_height_is_found():
    """A surface that is given 0.5 mm too low, and may be off by a millimetre."""
    truth, volume = lab.plate(), lab.volume()
    volume.center = [*volume.center[:2], -0.5e-3]
    views = lab.views(truth, np.random.default_rng(6))
    found = estimated(views, volume, lab.method(height_tolerance=1e-3))
    height, std = found.fit.nuisances.mean[-2], np.linalg.norm(found.fit.nuisances.factor[-2])
    assert std < 0.2e-3
    assert abs(height - 0.5e-3) < 4 * std


@pytest.mark.whole
def test_a_thickness_that_is_not_known_well_widens_the_bounds():
    truth = lab.plate()
    views = lab.views(truth, np.random.default_rng(7))
    vague = Isotropic(thickness=0.003, tolerance=Tolerance(thickness=0.1e-3))
    kept = lab.method(poses=PoseTreatment.propagate)
    exact, wide = (estimated(views, lab.volume(), kept, s).strain() for s in (lab.SHEET, vague))
    added = wide["strain_std_by_part"].values ** 2 - exact["strain_std_by_part"].values ** 2
    size = np.abs(exact["strain"].values.imag)
    strongest = size > 0.7 * size.max()
    # strain of bending is proportional to the thickness
    relative = np.sqrt(added[1][strongest]) / size[strongest]
    assert np.median(relative) == pytest.approx(0.1 / 3, rel=0.3)


@pytest.mark.whole
def test_the_given_surface_may_be_the_face():
    truth, volume = lab.plate(), lab.volume()
    volume.center = [*volume.center[:2], 0.0015]
    views = lab.views(truth, np.random.default_rng(8))
    middle = estimated(views, lab.volume()).strain()["strain"].values
    face = estimated(views, volume, lab.method(given=GivenSurface.face)).strain()["strain"].values
    assert face == pytest.approx(middle, abs=1e-9 * np.abs(middle).max())


@pytest.mark.whole
def test_noise_that_is_not_stated_is_estimated():
    truth = lab.plate()
    views = lab.views(truth, np.random.default_rng(9))
    silent = [replace(v, std=np.zeros(len(v.dac))) for v in views]
    found = estimated(silent, lab.volume())
    assert found.fit.measured.pixel_std[0] == pytest.approx(lab.NOISE, rel=0.05)
    assert any("noise is not stated" in note for note in found.notes)
    errors, _ = compared(found, truth)
    assert errors[2] < 0.001


def test_all_nodes_move_as_love_says():
    """Layers one millimetre apart: u changes by the slope of w, w not at all."""
    truth = lab.plate()
    found = estimated(lab.views(truth, np.random.default_rng(10)), lab.volume())
    group = found.field()
    low, high = np.split(group["velocity"].values[..., 0], 2)
    height = np.ptp(found.prisms.depth)
    assert low[:, 2] == pytest.approx(high[:, 2])
    rows = np.zeros((len(low), found.fit.shell.coefficients))
    rows[:, -found.fit.shell.bending.count :] = found.fit.shell.bending(
        found.fit.outline.corners, 1, 0
    )
    assert (low - high)[:, 0] / height == pytest.approx(found.fit.evaluate(rows)[0][:, 0])


@pytest.mark.whole
def test_parts_of_the_budget_add_up():
    truth, rng = lab.plate(), np.random.default_rng(11)
    errors, covariance = turned(rng, 0.3e-3, 0.5e-3)
    views = lab.views(truth, rng, errors=errors)
    group = estimated(views, lab.volume(), covariance=covariance).field()
    assert group["variance"].sum("source").values == pytest.approx(
        group["velocity_std"].values ** 2, rel=1e-12
    )


@pytest.mark.whole
def test_poses_of_which_nothing_is_known_are_no_source_of_nothing():
    views = lab.views(lab.plate(), np.random.default_rng(11))
    known = np.eye(6 * len(views)) * 1e-10
    for covariance, told in ((None, False), (known, True)):
        group = estimated(views, lab.volume(), covariance=covariance).field()
        assert ("pose" in group["source"].values) is told
        assert ("velocity_std_pose" in group) is told
        assert ("poses" in group.attrs["not_included"].split("; ")) is not told


def test_a_shell_needs_a_thickness():
    views = lab.views(lab.plate(), np.random.default_rng(12))
    with pytest.raises(UserError, match=r"thickness: choose material=aluminium material.thickness"):
        estimated(views, lab.volume(), sheet=None)
    assert estimated(views, lab.volume(), Spline(), sheet=None).fit.face == 0


def test_a_thickness_in_mm_is_told():
    views = lab.views(lab.plate(), np.random.default_rng(12))
    sheet = replace(lab.SHEET, thickness=1e3 * lab.SHEET.thickness)
    with pytest.raises(UserError, match=r"^material.thickness is \d m, and the surface is 0.\d+ m"):
        estimated(views, lab.volume(), sheet=sheet)


def test_a_structure_at_rest_is_told():
    views = lab.views(lab.plate(), np.random.default_rng(14))
    still = [replace(v, velocity=np.zeros_like(v.velocity)) for v in views]
    with pytest.raises(UserError, match=r"^all pixels that meet the surface are at rest"):
        estimated(still, lab.volume())


def test_a_volume_beside_the_structure_is_told():
    volume = lab.volume()
    volume.center = [5.0, 0.14, 0.0]
    views = lab.views(lab.plate(), np.random.default_rng(13))
    with pytest.raises(UserError, match=r"^0 pixels of all views .* does the volume lie where"):
        estimated(views, volume)


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"cells": 1}, "cells: must be 2 or more"),
        ({"confidence": 1.0}, "confidence: must lie between 0 and 1"),
        ({"membrane_length": 0.0}, "membrane_length: must be a positive"),
        ({"membrane_level": 0.0}, "membrane_level: must be above 0 and at most 1, not 0"),
    ],
)
def test_settings_that_cannot_be(settings, told):
    with pytest.raises(UserError, match=told):
        Shell(**settings)


def test_free_splines_keep_their_poses():
    with pytest.raises(UserError, match=r"poses: must be propagate"):
        Spline(poses=PoseTreatment.adjust)


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({}, "thickness: must be given, in m, as in 0.003"),
        ({"thickness": 0.003, "nu": 0.5}, "nu: must lie between -1 and 0.5"),
        ({"thickness": 0.003, "E": 0.0}, "E: must be a positive"),
    ],
)
def test_materials_that_cannot_be(settings, told):
    with pytest.raises(UserError, match=told):
        Isotropic(**settings)
