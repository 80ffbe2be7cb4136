"""Pixels whose beams meet the calibration object before the surface."""

from __future__ import annotations

import numpy as np

from sldvexp import dataset, volume
from sldvexp.dataset import Severity
from sldvexp.field import View
from sldvexp.laser import TwoMirror
from sldvexp.pose.base import pose_to_dataset
from sldvexp.targets import Circle, Circles, Plane
from sldvexp.verdict.beams import MeasuredSurface, PixelBeams, on_circles
from sldvexp.verdict.views import examine_views

FLIP = np.diag([1.0, -1.0, -1.0])
LASER, GRID = TwoMirror(), volume.Grid(size=[0.2, 0.2], shape=[5, 5])


def object_before(forward):
    """Three circles so far before the plate's plane, one of them before the plate."""
    circles = {1: Circle(0.03, 0.02, 0.02), 2: Circle(0.22, 0.0, 0.03), 3: Circle(0.4, 0.2, 0.03)}
    plane = Plane([0.0, 0.0, forward], [0.0, 0.0, 1.0])
    return Circles(circles=circles, planes={"front": plane})


def images(rng):
    """Four views of a plate that bends a little, and what is on the circle rests."""
    step = np.radians(np.linspace(-24, 24, 25))
    angle = np.stack(np.meshgrid(step, step), axis=-1).reshape(-1, 2)
    dac = LASER.dac_from_angle(angle).round()
    surface = MeasuredSurface.of(GRID, LASER)
    origins = np.array([[-0.4, -0.3, 1.5], [0.4, -0.3, 1.5], [0, 0.4, 1.5], [0, 0, 1.5]]) / 3
    names, covariance = list("abcd"), np.diag([1e-4] * 6) ** 2
    groups = {
        "pose": pose_to_dataset(names, [FLIP] * 4, origins, [covariance] * 4, [np.inf] * 4, 0.95)
    }
    met = {}
    for name, origin in zip(names, origins, strict=True):
        view = View.from_arrays(name, FLIP, origin, np.zeros(625), 1e-6, dac=dac)
        beams = PixelBeams.trace(view, surface, np.arange(625))
        x, y, _ = beams.point.T
        seen = np.zeros((625, 1), complex)
        seen[beams.pixel, 0] = 1e-3 * np.cos(8 * x) * np.cos(7 * y) * beams.direction[:, 2]
        on_any, inside = on_circles(view, surface, object_before(0.1)), _inside(beams)
        assert (on_any & ~inside).any() == (name == "b")  # of the circle beside the plate
        met[name] = on_any & inside
        seen[on_any] = 0
        seen += 1e-5 * (rng.normal(size=seen.shape) + 1j * rng.normal(size=seen.shape))
        groups[f"image/{name}"] = dataset.group(
            "image",
            {"frequency": [200.0]},
            velocity=seen,
            dac=dac,
            velocity_std=np.full(seen.shape, 1e-5),
            flags=np.zeros(625, np.uint8),
        )
        assert not on_circles(view, surface, object_before(-0.1)).any(where=inside)
    return groups, met


def _inside(beams):
    """Pixels that meet the plate, which hides what is behind it."""
    return np.isin(np.arange(625), beams.pixel)


def test_pixels_on_the_calibration_object_are_left_out_as_such():
    groups, met = images(np.random.default_rng(1))
    assert {name: one.sum() for name, one in met.items()} == {"a": 1, "b": 1, "c": 1, "d": 2}
    found = examine_views(groups, LASER, GRID, target=object_before(0.1))
    told = {f.views[0]: f for f in found.findings if f.kind == "on_object"}
    assert told.keys() == set("abcd")
    for name, finding in told.items():
        assert finding.severity is Severity.note
        one = met[name].sum() == 1
        count, beams = ("one pixel", "beam meets") if one else ("2 pixels", "beams meet")
        assert finding.text.startswith(f"{count} of view {name} ")
        assert finding.text.endswith(f"left out, whose {beams} the calibration object")
        left_out = found.groups[f"image/{name}"]["flags"].values != 0
        np.testing.assert_array_equal(left_out, met[name])
    assert not [f for f in found.findings if f.kind == "drop_outs"]
    without = examine_views(groups, LASER, GRID)
    assert not [f for f in without.findings if f.kind == "on_object"]
