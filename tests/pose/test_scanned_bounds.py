"""Poses from whole virtual scans scatter as their bounds say, machining errors included."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
from hydra import compose, initialize_config_dir

from sldvexp.config import hydra_plugin, schema
from sldvexp.config.paths import conf_dir
from sldvexp.geometry import vector_from_rotation
from sldvexp.pose import half_width
from sldvexp.pose.bitangent import Bitangent
from sldvexp.pose.edge import Edge
from sldvexp.session import Camera
from sldvexp.session.circles import edges_to_dataset, scan_circles
from sldvexp.virtual_lab import VirtualLab

SMALL = ["scan.sampling.samples=64", "scan.coarse.pixels=180"]
METHODS = [Bitangent(), Bitangent(pinhole=False), Edge()]


class NoJournal:
    """Measures every line and keeps none."""

    folder = Path()

    def line(self, name, dac, acquisition, measure):
        return measure()


class Scans:
    """Edges of the same view in so many labs, each with its own object and noise."""

    def __init__(self, count, overrides=()):
        hydra_plugin.install()
        with initialize_config_dir(str(conf_dir()), version_base="1.3"):
            ideal = ["experiment=dissertation/automated_pose", "scene.pointing=ideal"]
            self.experiment = schema.build(compose("config", overrides=[*ideal, *overrides]))
        self.groups = [self._scan(seed) for seed in range(count)]

    def _scan(self, seed):
        e = self.experiment
        with VirtualLab(e.scene, e.laser, e.target, seed) as lab:
            self.truth = lab.true_pose("1")
            with Camera(lambda: nullcontext(lab), e.signal, NoJournal()) as camera:
                camera.sample(e.scan.sampling)
                return edges_to_dataset(scan_circles(camera, e.scan, e.scan.centres("1"), e.laser))

    def poses(self, method):
        """Errors (scan, 6) of the pose, their standard errors, whether covered; notes."""
        rotation, origin = self.truth
        errors, std, covered, notes = [], [], [], []
        for group in self.groups:
            e = self.experiment
            pose = method.estimate(e.laser, e.target, {"edge/1": group}).pose.isel(view=0)
            turned = vector_from_rotation(pose["rotation"].values @ rotation.T)
            errors.append(np.hstack([turned, pose["origin"].values - origin]))
            std.append(np.sqrt(np.diag(pose["covariance"].values)))
            width = half_width(std[-1], pose["dof"].values, 0.95)
            covered.append(np.abs(errors[-1]) <= width)
            notes.append(pose.attrs["notes"])
        return np.array(errors), np.array(std), np.array(covered), notes


def check(scans, method):
    """Spread, bias and coverage, each within four standard errors of what it should be."""
    errors, std, covered, notes = scans.poses(method)
    count, scatter = len(errors), errors.std(axis=0, ddof=1)
    bias = np.abs(errors.mean(axis=0)) / scatter
    noted = ["bounds are too small" in n for n in notes]
    if isinstance(method, Bitangent) and not method.pinhole:
        # In DAC steps the image of a circle is no conic: that bias is not in the bounds, and noted.
        assert bias.max() > 2
        assert all(noted)
        return
    assert not any(noted)
    ratio = scatter / np.sqrt(np.mean(std**2, axis=0))
    np.testing.assert_allclose(ratio, 1.0, atol=4 / np.sqrt(2 * count))
    assert (bias < 4 / np.sqrt(count)).all()
    limit = 4 * np.sqrt(0.95 * 0.05 / count)
    np.testing.assert_allclose(covered.mean(axis=0), 0.95, atol=limit)


@pytest.fixture(scope="module")
def few():
    return Scans(24, SMALL)


@pytest.fixture(scope="module")
def many():
    return Scans(100)


@pytest.mark.long
@pytest.mark.parametrize("method", METHODS, ids=str)
def test_spread_is_as_reported(few, method):
    check(few, method)


@pytest.mark.long
@pytest.mark.parametrize("method", METHODS, ids=str)
def test_spread_is_as_reported_in_many_full_scans(many, method):
    check(many, method)


def test_edges_are_freed_from_the_spot():
    """A finite spot sees every edge 1 um inside of its circle, more where it falls at a slant."""
    scans = Scans(1, [*SMALL, "scene.vibrometer.noise=1e-4", "scene.machine_error=false"])
    e, tree = scans.experiment, {"edge/1": scans.groups[0]}
    pose = Edge().estimate(e.laser, e.target, tree).pose
    assert abs(float(pose["rim"][0])) < 1.5e-7
