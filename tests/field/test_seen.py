"""What a view sees of points: where, from where, with which velocity, and why not."""

from __future__ import annotations

import os
import time
from dataclasses import replace

import numpy as np
import pytest

from sldvexp.errors import UserError
from sldvexp.field import View
from sldvexp.field.visibility.coverage import Coverage, require_coverage
from sldvexp.field.visibility.pose_slopes import PoseSlopes
from sldvexp.field.visibility.projection import (
    BEHIND,
    FACING_AWAY,
    FLAGGED,
    OFF_BOARD,
    OUTSIDE,
    Occlusion,
    project_samples,
)
from sldvexp.geometry import rotation_from_vector
from sldvexp.image import Interpolation
from sldvexp.laser import Mirror, TwoMirror, rays
from sldvexp.virtual_lab.beam import Spot, beams
from sldvexp.virtual_lab.modes import EdgeSupport, Mode
from sldvexp.virtual_lab.plate import Plate, VibratingPlate

FULL_SIZE = os.environ.get("SLDVEXP_BENCHMARK") == "1"
LASER = TwoMirror(
    mirror_offset=0.045,
    up_down=Mirror(25, 0.2, [0.3, -0.2]),
    left_right=Mirror(-24, -0.1, [-0.4, 0.1]),
)
REASONS = (BEHIND, OFF_BOARD, FACING_AWAY, OUTSIDE, FLAGGED)
UP = np.array([0.0, 0.0, 1.0])


def view(turn: tuple[float, float, float] = (0.3, 0.1, 0.2), n: int = 41, name: str = "1") -> View:
    """1.7 m before a world whose z axis points to the instrument; an image of 36 deg."""
    rotation = rotation_from_vector(turn) @ np.diag([1.0, -1.0, -1.0])
    axis = np.rint(np.linspace(-3000, 3000, n))
    dac = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    velocity = np.random.default_rng(1).normal(size=(n * n, 2, 2)) @ [1, 1j]
    origin = -rotation.T @ np.array([0.02, -0.03, 1.7])
    std = np.full(n * n, 1e-5)
    return View(name, rotation, origin, None, dac, velocity, std, np.zeros(n * n, int), (n, n))


def points(count: int = 300, half: float = 0.3, seed: int = 2) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-half, half, (count, 3)) * [1, 1, 0.1]


@pytest.mark.parametrize("method", [Interpolation.linear, Interpolation.cubic])
def test_weights_keep_their_order(method: Interpolation) -> None:
    """Scipy sorts a matrix in place, once it has to: then sums over it would be rounded anew."""
    weights = project_samples(view(), LASER, points(), None, method).weights
    before = weights.data.copy(), weights.indices.copy()
    assert abs(weights).nnz == weights.power(2).nnz
    np.testing.assert_array_equal(weights.data, before[0])
    np.testing.assert_array_equal(weights.indices, before[1])


def test_points_some_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Behind the instrument, off the board and beside the image, too."""
    at, p = view(), points(half=3.0) * [1, 1, 10]
    whole = project_samples(at, LASER, p, None, Interpolation.linear)
    assert all(whole.lost[why] for why in (BEHIND, OFF_BOARD, OUTSIDE))
    monkeypatch.setattr("sldvexp.field.visibility.projection.POINTS_AT_ONCE", 7)
    monkeypatch.setattr("sldvexp.image.interpolation.mesh.PLACES_AT_ONCE", 7)
    parts = project_samples(at, LASER, p, None, Interpolation.linear)
    assert parts.lost == whole.lost
    np.testing.assert_allclose(parts.dac, whole.dac, rtol=1e-12)
    np.testing.assert_allclose(parts.directions, whole.directions, atol=1e-15)
    np.testing.assert_allclose(parts.weights.toarray(), whole.weights.toarray(), atol=1e-10)


def test_beam_of_the_image_point_meets_the_point() -> None:
    at, p = view(), points()
    seen = project_samples(at, LASER, p, None, Interpolation.linear)
    start, direction = rays(LASER.angle_from_dac(seen.dac), LASER.mirror_offset)
    begin, along = at.origin + start @ at.rotation, direction @ at.rotation
    to_point = p - begin
    distance = np.linalg.norm(to_point, axis=1, keepdims=True)
    np.testing.assert_allclose(to_point / distance, along, atol=1e-10)
    np.testing.assert_allclose(seen.directions, -along, atol=1e-10)
    assert seen.valid.all()
    assert set(seen.lost) == set(REASONS)
    assert sum(seen.lost.values()) == 0


@pytest.mark.one_in(2)
@pytest.mark.parametrize("curved", [False, True])
def test_velocity_of_a_plate(curved: bool) -> None:
    """A velocity image's samples are the true velocities along D; the error falls with pixels."""
    modes = {"a": Mode(2, 1), "b": Mode(1, 2, frequency=300.0)}
    size, radius = [0.36, 0.36], 0.5 if curved else None
    plate = VibratingPlate.built(
        Plate(size=size, radius=radius, edges=EdgeSupport.free, modes=modes)
    )
    frequency = np.array([200.0, 300.0])
    place = np.random.default_rng(3).uniform(0.02, 0.34, (500, 2))
    p, normals = plate.position(place), plate.axes(plate.position(place))[:, 2]

    def errors(n: int) -> list[float]:
        at = view(n=n)
        shot = beams(LASER, at.dac, at.rotation, at.origin, Spot())
        distance, velocity = plate.seen(shot, frequency)
        on = np.isfinite(distance)
        at = replace(at, velocity=velocity, flags=~on)
        found = []
        for method in (Interpolation.linear, Interpolation.cubic):
            seen = project_samples(at, LASER, p, normals, method)
            assert seen.valid.mean() > 0.8
            truth = [
                np.einsum("si,si->s", plate.velocity(p, f), seen.directions) for f in frequency
            ]
            error = seen.velocity(at) - np.stack(truth, axis=1)
            found.append(float(np.abs(error[seen.valid]).max() / np.abs(truth).max()))
        return found

    (coarse_linear, coarse_cubic), (linear, cubic) = errors(121), errors(241)
    assert linear < 0.3 * coarse_linear
    assert cubic < 0.25 * coarse_cubic
    assert linear < 2e-3
    assert cubic < 3e-4


def test_standard_error_and_correlation() -> None:
    at, p, trials = view(), points(40, 0.1), 4000
    std = np.random.default_rng(4).uniform(1, 3, len(at.dac))
    at = replace(at, std=std)
    seen = project_samples(at, LASER, p, None, Interpolation.cubic)
    noise = seen.weights @ (std[:, None] * np.random.default_rng(5).normal(size=(len(std), trials)))
    ratio = noise.std(axis=1) / seen.std(at)
    assert np.abs(ratio - 1).max() < 4.5 / np.sqrt(2 * trials)
    covariance = (seen.weights * std**2) @ seen.weights.T
    size = np.outer(seen.std(at), seen.std(at))
    correlation = covariance.toarray() / size
    assert np.sum(np.abs(np.triu(correlation, 1)) > 0.05) > 20
    # A sample correlation errs by at most 1 / sqrt(trials); 780 pairs at 4.5 of that.
    error = noise @ noise.T / trials / size - correlation
    assert np.abs(np.triu(error, 1)).max() < 4.5 / np.sqrt(trials)
    by_frequency = replace(at, std=np.stack([std, 7 * std], axis=1))
    np.testing.assert_allclose(seen.std(by_frequency), 5 * seen.std(at))


@pytest.mark.parametrize("offset", [0.0, 0.045])
def test_pose_derivative(offset: float) -> None:
    laser, at, p = replace(LASER, mirror_offset=offset), view(), points(50)
    p[0] = [0.0, 0.0, 9.0]
    seen = project_samples(at, laser, p, None, Interpolation.linear)
    slopes = PoseSlopes.from_points(at, laser, p, seen.dac)
    dac, directions = (np.moveaxis(by, -1, 0) for by in (slopes.dac(), slopes.directions()))
    assert dac.shape == (50, 2, 6)
    assert directions.shape == (50, 3, 6)
    assert np.isnan(seen.dac[0]).all()
    assert not dac[0].any()
    h = 1e-5
    for k in range(6):
        step = h * np.eye(6)[k]
        moved = [
            project_samples(
                replace(
                    at,
                    rotation=rotation_from_vector(sign * step[:3]) @ at.rotation,
                    origin=at.origin + sign * step[3:],
                ),
                laser,
                p[1:],
                None,
                Interpolation.linear,
            )
            for sign in (1, -1)
        ]
        by_dac = (moved[0].dac - moved[1].dac) / (2 * h)
        by_direction = (moved[0].directions - moved[1].directions) / (2 * h)
        np.testing.assert_allclose(dac[1:, :, k], by_dac, atol=1e-5 * np.abs(by_dac).max())
        np.testing.assert_allclose(directions[1:, :, k], by_direction, atol=1e-8)


def test_change_by_the_pose_without_its_parts() -> None:
    """By `PoseSlopes.change` as by the derivatives of image points and directions."""
    rng, at, p = np.random.default_rng(4), view(), points(50)
    dac = project_samples(at, LASER, p, None, Interpolation.linear).dac
    slopes = PoseSlopes.from_points(at, LASER, p, dac)
    slope, velocity = rng.normal(size=(2, 3, 50)), rng.normal(size=(3, 3, 50))
    apart = np.einsum("ics,ijs->jcs", slope, slopes.dac())
    apart -= np.einsum("ics,ijs->jcs", velocity, slopes.directions())
    found = slopes.change(slope, velocity)
    np.testing.assert_allclose(found, apart, rtol=0, atol=1e-13 * np.abs(apart).max())


def test_every_reason() -> None:
    at, n = view((0.0, 0.0, 0.0)), 41
    flags = np.zeros((n, n), int)
    flags[30, 10] = 4
    flagged = LASER.angle_from_dac(at.dac.reshape(n, n, 2)[30, 10])
    beam = rays(flagged, LASER.mirror_offset)[1] @ at.rotation
    p = np.array(
        [
            [0.0, 0.0, 0.0],
            at.origin + UP,
            [1.0, 0.0, 0.0],
            [0.0, 0.1, 0.0],
            [0.0, 0.68, 0.0],
            at.origin + 1.7 * beam,
        ]
    )
    normals = np.tile(UP, (6, 1))
    normals[3] = [0.0, np.sin(1.4), np.cos(1.4)]
    at = replace(at, flags=flags.ravel())
    seen = project_samples(at, LASER, p, normals, Interpolation.linear)
    assert seen.valid.tolist() == [True] + [False] * 5
    assert seen.lost == dict.fromkeys(REASONS, 1)
    assert np.isnan(seen.dac).any(axis=1).tolist() == [False, True, True, False, False, False]
    assert np.diff(seen.weights.indptr).tolist() == [4, 0, 0, 0, 0, 0]
    slopes = seen.slopes(np.eye(len(at.dac)))
    assert np.count_nonzero(slopes[0], axis=1).tolist() == [4, 0, 0, 0, 0, 0]
    assert not seen.velocity(at)[1:].any()
    steep = project_samples(
        at, LASER, p[3:4], normals[3:4], Interpolation.linear, grazing=np.radians(88)
    )
    assert steep.valid.all()


@pytest.mark.parametrize("method", Interpolation)
def test_blocks_are_the_whole(method: Interpolation) -> None:
    at, p = view(), points(200, 0.8)
    normals = np.tile(UP, (200, 1))
    interpolator = method.prepare(at)
    whole = project_samples(at, LASER, p, normals, method)
    parts = [
        project_samples(at, LASER, p[k : k + 70], normals[k : k + 70], interpolator)
        for k in (0, 70, 140)
    ]
    assert 0 < whole.valid.sum() < 200
    np.testing.assert_array_equal(np.concatenate([s.valid for s in parts]), whole.valid)
    np.testing.assert_allclose(
        np.concatenate([s.velocity(at) for s in parts]), whole.velocity(at), atol=1e-12
    )
    total = sum((Coverage.from_view(at, s) for s in parts[1:]), Coverage.from_view(at, parts[0]))
    once = Coverage.from_view(at, whole)
    assert (total.samples, total.seen, total.lost) == (once.samples, once.seen, once.lost)
    assert total.where() == once.where()


def wave(n: int = 30) -> tuple[np.ndarray, np.ndarray]:
    """A corrugated sheet, 0.4 m wide and 30 mm high, as nodes and triangles."""
    axis = np.linspace(-0.2, 0.2, n)
    x, y = (a.ravel() for a in np.meshgrid(axis, axis, indexing="ij"))
    number = np.arange(n * n).reshape(n, n)
    a, b, c, d = (k.ravel() for k in (number[:-1, :-1], number[1:, :-1], number[1:, 1:],
                                      number[:-1, 1:]))  # fmt: skip
    triangles = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return np.column_stack([x, y, 0.03 * np.sin(60 * x)]), triangles


def hidden_by_any(at: View, p: np.ndarray, nodes: np.ndarray, triangles: np.ndarray,
                  clearance: float) -> np.ndarray:  # fmt: skip
    """Every beam against every triangle, by barycentric coordinates."""
    seen = project_samples(at, LASER, p, None, Interpolation.linear)
    start, _ = rays(LASER.angle_from_dac(seen.dac), LASER.mirror_offset)
    begin = at.origin + start @ at.rotation
    a, b, c = np.moveaxis(nodes[triangles], 1, 0)
    hidden = np.zeros(len(p), bool)
    for k, (o, end) in enumerate(zip(begin, p, strict=True)):
        m = np.stack([b - a, c - a, np.broadcast_to(o - end, a.shape)], axis=-1)
        u, v, s = np.linalg.solve(m, (o - a)[..., None])[..., 0].T
        met = (u >= 0) & (v >= 0) & (u + v <= 1) & (s > 0)
        hidden[k] = (met & ((1 - s) * np.linalg.norm(end - o) > clearance)).any()
    return hidden


@pytest.mark.one_in(3)
@pytest.mark.parametrize("turn", [(0.0, 1.0, 0.0), (0.4, -0.9, 0.3), (0.0, 0.0, 0.0)])
def test_occlusion_against_every_triangle(
    turn: tuple[float, float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    at, (nodes, triangles) = view(turn), wave()
    rng = np.random.default_rng(6)
    share = rng.dirichlet(np.ones(3), 400)
    p = np.einsum("sc,sci->si", share, nodes[rng.choice(triangles, 400)])
    p += rng.uniform(-0.002, 0.002, (400, 1)) * UP
    monkeypatch.setattr("sldvexp.field.visibility.projection.BLOCK", 150)
    occlusion = Occlusion.prepare(at, LASER, nodes, triangles, clearance=0.01)
    hidden = hidden_by_any(at, p, nodes, triangles, 0.01)
    np.testing.assert_array_equal(occlusion.hides(p), hidden)
    assert hidden.any() == any(turn)
    seen = project_samples(at, LASER, p, None, Interpolation.linear, occlusion=occlusion)
    assert seen.lost[FACING_AWAY] == hidden.sum()
    np.testing.assert_array_equal(seen.valid, ~hidden)


def test_occlusion_by_one_large_triangle() -> None:
    """Straight edges are bent in the image by the mirror offset; none is cut off."""
    at = view((0.0, 0.0, 0.0))
    nodes = np.array([[-0.6, -0.6, 0.3], [0.6, -0.6, 0.3], [0.0, 0.6, 0.3]])
    p = points(2000, 0.65)
    occlusion = Occlusion.prepare(at, LASER, nodes, np.array([[0, 1, 2]]), 0.01)
    inside = np.isfinite(project_samples(at, LASER, p, None, Interpolation.linear).dac).all(axis=1)
    expected = hidden_by_any(at, p[inside], nodes, np.array([[0, 1, 2]]), 0.01)
    np.testing.assert_array_equal(occlusion.hides(p[inside]), expected)
    assert 0.2 < expected.mean() < 0.8


def test_surface_behind_the_instrument() -> None:
    at, (nodes, triangles) = view((0.0, 0.0, 0.0)), wave(3)
    with pytest.raises(UserError, match="view 1: the whole surface is behind the instrument"):
        Occlusion.prepare(at, LASER, nodes + 3 * UP, triangles, 0.01)


def test_summary() -> None:
    at = view((0.0, 0.0, 0.0))
    p = np.array([[0.0, 0, 0], [0, 0.1, 0], [0, 0.68, 0], [0, 0.69, 0], [1, 0, 0]])
    coverage = Coverage.from_view(at, project_samples(at, LASER, p, None, Interpolation.linear))
    assert coverage.summary() == (
        "view 1: sees 2 of 5 samples (outside the image 2, off the board 1)"
    )
    require_coverage([coverage])
    everything = Coverage.from_view(
        at, project_samples(at, LASER, p[:2], None, Interpolation.linear)
    )
    assert everything.summary() == "view 1: sees 2 of 2 samples"


def test_volume_that_is_nowhere() -> None:
    views = [view((0.0, 0.0, 0.0), name=n) for n in "ab"]

    def coverage(at: View, p: np.ndarray, normals: np.ndarray | None = None) -> Coverage:
        return Coverage.from_view(at, project_samples(at, LASER, p, normals, Interpolation.linear))

    beside = np.array([[0.0, 0.68, 0.0], [0.1, 0.68, 0.0]])
    with pytest.raises(
        UserError,
        match=r"the volume is seen by none of the views; view a: 2 of 2 samples are outside the "
        r"image, its image has up_down -3000 to 3000 and left_right -3000 to 3000 and the samples "
        r"are at up_down -3[0-9]{3} to",
    ):
        require_coverage([coverage(v, beside) for v in views])
    middle = np.zeros((1, 3))
    with pytest.raises(UserError, match="view b: none of the samples is seen; view b: 2 of 2"):
        require_coverage([coverage(views[0], middle), coverage(views[1], beside)])
    away = (views[0].origin + UP)[None]
    with pytest.raises(UserError, match="behind the instrument, no sample has an image point; is"):
        require_coverage([coverage(views[0], away)])
    with pytest.raises(UserError, match=r"facing away.*do the surface's normals point"):
        require_coverage([coverage(views[0], middle, -UP[None])])


def test_speed() -> None:
    """Five views of 185,000 samples."""
    samples = 185_000 if FULL_SIZE else 2000
    p, normals = points(samples), np.tile(UP, (samples, 1))
    views = [view((0.05 * k, 0.1 - 0.05 * k, 0.0), n=100) for k in range(5)]
    times = []
    for _ in range(5 if FULL_SIZE else 1):
        start = time.perf_counter()
        seen = [project_samples(v, LASER, p, normals, Interpolation.linear) for v in views]
        times.append(time.perf_counter() - start)
    seconds = min(times)
    print(f"{samples} samples in 5 views: {seconds:.2f} s")
    assert all(s.valid.mean() > 0.9 for s in seen)
    if FULL_SIZE:
        assert seconds < 1.5
