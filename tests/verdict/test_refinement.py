"""Poses refined by the images: a turned view is turned back, and good poses are not spoiled."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.field import estimate_field
from sldvexp.field.bounds.pose_uncertainty import pose_covariance
from sldvexp.geometry import rotation_from_vector, vector_from_rotation
from sldvexp.reconstruction import Absolute
from sldvexp.verdict import examine_views
from sldvexp.verdict.beams import PixelBeams
from sldvexp.verdict.comparison import bench_of, compare_views
from sldvexp.verdict.refinement import RefinedPoses, refine

from .simulated_views import LASER, TIGHT, Session, groups, session, surface, velocity

TURN = 2.5e-3
ROTATION = (0, 1, 2)


def turned(seed: int, pixels: int, lines: int) -> tuple[Session, int]:
    """Turn one of five views across its beams; its origin is known to 0.05 mm."""
    rng = np.random.default_rng([seed, 5])
    wrong = int(rng.integers(5))
    mistakes = {wrong: "turned"}
    return session(
        rng, 5, TIGHT, pixels=pixels, frequencies=lines, mistakes=mistakes, size=TURN
    ), wrong


def errors(made: Session, moves: np.ndarray) -> np.ndarray:
    """Compare moved poses with the true ones: rotation vectors (rad) and displacements (m)."""
    back = [
        vector_from_rotation(rotation_from_vector(w) @ off.T)
        for w, off in zip(moves[:, :3], made.turned, strict=True)
    ]
    return np.hstack([back, moves[:, 3:] - made.truth[:, 3:]])


def hit_errors(made: Session, error: np.ndarray) -> np.ndarray:
    """Propagate errors of the poses to where beams hit, r.m.s. of every view, m."""
    found = []
    for view, off in zip(made.views, error, strict=True):
        beams = PixelBeams.trace(view, made.surface, np.flatnonzero(view.usable)[::7])
        found.append(np.sqrt(np.mean(np.sum((beams.point_by_pose @ off) ** 2, axis=1))))
    return np.array(found)


def field_error(made: Session, moves: np.ndarray) -> float:
    """Find the r.m.s. error of a field that is made with moved poses, m/s."""
    views = [view.moved(move) for view, move in zip(made.views, moves, strict=True)]
    found = estimate_field(views, LASER, surface(), Absolute()).velocity
    layers = found.reshape(-1, len(made.surface.nodes), *found.shape[1:])
    lines = range(found.shape[-1])
    truth = np.stack([velocity(made.surface.nodes, f) for f in lines], axis=-1)
    return float(np.sqrt(np.mean(np.abs(layers[len(layers) // 2] - truth) ** 2)))


class Refined:
    """Some sessions with a turned view, refined with its rotation free."""

    def __init__(self, seeds: range, pixels: int, lines: int) -> None:
        self.rejected, self.agrees, self.across, self.bound = [], [], [], []
        self.good_before, self.good_after, self.field = [], [], []
        for seed in seeds:
            made, wrong = turned(seed, pixels, lines)
            covariance = pose_covariance(made.views, None)
            bench = bench_of(made.views, made.surface, covariance)
            self.rejected.append(compare_views(bench, bench.fit()).rejects)
            found = refine(bench, made.views, covariance, {wrong: ROTATION})
            self.agrees.append(found.agrees)
            self._compare(made, wrong, found)

    def _compare(self, made: Session, wrong: int, found: RefinedPoses) -> None:
        """Compare with the truth, and with poses as good as those of views that nobody turned."""
        off = errors(made, found.moves)
        self.across.append(off[wrong, :2])
        own = 6 * wrong + np.arange(2)
        self.bound.append(np.sqrt(np.diag(found.covariance)[own]))
        good = np.arange(5) != wrong
        as_clean = np.zeros_like(found.moves)
        as_clean[wrong, :3] = vector_from_rotation(made.turned[wrong]) - made.truth[wrong, :3]
        self.good_before.append(hit_errors(made, errors(made, as_clean))[good])
        self.good_after.append(hit_errors(made, off)[good])
        self.field.append((field_error(made, found.moves), field_error(made, as_clean)))


def rms(values) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.mark.whole
def test_repaired_pose_is_refined_without_counting_the_images_twice():
    """Taken as a prior, the repaired pose would seem known to 0.7 of what it is known to."""
    made, wrong = turned(1, 21, 2)
    options = {"use_repair": [f"view_v{wrong + 1}.pose"]}
    tree = groups(made.views)
    repaired = examine_views(tree, LASER, surface(), **options)
    refined = examine_views(tree, LASER, surface(), refined=True, **options)
    assert [f.kind for f in refined.findings] == ["repaired", "poses_refined"]
    before, after = (
        np.sqrt(np.diag(found.groups["pose"]["covariance"].values[wrong]))[:2]
        for found in (repaired, refined)
    )
    assert np.all(after > 0.9 * before)
    assert refined.groups["pose"].attrs["repaired"] == options["use_repair"][0]


@pytest.mark.whole
def test_turned_view_is_turned_back_as_well_as_the_images_tell():
    """Of six numbers one is off by more than four bounds in 3,000 trials; a test refuses first."""
    found = Refined(range(3), 31, 3)
    assert all(found.rejected)
    assert all(found.agrees)
    assert np.abs(np.array(found.across) / found.bound).max() < 4.0
    assert rms(found.good_after) < 1.2 * rms(found.good_before)
    now, clean = np.transpose(found.field)
    assert rms(now) < 1.05 * rms(clean)


@pytest.mark.long
def test_turned_view_is_known_across_the_beam_to_a_tenth_of_a_milliradian():
    """Thirty sessions of 40 x 40 pixels and four lines; fewer tell less."""
    found = Refined(range(30), 40, 4)
    assert all(found.rejected)
    assert all(found.agrees)
    assert rms(found.across) <= 1e-4
    assert 0.75 < rms(np.array(found.across) / found.bound) < 1.25
    assert rms(found.good_after) <= rms(found.good_before)
    now, clean = np.transpose(found.field)
    assert rms(now) <= 1.05 * rms(clean)
