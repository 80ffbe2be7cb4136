"""Principal strains, stresses and force resultants with their bounds, alone and of a fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sldvexp.plot import hot_spots, hottest_places
from sldvexp.shell import (
    Isotropic,
    Spline,
    estimate_surface,
    plane_stress,
    principal,
    principal_std,
    stress_std,
    von_mises,
    von_mises_std,
)
from sldvexp.shell.gage import along
from sldvexp.shell.material import Tolerance
from sldvexp.shell.method import PoseTreatment
from sldvexp.shell.principal import ANY_DIRECTION
from tests.shell import simulated_shell as lab

SHEET = Isotropic(0.003, E=70e9, nu=0.33)


def some_strains(seed, count=200):
    rng = np.random.default_rng(seed)
    return 1e-6 * (rng.normal(size=(count, 3, 1)) + 1j * rng.normal(size=(count, 3, 1)))


def some_covariances(seed, count, size):
    """Of both parts, full matrices, shape (2, count, 3, 3, 1)."""
    factor = size * np.random.default_rng(seed).normal(size=(2, count, 3, 3))
    return np.einsum("npac,npbc->npab", factor, factor)[..., None], factor


def disturbed(strain, factor, rng):
    """The strains with errors of these covariances."""
    errors = np.einsum("npab,npb->npa", factor, rng.normal(size=factor.shape[:3]))
    return strain + (errors[0] + 1j * errors[1])[..., None]


def test_principal_strains_are_the_largest_of_all_directions_and_moments():
    strain = some_strains(1)
    theta, phi = np.meshgrid(np.linspace(0, np.pi, 361), np.linspace(0, 2 * np.pi, 361))
    found = principal(strain)
    for i, e in enumerate(strain[:20, :, 0]):
        seen = along(tuple(e), np.array([np.cos(theta), np.sin(theta)]))
        largest = np.real(seen * np.exp(1j * phi)).max()
        assert largest <= found.strain[i, 0, 0] * (1 + 1e-12)
        assert largest == pytest.approx(found.strain[i, 0, 0], rel=3e-4)


def test_at_the_moment_of_the_largest_extension_the_tensor_is_diagonal_along_it():
    strain = some_strains(2)
    found = principal(strain)
    ss, tt, st = np.moveaxis(np.real(strain * np.exp(1j * found.phase)[:, None]), 1, 0)
    tensor = np.array([[ss, st], [st, tt]])[..., 0].transpose(2, 0, 1)
    values, vectors = np.linalg.eigh(tensor)
    assert found.strain[..., 0] == pytest.approx(values[:, ::-1], abs=1e-15)
    angle = np.radians(found.direction)
    seen = vectors[:, 0, 1] * np.cos(angle[:, 0]) + vectors[:, 1, 1] * np.sin(angle[:, 0])
    assert np.abs(seen) == pytest.approx(1, abs=1e-9)


def test_principal_strains_turn_with_the_axes():
    strain, angle = some_strains(3, 50), np.radians(20)
    ss, tt, st = np.moveaxis(strain, 1, 0)
    c, s = np.cos(angle), np.sin(angle)
    turned = np.stack(
        [
            c * c * ss + s * s * tt + 2 * c * s * st,
            s * s * ss + c * c * tt - 2 * c * s * st,
            c * s * (tt - ss) + (c * c - s * s) * st,
        ],
        axis=1,
    )
    one, other = principal(strain), principal(turned)
    assert other.strain == pytest.approx(one.strain, rel=1e-9, abs=1e-15)
    assert (other.direction - one.direction + 20 + 90) % 180 - 90 == pytest.approx(0, abs=1e-4)


@pytest.mark.parametrize("part", ["real", "imaginary"])
def test_errors_of_principal_strains_where_only_one_part_errs(part):
    """By many small errors: with one part alone nothing is added in the least favourable way."""
    strain, rng = some_strains(4, 60), np.random.default_rng(5)
    covariance, factor = some_covariances(6, 60, 1e-11)
    still = 1 if part == "real" else 0
    covariance[still], factor[still] = 0, 0
    errors = [principal(disturbed(strain, factor, rng)) for _ in range(400)]
    std, direction = principal_std(strain, covariance)
    found = principal(strain)
    clear = direction[:, 0] < ANY_DIRECTION / 10
    assert clear.mean() > 0.5
    spread = np.std([e.strain for e in errors], axis=0)
    assert spread[clear] == pytest.approx(std[clear], rel=0.2)
    off = [(e.direction - found.direction + 90) % 180 - 90 for e in errors]
    assert np.std(off, axis=0)[clear] == pytest.approx(direction[clear], rel=0.2)


def test_bounds_of_principal_strains_and_stresses_hold_with_errors_of_a_tenth():
    """Of the strains' size; errors of both parts are taken to go together, so that they hold."""
    true, rng = some_strains(7, 2000), np.random.default_rng(8)
    covariance, factor = some_covariances(9, 2000, 0.06e-6)
    strain = disturbed(true, factor, rng)
    std, direction = principal_std(strain, covariance)
    one, other = principal(strain), principal(true)
    held = np.abs(one.strain - other.strain) <= 1.96 * std
    assert np.all(held.mean(axis=(0, 2)) >= 0.94)
    off = np.abs((one.direction - other.direction + 90) % 180 - 90)
    assert np.mean(off <= 1.96 * direction) >= 0.95
    stress, truth = (plane_stress(e, SHEET.E, SHEET.nu) for e in (strain, true))
    bound = 1.96 * von_mises_std(strain, covariance, SHEET)
    assert np.mean(np.abs(von_mises(stress) - von_mises(truth)) <= bound) >= 0.94
    error = np.abs((stress - truth).real)
    assert np.mean(error <= 1.96 * stress_std(strain, covariance, SHEET)) >= 0.95


ALIKE, IN_PHASE, BETWEEN = np.eye(3), 1.0, np.exp(0.25j * np.pi)
ALL_DIRECTIONS = np.diag([1.0, 1.0, 0.5])  # of errors that turn into themselves
#: Strains and errors (in 0.1 microstrain, of both parts) where the largest extension is hard.
HARD = {
    "one component at a phase between both parts": ([4, 1, 0.2], BETWEEN, ALIKE, ALIKE),
    "the worse part is not in phase": ([0.8, 4, 0.1], 1j, 1.4 * ALIKE, 0.6 * ALIKE),
    "all directions alike": ([4, 4, 0], IN_PHASE, ALL_DIRECTIONS, ALIKE),
    "all directions alike, of one part alone": ([4, 4, 0], IN_PHASE, ALIKE, 0 * ALIKE),
    "all directions alike, of both parts": ([4, 4, 0], BETWEEN, ALL_DIRECTIONS, ALL_DIRECTIONS),
    "all directions alike, by turns": ([4, -4, 4j], IN_PHASE, ALL_DIRECTIONS, ALL_DIRECTIONS),
    "nearly alike": ([4, 3.9, 0], IN_PHASE, ALL_DIRECTIONS, ALIKE),
    "shear": ([0, 0, 4], IN_PHASE, ALL_DIRECTIONS, ALIKE),
    "none": ([0, 0, 0], IN_PHASE, ALL_DIRECTIONS, ALL_DIRECTIONS),
}


@pytest.mark.one_in(2)
@pytest.mark.parametrize("together", [0.0, 1.0])
@pytest.mark.parametrize("name", HARD)
def test_bounds_of_the_largest_extension_hold_where_it_is_hard(name, together):
    """At least 95 % of all trials hold, down to four standard errors of that count."""
    size, turn, *spread = HARD[name]
    rng, trials = np.random.default_rng(11), 5000
    true = 1e-6 * np.array(size) * turn
    own = rng.normal(size=(2, trials, 3))
    own[1] = together * own[0] + np.sqrt(1 - together**2) * own[1]
    factor = 1e-7 * np.sqrt(np.array(spread))
    real, imaginary = np.einsum("pab,pnb->pna", factor, own)
    strain = (true + real + 1j * imaginary)[..., None]
    covariance = np.broadcast_to((factor**2)[:, None, :, :, None], (2, trials, 3, 3, 1))
    std, _ = principal_std(strain, covariance)
    found = principal(strain).strain
    error = np.abs(found - principal(true[None, :, None]).strain)
    held = (error <= 1.959964 * std).mean(axis=0)[:, 0]
    assert np.all(held >= 0.95 - 4 * np.sqrt(0.95 * 0.05 / trials)), held
    if name.startswith("one component") and together:  # what is added up is then all there is
        assert np.median(std[:, 0]) == pytest.approx(np.std(found[:, 0]), rel=0.04)


def test_pure_shear_has_two_directions():
    """Extension along 45 degrees and, half a cycle later, along 135: neither is the one."""
    strain = np.array([[[0], [0], [1e-6]]], complex)
    covariance = np.zeros((2, 1, 3, 3, 1))
    covariance[0, 0, range(3), range(3)] = 1e-20
    found = principal(strain)
    assert found.strain[0, :, 0] == pytest.approx([1e-6, -1e-6])
    assert found.direction[0, 0] % 90 == pytest.approx(45)
    assert principal_std(strain, covariance)[1][0, 0] == ANY_DIRECTION


def test_no_strain_at_all_has_no_direction_and_no_numbers_that_are_none():
    strain, covariance = np.zeros((1, 3, 1), complex), np.zeros((2, 1, 3, 3, 1))
    std, direction = principal_std(strain, covariance)
    assert direction[0, 0] == ANY_DIRECTION
    assert np.all(std == 0)
    assert np.all(von_mises_std(strain, covariance, SHEET) == 0)


def test_tolerances_of_the_material_widen_stresses():
    strain, covariance = some_strains(10, 20), np.zeros((2, 20, 3, 3, 1))
    known = replace(SHEET, tolerance=Tolerance(E=0.02 * SHEET.E, nu=0.01))
    stress = plane_stress(strain, SHEET.E, SHEET.nu)
    by_nu = plane_stress(strain, SHEET.E, SHEET.nu + 0.01) - stress
    expected = np.sqrt(np.abs(0.02 * stress) ** 2 + np.abs(by_nu) ** 2)
    assert stress_std(strain, covariance, known) == pytest.approx(expected, rel=0.02)
    of_mises = von_mises(stress + by_nu) - von_mises(stress)
    expected = np.sqrt((0.02 * von_mises(stress)) ** 2 + of_mises**2)
    assert von_mises_std(strain, covariance, known) == pytest.approx(expected, rel=0.02)


def estimated(
    seed, sheet=SHEET, method=None, radius=None, noise=lab.NOISE, frequency=(lab.FREQUENCY,)
):
    seen = np.where(frequency, frequency, lab.FREQUENCY)
    views = lab.views(lab.plate(radius), np.random.default_rng(seed), noise=noise, frequency=seen)
    return estimate_surface(
        views, lab.LASER, lab.volume(radius), method or lab.method(), sheet, frequency=frequency
    )


@pytest.fixture(scope="module")
def found():
    return estimated(1)


@pytest.fixture(scope="module")
def group(found):
    return found.strain()


@pytest.mark.whole
def test_bending_and_membrane_make_face_and_back(group):
    middle, bending = group["middle_strain"].values, group["bending_strain"].values
    assert group["strain"].values == pytest.approx(middle + bending, abs=1e-15)
    assert group["back_strain"].values == pytest.approx(middle - bending, abs=1e-15)


def test_force_resultants_are_those_of_a_plate(found, group):
    """N = E h / (1 - nu^2) (e_ss + nu e_tt), M = -D (w,ss + nu w,tt)."""
    w = found.fit.shell.bending
    place, n = found.fit.outline.corners, found.fit.shell.membrane.count
    rows = np.concatenate(
        [np.pad(w(place, i, j), ((0, 0), (2 * n, 0))) for i, j in ((2, 0), (0, 2), (1, 1))]
    )
    omega = 2 * np.pi * lab.FREQUENCY
    ss, tt, st = (found.fit.evaluate(rows)[0][:, 0] / (1j * omega)).reshape(3, -1)
    d = SHEET.E * 0.003**3 / 12 / (1 - SHEET.nu**2)
    moment = group["bending_moment"].values[..., 0]
    assert moment[:, 0] == pytest.approx(-d * (ss + SHEET.nu * tt), rel=1e-6)
    assert moment[:, 2] == pytest.approx(-d * (1 - SHEET.nu) * st, rel=1e-6)
    ss, tt, st = np.moveaxis(group["middle_strain"].values[..., 0], 1, 0)
    force = group["membrane_force"].values[..., 0]
    stiff = SHEET.E * 0.003 / (1 - SHEET.nu**2)
    assert force[:, 1] == pytest.approx(stiff * (tt + SHEET.nu * ss), rel=1e-6)
    assert force[:, 2] == pytest.approx(stiff * (1 - SHEET.nu) * st, rel=1e-6)


def test_stresses_know_how_strains_of_a_place_go_together(found, group):
    """A stress is a strain of its own to the fit, which knows its variance."""
    rows = found.fit.shell.strain(found.fit.outline.corners, found.fit.face)
    _, own, others = found.fit.evaluate(rows[0] + SHEET.nu * rows[1])
    std = np.sqrt((own + others).max(axis=0)) / (2 * np.pi * lab.FREQUENCY)
    expected = SHEET.E / (1 - SHEET.nu**2) * std
    assert group["stress_std"].values[:, 0] == pytest.approx(expected, rel=1e-6)


def test_a_thickness_known_to_two_percent_leaves_moments_unknown_to_six():
    """M grows with h^3 if the motion is given; strains of bending grow with h."""
    loose = replace(SHEET, tolerance=Tolerance(thickness=0.02 * SHEET.thickness))
    method = lab.method(poses=PoseTreatment.propagate)
    known = estimated(1, loose, method, noise=1e-8)
    group = known.strain()
    assert group.attrs["thickness_std"] == 0.02 * SHEET.thickness
    assert "thickness" not in known.field().attrs["not_included"]
    largest = np.abs(group["bending_strain"].values[:, 0, 0]).argmax()
    for name, share in ("bending_strain", 0.02), ("bending_moment", 0.06):
        value, std = (group[n].values[largest, 0, 0] for n in (name, f"{name}_std"))
        assert std / abs(value) == pytest.approx(share, rel=0.05)


@pytest.mark.whole
def test_a_wrong_thickness_makes_strains_of_bending_wrong_by_its_ratio_and_is_told_as_taken():
    """The relation that the handbook states, and the name of what is in no bound."""
    method = lab.method(poses=PoseTreatment.propagate)
    right, wrong = (
        estimated(1, replace(SHEET, thickness=h), method, noise=1e-8) for h in (0.003, 0.0045)
    )
    one, other = (found.strain()["bending_strain"].values[:, 0, 0] for found in (right, wrong))
    largest = np.abs(one).argmax()
    assert abs(other[largest] / one[largest]) == pytest.approx(1.5, rel=0.01)
    told = wrong.field().attrs["not_included"].split("; ")
    assert told[-1] == "thickness of the sheet, taken as 4.5 mm"
    strain = wrong.strain()
    assert (strain.attrs["thickness"], strain.attrs["thickness_std"]) == (0.0045, 0.0)


def test_principal_strains_and_stresses_of_a_plate_are_those_of_its_truth(found, group):
    truth = lab.plate().strain(found.prisms.surface, lab.FREQUENCY)[..., None]
    expected = principal(truth)
    error = np.abs(group["principal_strain"].values - expected.strain)
    assert np.mean(error <= group["principal_confidence"].values) >= 0.93
    stress = von_mises(plane_stress(truth, SHEET.E, SHEET.nu))
    error = np.abs(group["von_mises"].values - stress)
    assert np.mean(error <= group["von_mises_confidence"].values) >= 0.93
    assert np.linalg.norm(error) < 0.05 * np.linalg.norm(stress)
    off = np.abs((group["principal_direction"].values - expected.direction + 90) % 180 - 90)
    std = group["principal_direction_std"].values
    assert np.mean(off <= 2 * std) >= 0.93
    clear = expected.strain[:, 0] > 0.5 * expected.strain[:, 0].max()
    assert np.median(off[clear]) < 3


@pytest.mark.whole
def test_free_splines_have_strains_of_the_face_alone():
    free = estimated(2, None, Spline())
    group = free.strain()
    assert "thickness" not in group.attrs
    assert "thickness" not in free.field().attrs["not_included"]
    assert "principal_strain" in group
    assert not {"middle_strain", "bending_moment", "von_mises"} & set(group)


def test_directions_of_a_panel_lie_in_its_surface():
    group = estimated(3, radius=0.5).strain()
    place, frame = group["coordinate"].values, group["frame"].values
    assert place.shape == (group.sizes["place"], 2)
    assert np.einsum("pia,pja->pij", frame, frame) == pytest.approx(
        np.broadcast_to(np.eye(3), frame.shape), abs=1e-12
    )
    assert frame[:, 2] @ frame[:, 2].mean(axis=0) == pytest.approx(1, abs=0.05)


@pytest.mark.whole
@pytest.mark.filterwarnings("error")
def test_a_velocity_at_no_frequency_has_no_strain_and_the_others_keep_theirs():
    group = estimated(4, frequency=[0.0, lab.FREQUENCY]).strain()
    for name in ("strain", "principal_strain", "von_mises", "bending_moment_std"):
        assert np.isnan(group[name].values[..., 0]).all()
        assert np.isfinite(group[name].values[..., 1]).all()
    assert "197 Hz" in hot_spots({"strain": group}).get_suptitle()
    assert hottest_places(group.isel(frequency=0)) == []
