"""A session of the virtual lab recorded without noise, and repeated with noise in a second each.

What a session repeats without change is measured once: edges of the calibration object and lines of
the structure's pixels, without noise and with mirrors that point exactly. A repetition draws what
differs: noise of edges and pixels, pointing noise, machining errors of the object, poles within
their covariance. Its poses are adjusted anew to the edges, its modal images made anew of the lines.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import sldvexp
from sldvexp.config.composing import made_from
from sldvexp.dataset import RunData
from sldvexp.modes import ModalFit, ModalMethod, Responses, estimate_modes
from sldvexp.pose.from_scans import start_of
from sldvexp.pose.misfit import EdgeProblem
from sldvexp.targets import std_of_bound

EXPERIMENT = "experiment=plate_model"
#: Without noise, and with mirrors that stand where their calibration says.
QUIET = ("scene.noise=0", "scene.pointing=ideal", "scene.vibrometer.drop_out=0")
EXACT_OBJECT = "scene.machine_error=false"


@dataclass
class DrawnModes(ModalMethod):
    """Poles that are known to be off by no more than their covariance says."""

    fit: ModalFit | None = None
    lines = None
    left_out = ()

    def identify(self, responses):
        return self.fit


class RecordedSession:
    """Noise-free parts of a session, and how large its noise is.

    Parameters
    ----------
    settings : str
        Of the structure that is measured.
    """

    def __init__(self, folder: Path, *settings: str):
        whole = (EXPERIMENT, "report=none", *settings)
        quiet = self._run(folder / "quiet", *whole, *QUIET, EXACT_OBJECT)
        noisy = self._run(folder / "noisy", *whole)
        self.made = made_from([EXPERIMENT, *settings])
        self.laser = self.made.laser
        matched, lost = self.made.pose.images(self.made.target, self.laser, quiet, pinhole=True)
        assert not lost
        pointing = noisy["pose"]["pointing_std"].values
        self.pointing = dict(zip(noisy["pose"]["view"].values, pointing, strict=True))
        self.edges = []
        for own in matched:
            stated = np.median(noisy[f"edge/{own.view}"]["dac_std"].values)
            std = float(np.hypot(stated, self.pointing[own.view]))
            edges = {n: replace(e, std=np.full(len(e.std), std)) for n, e in own.edges.items()}
            self.edges.append(replace(own, edges=edges))
        self.starts = [start_of(own, self.laser, self.made.target) for own in self.edges]
        self.images = {own.view: quiet[f"image/{own.view}"] for own in self.edges}
        self.std = {view: noisy[f"image/{view}"]["velocity_std"].values for view in self.images}
        self.by_dac = {view: _by_dac(image) for view, image in self.images.items()}
        responses = Responses.from_images({v: noisy[f"image/{v}"] for v in self.images})
        fit = self.made.modal.identify(responses)
        true = quiet["modes"]
        natural, damping = true["natural_frequency"].values, true["damping_ratio"].values
        self.fit = replace(fit, pole=_poles(natural, damping))
        self.natural, self.damping = natural, damping

    @staticmethod
    def _run(folder: Path, *settings: str):
        tree = sldvexp.run(*settings, f"hydra.run.dir={folder}", quiet=True)
        return RunData.from_source(Path(tree.encoding["source"])).groups

    def repeated(self, seed: int):
        """Make the groups of a run that a model is tested on."""
        rng = np.random.default_rng(seed)
        images = {view: self._image(rng, view) for view in self.images}
        off = rng.multivariate_normal(np.zeros(len(self.fit.covariance)), self.fit.covariance)
        frequency, damping = off.reshape(2, -1)
        pole = _poles(self.natural * np.exp(frequency), self.damping * np.exp(damping))
        found = estimate_modes(images, DrawnModes(replace(self.fit, pole=pole)))
        return {"pose": self._poses(rng)} | found.groups()

    def _image(self, rng, view):
        """Add noise of the pixels and of the mirrors to a view's lines."""
        image, std = self.images[view], self.std[view]
        velocity = image["velocity"].values
        moved = self.pointing[view] * rng.normal(size=(2, len(velocity), 1))
        real, imaginary = std * rng.normal(size=(2, *velocity.shape))
        velocity = velocity + np.sum(moved * self.by_dac[view], axis=0) + real + 1j * imaginary
        return image.assign(
            velocity=(image["velocity"].dims, velocity), velocity_std=(image["velocity"].dims, std)
        )

    def _poses(self, rng):
        """Adjust poses to edges with noise, of an object that the target gives not exactly."""
        target = self.made.target
        std = std_of_bound(target.accuracy)
        circles = {
            number: replace(circle, x=circle.x + a, y=circle.y + b, diameter=circle.diameter + c)
            for number, circle in target.circles.items()
            for a, b, c in [std * rng.normal(size=3)]
        }
        images = [replace(own, edges=_with_noise(rng, own.edges)) for own in self.edges]
        known = replace(target, circles=circles)
        pose = self.made.pose
        problem = EdgeProblem(
            images, known, self.laser, pose.adjust, pose.shared, pose.max_iterations
        )
        found = problem.solve(self.starts)
        made = found.to_dataset(pose.confidence, [np.inf] * len(images))
        return made.assign(pointing_std=("view", [self.pointing[own.view] for own in images]))


def _with_noise(rng, edges):
    """Move edges along their scan lines, each by its standard error."""
    return {
        number: replace(
            edge,
            position=edge.position
            + (edge.std * rng.normal(size=len(edge.std)))[:, None] * edge.direction,
        )
        for number, edge in edges.items()
    }


def _poles(natural, damping):
    omega = 2 * np.pi * natural
    return omega * (-damping + 1j * np.sqrt(1 - damping**2))


def _by_dac(image):
    """Differentiate lines of a grid of pixels by the mirrors' steps, shape (2, pixel, line)."""
    shape = [int(n) for n in image.attrs["shape"]]
    velocity = image["velocity"].values.reshape(*shape, -1)
    step = np.stack(np.gradient(image["dac"].values.reshape(*shape, 2), axis=(0, 1)), axis=2)
    change = np.stack(np.gradient(velocity, axis=(0, 1)), axis=2)
    slope = np.linalg.solve(step.astype(complex), change)  # rows: rows of pixels, then columns
    return np.moveaxis(slope, 2, 0).reshape(2, len(image["pixel"]), -1)
