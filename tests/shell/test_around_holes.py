"""Singular functions around holes: derivatives, the plate equation, and strain at a hole's edge."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sldvexp.shell import Outline, estimate_surface
from sldvexp.shell.around_holes import FUNCTIONS, HoleFunctions
from sldvexp.shell.outline import rims
from sldvexp.virtual_lab.annular import AnnularMode
from sldvexp.virtual_lab.annular_plate import AnnularPlate
from sldvexp.virtual_lab.plate import VibratingPlate
from sldvexp.volume import Contour, Grid, MeshFile, OutlinedSurface
from tests.shell import simulated_shell as lab

FREQUENCY = 225.0
AROUND = HoleFunctions.of([(np.array([0.02, -0.01]), 0.03)], 0.02)


def ring(radius=0.124, hole=0.031):
    return OutlinedSurface(
        center=lab.CENTER.tolist(),
        outline=Contour(radius=radius),
        holes={"middle": Contour(radius=hole)},
        layers=2,
    )


def disc():
    modes = {"ring": AnnularMode(), "two": AnnularMode(2, angle=30.0, velocity=0.3)}
    return VibratingPlate.built(AnnularPlate(center=lab.CENTER.tolist(), modes=modes))


@pytest.mark.parametrize(("i", "j"), [(1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (2, 1), (2, 2)])
def test_derivatives_are_those_of_the_functions(i, j):
    rng, step = np.random.default_rng(1), 1e-5
    places = np.array([0.02, -0.01]) + rng.uniform(0.04, 0.1, (30, 2)) * rng.choice(
        [-1, 1], (30, 2)
    )
    along = (1, 0) if i else (0, 1)
    h = step * np.array(along) / 2
    before = (i - along[0], j - along[1])
    by = (AROUND(places + h, *before) - AROUND(places - h, *before)) / step
    found = AROUND(places, i, j)
    assert found.shape == (30, FUNCTIONS)
    assert found == pytest.approx(by, abs=1e-6 * np.abs(by).max())
    assert (np.abs(found).max(axis=0) > 0).all()


def test_they_solve_the_equation_of_a_plate_at_rest():
    rng = np.random.default_rng(2)
    places = np.array([0.02, -0.01]) + rng.uniform(0.03, 0.1, (30, 2))
    bilaplacian = AROUND(places, 4, 0) + 2 * AROUND(places, 2, 2) + AROUND(places, 0, 4)
    assert np.abs(bilaplacian).max() < 1e-10 * np.abs(AROUND(places, 4, 0)).max()


def test_holes_of_an_outline_are_found():
    volume = OutlinedSurface(
        outline=Contour([[-0.1, -0.1], [0.2, -0.1], [0.2, 0.1], [-0.1, 0.1]]),
        holes={
            "round": Contour(center=[0.02, 0.01], radius=0.03),
            "square": Contour([[0.1, 0.0], [0.14, 0.0], [0.14, 0.04], [0.1, 0.04]]),
        },
    )
    outline = Outline.of(volume, volume.prisms(), 0.0)
    (first, b), (second, c) = sorted(outline.holes, key=lambda hole: hole[0][0])
    assert first == pytest.approx([0.02, 0.01])
    assert second == pytest.approx([0.12, 0.02])
    assert b == pytest.approx(0.03, rel=0.01)
    assert c == pytest.approx(0.04 / np.sqrt(np.pi), rel=1e-9)
    grid = Grid()
    assert Outline.of(grid, grid.prisms(), 0.0).holes == []
    wider = replace(volume, margin=0.01)
    assert Outline.of(wider, wider.prisms(), 0.0).holes == []


def test_rims_of_a_ring_are_two():
    triangles = ring().surface().triangles
    lengths = sorted(len(loop) for loop in rims(triangles))
    assert lengths == [32, 98]


def errors_at_the_hole(found, truth):
    """Strain errors within 6 mm of the edge over the r.m.s. of the strain there; shares covered."""
    group, face = found.strain(), found.prisms.surface + found.fit.face * np.eye(3)[2]
    true = truth.strain(face, FREQUENCY)
    near = np.linalg.norm(found.fit.outline.corners, axis=1) < 0.038
    error = (group["strain"].values[..., 0] - true)[near]
    bound = 1.96 * group["strain_std_by_part"].values[..., 0][:, near]
    assert bound.shape == (2, *error.shape)
    covered = (np.abs([error.real, error.imag]) <= bound).mean()
    return np.linalg.norm(error) / np.linalg.norm(true[near]), covered


def estimated(seed, truth):
    views = lab.views(truth, np.random.default_rng(seed), lab.FINE, frequency=(FREQUENCY,))
    return estimate_surface(views, lab.LASER, ring(), lab.Shell(), lab.SHEET, frequency=[FREQUENCY])


@pytest.mark.whole
def test_strain_at_the_edge_of_a_hole_is_not_smoothed(monkeypatch):
    truth = disc()
    error, covered = errors_at_the_hole(estimated(1, truth), truth)
    assert error < 0.25
    assert covered > 0.9
    monkeypatch.setattr(Outline, "holes", [])
    without, covered = errors_at_the_hole(estimated(1, truth), truth)
    assert without > 2 * error
    assert covered < 0.9


@pytest.mark.whole
def test_a_mesh_of_the_same_outline_serves_as_well(tmp_path):
    surface, truth = ring().surface(), disc()
    lines = [f"v {x} {y} {z}" for x, y, z in surface.position]
    lines += [f"f {a} {b} {c}" for a, b, c in surface.triangles + 1]
    path = tmp_path / "ring.obj"
    path.write_text("\n".join(lines))
    mesh = MeshFile(path=str(path), center=lab.CENTER.tolist(), tangent=[0.9, 0.4, 0.0], layers=2)
    views = lab.views(truth, np.random.default_rng(2), lab.FINE, frequency=(FREQUENCY,))
    found = estimate_surface(views, lab.LASER, mesh, lab.Shell(), lab.SHEET, frequency=[FREQUENCY])
    assert len(found.fit.outline.holes) == 1
    group, face = found.strain(), found.prisms.surface + found.fit.face * np.eye(3)[2]
    true = truth.strain(face, FREQUENCY, group["frame"].values)
    error = group["strain"].values[..., 0] - true
    bound = 1.96 * group["strain_std_by_part"].values[..., 0]
    assert np.linalg.norm(error) < 0.15 * np.linalg.norm(true)
    assert (np.abs([error.real, error.imag]) <= bound).mean() > 0.93
