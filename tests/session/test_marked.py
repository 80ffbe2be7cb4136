"""Circles that somebody marked get coarse lines by the size that their marks tell."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from sldvexp.errors import UserError
from sldvexp.image import fit_circle
from sldvexp.instrument import Replay
from sldvexp.instrument.recording import JOURNAL, line_name, read_line
from sldvexp.laser import dac_of_points
from sldvexp.pose.aiming import aiming_at_marks
from sldvexp.scan.calibration import Centres
from sldvexp.session.circles import edges_of
from sldvexp.session.session import scan_views
from tests.session.test_search import before

pytestmark = pytest.mark.usefixtures("client_clock")

#: Circles of 30 mm, and a stand before them.
CIRCLES = {1: (0, 0), 2: (0.2, 0.02), 3: (0.18, 0.2), 4: (0.02, 0.19)}
NEAR = [0.3, 0.1, 1.2]
#: By how many steps marks are beside the middles.
BESIDE = np.array([[30, -40], [-25, 15], [40, 30], [-20, -35]])


def marked(composed, numbers=(1, 2, 3, 4), *more):
    """A view before circles on a 16-bit board, each of which is marked."""
    more = "laser.board=bits_16", "scan.calibration.fine.lines=20", "scene.spot.waist=1e-3", *more
    e = before(composed, CIRCLES, 0.03, [NEAR, NEAR], *more)
    steps = np.array([rim.mean(axis=0) for rim in rims(e)])
    dac = (np.rint(steps).astype(int) + BESIDE).tolist()
    views = {"a": Centres(dac, circles=list(numbers))}
    calibration = replace(e.scan.calibration, views=views)
    return replace(e, scan=replace(e.scan, poses={}, calibration=calibration))


def rims(e):
    pose = e.scene.views["a"]
    for outline in e.target.outlines():
        names = ["rim"] * len(outline)
        yield dac_of_points(outline, pose.rotation, pose.place, e.laser, names)


def scanned(e, folder):
    return scan_views(e, folder, guide=partial(aiming_at_marks, e.laser, None))


def stride_of(folder) -> int:
    dac, *_ = read_line(folder / "a" / f"{line_name('1_coarse', 0)}.npz")
    return int(np.abs(np.diff(dac, axis=0)).max())


@pytest.mark.whole
def test_lines_across_marked_circles_reach_beyond_them(composed, tmp_path):
    e = marked(composed)
    edges = edges_of(scanned(e, tmp_path / JOURNAL)["edge/a"])
    for steps, found in zip(rims(e), edges, strict=True):
        assert len(found.std) == 20
        off_by = fit_circle(found)[0].ellipse.centre - steps.mean(axis=0)
        assert np.abs(off_by).max() < 0.02 * np.ptp(steps, axis=0).max()
    assert stride_of(tmp_path / JOURNAL) > 8
    replayed = scanned(replace(e, instrument=Replay(str(tmp_path)), scene=None), tmp_path / "again")
    np.testing.assert_array_equal(replayed["edge/a"]["dac"], np.vstack([c.position for c in edges]))


@pytest.mark.whole
def test_lines_that_a_run_has_kept_from_before_stay(composed, tmp_path):
    e = marked(composed, (1, 2, 3, 4), "scan.calibration.coarse.pixels=301")
    whole = scan_views(e, tmp_path / JOURNAL)  # which nobody tells where the instrument stands
    assert stride_of(tmp_path / JOURNAL) == 8
    for path in sorted((tmp_path / JOURNAL).rglob("*coarse*.npz"))[::2]:
        path.unlink()
    for folder, instrument in (JOURNAL, e.instrument), ("again", Replay(str(tmp_path))):
        scene = e.scene if folder == JOURNAL else None
        again = scanned(replace(e, instrument=instrument, scene=scene), tmp_path / folder)
        np.testing.assert_array_equal(again["edge/a"]["dac"], whole["edge/a"]["dac"])


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("numbers", "told"),
    [
        ((1, 3, 2, 4), r"everything on its lines moves, .* a larger stride than 8, "
         r"coarse\.stride=16, below scan, "),
        ((), r"everything on its lines moves, .* a larger stride than 8, coarse\.stride=16, "),
    ],
)  # fmt: skip
def test_marks_of_which_nothing_follows_have_the_usual_stride(composed, tmp_path, numbers, told):
    with pytest.raises(UserError, match=told):
        scanned(marked(composed, numbers), tmp_path)


@pytest.mark.parametrize("tried", [False, pytest.param(True, marks=pytest.mark.whole)])
def test_a_stride_that_is_set_too_small_is_told_with_that_of_the_circles_size(
    composed, tmp_path, tried
):
    e = marked(composed, (1, 2, 3, 4), "scan.calibration.coarse.stride=5")
    told = r"a larger stride than 5, coarse\.stride=(\d+), below scan, "
    with pytest.raises(UserError, match=told) as error:
        scanned(e, tmp_path / "wrong")
    stride = re.search(told, str(error.value))[1]
    assert int(stride) > 5
    if not tried:
        return
    right = marked(composed, (1, 2, 3, 4), f"scan.calibration.coarse.stride={stride}")
    assert len(edges_of(scanned(right, tmp_path / "right")["edge/a"])) == 4
