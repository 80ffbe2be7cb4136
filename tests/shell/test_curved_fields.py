"""A cap of a sphere that moves as a thin shell does, from simulated views of it and a mesh."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp import dataset
from sldvexp.field import View
from sldvexp.geometry import rotation_from_euler
from sldvexp.laser import project, rays
from sldvexp.pose import pose_to_dataset
from sldvexp.shell import HeightChart, Shell, Spline, SurfaceField, estimate_surface
from sldvexp.volume import MeshFile
from tests.shell import simulated_shell as lab
from tests.shell.simulated_surface import RADIUS, mesh, sphere

OMEGA = 2 * np.pi * lab.FREQUENCY
#: Of the sphere; the cap's top is where the plate's middle is.
MIDDLE = lab.CENTER - [0, 0, RADIUS]


def normal_motion(points):
    """Velocity along the normal, m/s, of the place below or above."""
    out = points - MIDDLE
    x, y, _ = RADIUS * out.T / np.linalg.norm(out, axis=1)
    return 0.02 * np.cos(9 * x + 0.3) * np.cos(11 * y) + 0.006j * np.sin(8 * x - 9 * y)


def motion(points):
    """Velocity of points, m/s, of a shell whose normals stay straight and normal."""
    out = points - MIDDLE
    distance = np.linalg.norm(out, axis=1)[:, None]
    normal, height = out / distance, distance - RADIUS
    own = MIDDLE + RADIUS * normal
    x, y, _ = (own - MIDDLE).T
    along = np.column_stack([0.002 * np.sin(7 * x), 0.0015j * np.cos(6 * y - 2 * x), 0 * x])
    along = along - normal * np.einsum("pi,pi->p", along, normal)[:, None]
    step = 1e-5 * np.eye(3)
    slope = [(normal_motion(own + d) - normal_motion(own - d)) / 2e-5 for d in step]
    moved = (1 + height / RADIUS) * along - height * np.stack(slope, axis=1)
    return moved + normal_motion(own)[:, None] * normal


def strain(points, frames):
    """Strain along the first two local axes, by differences in space, (point, 3)."""
    step = 1e-5 * np.eye(3)
    by = np.stack([(motion(points + d) - motion(points - d)) / 2e-5 for d in step], axis=2)
    local = np.einsum("pix,pxy,pjy->pij", frames[:, :2], by, frames[:, :2]) / (1j * OMEGA)
    shear = (local[:, 0, 1] + local[:, 1, 0]) / 2
    return np.stack([local[:, 0, 0], local[:, 1, 1], shear], axis=1)


def views(rng, pixels=(17, 19), noise=lab.NOISE):
    """Images of the face, half a thickness above the sphere."""
    s, t = (np.linspace(-b, b, n) for b, n in zip((0.13, 0.105), pixels, strict=True))
    x, y = (a.ravel() for a in np.meshgrid(s, t, indexing="ij"))
    top = np.column_stack([x, y, sphere(x, y) + RADIUS])
    spots = MIDDLE + top * (1 + lab.SHEET.thickness / 2 / RADIUS)
    made = []
    for k, (euler, origin) in enumerate(lab.PLACES):
        rotation = rotation_from_euler(euler)
        angle = project((spots - origin) @ rotation.T, lab.LASER.mirror_offset)
        _, along = rays(angle, lab.LASER.mirror_offset)
        velocity = np.einsum("pi,pi->p", motion(spots), -along @ rotation)
        velocity = velocity + noise * (rng.normal(size=(len(spots), 2)) @ [1, 1j])
        made.append(
            View.from_arrays(
                str(k), rotation, origin, velocity, noise, angle=angle, laser=lab.LASER
            )
        )
    return made


@pytest.fixture(scope="module")
def cap(tmp_path_factory):
    """Volume of a mesh of the middle surface, read from a file."""
    prisms = mesh(sphere, shape=(27, 23), center=lab.CENTER)
    path = tmp_path_factory.mktemp("mesh") / "cap.obj"
    lines = [f"v {x:.9f} {y:.9f} {z:.9f}" for x, y, z in prisms.surface]
    lines += ["f {} {} {}".format(*(corners + 1)) for corners in prisms.triangles]
    path.write_text("\n".join(lines) + "\n")
    return MeshFile(path=str(path), layers=2, thickness=0.01)


def estimated(seen, volume, method=None) -> SurfaceField:
    method = method or Shell()
    return estimate_surface(seen, lab.LASER, volume, method, lab.SHEET, frequency=[lab.FREQUENCY])


def compared(found):
    """Relative errors of motion and strain of the face, and the share of intervals that hold.

    Shears of a cap are small: strains' errors are relative to all of them.
    """
    fit, chart = found.fit, found.fit.outline.chart
    place = fit.outline.corners
    inside = (np.abs(place) < 0.95 * fit.outline.high).all(axis=1)
    points, frames = chart.points(place, fit.face), chart.frames(place)
    true = np.einsum("pij,pj->pi", frames, motion(points))
    errors, held = [], []
    for i, rows in enumerate(fit.shell.velocity(place, fit.face)):
        value, own, others = fit.evaluate(rows)
        error, std = value[:, 0] - true[:, i], np.sqrt(own + others)[..., 0]
        errors.append(np.linalg.norm(error[inside]) / np.linalg.norm(true[inside, i]))
        held += [np.abs(error.real) <= 1.96 * std[0], np.abs(error.imag) <= 1.96 * std[1]]
    group, wanted = found.strain(), strain(points, frames)
    for i in range(3):
        error = group["strain"].values[:, i, 0] - wanted[:, i]
        std = group["strain_std_by_part"].values[:, :, i, 0]
        errors.append(np.linalg.norm(error[inside]) / np.linalg.norm(wanted[inside]))
        held += [np.abs(error.real) <= 1.96 * std[0], np.abs(error.imag) <= 1.96 * std[1]]
    return np.array(errors), np.mean(held, axis=1)


@pytest.mark.whole
def test_without_noise_the_motion_is_exact(cap):
    found = estimated(views(np.random.default_rng(1), noise=1e-9), cap)
    assert isinstance(found.fit.outline.chart, HeightChart)
    errors, _ = compared(found)
    assert np.all(errors[:3] < 1e-3)
    assert np.all(errors[3:] < 1e-3)


def test_motion_and_strain_of_a_cap(cap):
    errors, held = compared(estimated(views(np.random.default_rng(2)), cap))
    assert np.all(errors[:2] < 0.05)
    assert errors[2] < 0.002
    assert np.all(errors[3:] < 0.05)
    assert held.mean() > 0.9


@pytest.mark.whole
def test_free_splines_follow_a_cap_too(cap):
    errors, held = compared(estimated(views(np.random.default_rng(3)), cap, Spline()))
    assert np.all(errors[:2] < 0.25)
    assert errors[2] < 0.003
    assert held.mean() > 0.9


@pytest.mark.whole
def test_a_cap_taken_for_flat_is_wrong(cap):
    """Its normal motion strains the surface by curvature: what a plane would leave out."""
    found = estimated(views(np.random.default_rng(2)), cap)
    curvature = found.fit.outline.chart.forms(found.fit.outline.corners).curvature
    bent = np.abs(normal_motion(found.prisms.surface)).max() / RADIUS / OMEGA
    assert curvature[:, 0, 0] == pytest.approx(1 / RADIUS, rel=1e-2)
    assert bent > 0.2 * np.abs(found.strain()["strain"].values).max()


@pytest.mark.whole
def test_the_field_at_all_nodes_is_in_the_world(cap):
    found = estimated(views(np.random.default_rng(4)), cap)
    group = found.field()
    true = motion(found.prisms.position)
    error = np.linalg.norm(group["velocity"].values[..., 0] - true, axis=0)
    assert np.all(error < 0.15 * np.linalg.norm(true, axis=0))
    assert error[2] < 0.01 * np.linalg.norm(true[:, 2])


@pytest.mark.long
def test_a_cap_from_files_through_the_command(sldvexp, cap, tmp_path):
    """Images and poses from a file, the surface from a mesh; a fold of it is told in a sentence."""
    seen, path = views(np.random.default_rng(5), pixels=(13, 13)), tmp_path / "images.nc"
    names = [v.name for v in seen]
    poses = pose_to_dataset(
        names,
        [v.rotation for v in seen],
        np.array([v.origin for v in seen]),
        np.broadcast_to(np.diag([2e-5] * 3 + [5e-5] * 3) ** 2, (len(seen), 6, 6)),
        np.full(len(seen), 100.0),
        0.95,
    )
    images = {
        f"image/{v.name}": dataset.group(
            "image",
            {"frequency": [lab.FREQUENCY]},
            dac=v.dac,
            velocity=v.velocity,
            velocity_std=np.broadcast_to(v.std[:, None], v.velocity.shape),
            flags=v.flags.astype(np.int8),
        )
        for v in seen
    }
    dataset.save({"pose": poses, **images}, {}, path)
    called = [
        "~experiment",
        "instrument=images",
        f"instrument.path={path}",
        "pose=given",
        f"pose.path={path}",
        f"laser.mirror_offset={lab.LASER.mirror_offset}",
        "volume=mesh",
        "volume.layers=2",
        "volume.thickness=0.01",
        "reconstruction=shell",
        "material=aluminium",
        "material.thickness=0.003",
        "report=none",
    ]
    run = sldvexp(*called, f"volume.path={cap.path}")
    assert run.status == 0, run.err
    strain_found = run.tree["strain"]["strain"].values[..., 0]
    direct = estimated(seen, cap).strain()["strain"].values[..., 0]
    assert np.linalg.norm(strain_found - direct) < 0.05 * np.linalg.norm(direct)
    corners = mesh(lambda x, y: 0.5 * np.abs(x), shape=(9, 9), center=lab.CENTER)
    edged = tmp_path / "edge.obj"
    lines = ["v {:.9f} {:.9f} {:.9f}".format(*p) for p in corners.surface]
    lines += ["f {} {} {}".format(*(c + 1)) for c in corners.triangles]
    edged.write_text("\n".join(lines) + "\n")
    told = sldvexp(*called, f"volume.path={edged}")
    assert told.status == 1
    assert "reconstruction: reconstruction=shell and spline need a smooth surface" in told.err
