"""Pixels at rest are told by all lines, also where a streamed run keeps few of their sums."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from sldvexp import dataset
from sldvexp.field import View
from sldvexp.field.equations.assembly import pixel_data
from sldvexp.field.streaming import compress, tell_rest
from sldvexp.field.streaming.compression import FrequencyModes
from sldvexp.field.streaming.dask import Work
from sldvexp.field.visibility.background import beside, without_background
from sldvexp.field.visibility.view import views_of
from sldvexp.importers.image_file import in_chunks
from sldvexp.laser import TwoMirror
from sldvexp.pose import pose_to_dataset
from sldvexp.signal import Flag
from sldvexp.volume import Grid

LINES, PIXELS, STD = 36, 18, 1e-6
VOLUME = Grid(size=[0.3, 0.3], shape=[9, 9], layers=2, thickness=0.01)


def with_lines(view: View, rng: np.random.Generator, by_line: bool) -> View:
    """Give a view two shapes of a plate that ends in the image, in many lines; beside it is noise.

    Along one border the plate ends a single line of pixels before the image does. Some pixels rest
    nearly, so that few of their lines stand out.
    """
    i, j = np.divmod(np.arange(PIXELS**2), PIXELS)
    on_it = (i >= 1) & (i < PIXELS - 3) & (j >= 3) & (j < PIXELS - 1)
    shape = np.stack([1 + 0.02 * i, np.cos(0.1 * j)], axis=1) * on_it[:, None]
    response = rng.normal(size=(2, LINES, 2)) @ [1e-3, 1e-3j]
    std = STD * np.exp(0.3 * rng.normal(size=(PIXELS**2, LINES))) if by_line else STD
    std = std if by_line else np.full(PIXELS**2, STD)
    noise = rng.normal(size=(PIXELS**2, LINES, 2)) @ [1, 1j] * (std if by_line else STD)
    # Around the limit of rest, by noise that no combination of lines has.
    noise[~on_it] *= rng.uniform(0.9, 1.5, (~on_it).sum())[:, None]
    flags = np.where(rng.uniform(size=PIXELS**2) < 0.02, 4, 0)
    velocity = np.where(flags[:, None] > 0, np.nan, shape @ response + noise)
    return replace(view, velocity=velocity, std=std, flags=flags)


def data_of(views: list[View]) -> tuple[list[np.ndarray], np.ndarray]:
    """Give the columns that modes are found of, and the expected squares of their noise."""
    std = [np.broadcast_to(v.std.reshape(len(v.std), -1), v.velocity.shape) for v in views]
    noise = sum(np.sum(s[v.usable] ** 2, axis=0) for s, v in zip(std, views, strict=True))
    return pixel_data(views), np.repeat(noise, 2)


@pytest.mark.one_in(2)
@pytest.mark.parametrize("by_line", [False, True])
def test_rest_is_told_by_all_lines(
    make_views: Callable[..., list[View]], laser: TwoMirror, by_line: bool
) -> None:
    pytest.importorskip("dask.array")
    rng = np.random.default_rng(4)
    views = [with_lines(v, rng, by_line) for v in make_views(3, PIXELS, LINES, covariance=None)]
    poses = [(v.name, v.rotation, v.origin, 1e-8 * np.eye(6)) for v in views]
    tree = {"pose": pose_to_dataset(*map(list, zip(*poses, strict=True)), [np.inf] * 3, 0.95)}
    for view in views:
        tree[f"image/{view.name}"] = dataset.group(
            "image",
            {"pixel": np.arange(PIXELS**2), "frequency": 100.0 + np.arange(LINES)},
            velocity=view.velocity,
            velocity_std=view.std if by_line else np.repeat(view.std[:, None], LINES, axis=1),
            dac=view.dac,
            flags=np.asarray(view.flags, np.uint8),
        ).assign_attrs(shape=list(view.shape or ()))
    chunks = {"pixel": 50, "frequency": 7}
    streamed = {k: in_chunks(v, chunks) if k != "pose" else v for k, v in tree.items()}
    work = Work(at_once=1)
    told = tell_rest(streamed, laser, VOLUME, work)
    small = compress(told, work)
    assert small.images["image/1"].sizes["frequency"] < LINES / 4
    prisms, found = VOLUME.prisms(), []
    modes = FrequencyModes.from_data(*data_of(without_background(views, laser, prisms)))
    np.testing.assert_allclose(np.abs(modes.combination), np.abs(small.modes.combination), 1e-6)
    for whole, few in zip(views, views_of(told | small.images, laser), strict=True):
        found.append(beside(whole, laser, prisms))
        rests = np.asarray(few.flags) & int(Flag.resting) > 0
        np.testing.assert_array_equal(rests, found[-1])
        assert not beside(few, laser, prisms).any()  # nothing more is found of few lines
        left = replace(few, rest=None, flags=whole.flags)
        assert (beside(left, laser, prisms) != found[-1]).any()  # as they would do
    border = np.reshape(found[0], (PIXELS, PIXELS))[0]
    assert border.sum() > PIXELS / 4  # a single line, since the image breaks off there
