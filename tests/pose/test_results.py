"""Poses from arrays: what the results say of themselves, and the group ``pose`` that they make."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from sldvexp import pose
from sldvexp.config.paths import locate
from sldvexp.errors import UserError
from sldvexp.geometry import rotation_from_euler
from sldvexp.io.registration import read
from sldvexp.laser import TwoMirror, project

LASER = TwoMirror()
FIGURE_4_28 = "conf://data/figure_4_28.reg"


@pytest.fixture(scope="module")
def table():
    return read(locate(FIGURE_4_28))[0]


def test_arrays_give_the_group_of_a_run(table):
    run = pose.Registration(path=FIGURE_4_28).estimate(LASER, None, {}).to_dataset()
    found = pose.solve_points(table.object_point, table.angle_through(LASER), step=LASER.step)
    own = found.to_dataset([table.name], number=table.number)
    assert own.drop_attrs(deep=False).identical(run.drop_attrs(deep=False))
    rms = float(run["residual_rms"][0])
    assert repr(found).startswith("pose from 16 points: origin (")
    assert repr(found).endswith(f"residuals {rms:.2g} DAC steps rms")


def test_a_batch_is_a_group_of_many_views(table):
    angle = table.angle_through(LASER)
    batch = pose.solve_points(table.object_point, np.stack([angle, angle + 1e-4]), step=LASER.step)
    group = batch.to_dataset()
    assert group["view"].values.tolist() == ["1", "2"]
    np.testing.assert_array_equal(group["origin"], batch.origin)
    assert repr(batch).startswith("2 poses from 16 points each: 2 found, residuals ")


def test_views_together_name_themselves():
    points = np.array([[0, 0, 0], [0.3, 0, 0], [0.3, 0.3, 0], [0, 0.3, 0], [0.1, 0.1, 0.1]])
    stands = {
        "left": ([0.0, 0.0, 0.1], [0.0, 0.1, -1.5]),
        "right": ([0.2, 0.1, 0.0], [0.3, 0, -1.2]),
    }
    views = [
        pose.PointObservations(n, points, project((points - o) @ rotation_from_euler(e).T, 0.03))
        for n, (e, o) in stands.items()
    ]
    found = pose.solve_points_together(views, step=LASER.step, shared={"mirror_offset": 0.01})
    group = found.to_dataset()
    assert [line.split(",")[0] for line in repr(found).splitlines()] == ["view left", "view right"]
    assert group["unknown"].values[-1] == "mirror_offset"
    np.testing.assert_allclose(group["intrinsic"], 0.03, atol=1e-9)
    np.testing.assert_allclose(group["origin"], [o for _, o in stands.values()], atol=1e-9)


def test_edges_need_no_start(edge_lab, make_circles):
    lab = edge_lab(views=2, target=make_circles(0.0))
    found = pose.solve_edges(lab.points(None), mirror_offset=lab.nominal, views=lab.names)
    np.testing.assert_allclose(lab.errors(found), 0, atol=1e-10)
    assert found.to_dataset()["view"].values.tolist() == lab.names
    assert repr(found).splitlines()[1].startswith("view b, pose from 176 edges: origin (-0.6000, ")


def test_two_circles_give_no_start(edge_lab, make_circles):
    lab = edge_lab(target=make_circles(0.0))
    points = lab.points(None)[0]
    two = replace(
        points, **{f.name: getattr(points, f.name)[:88] for f in fields(points) if f.name != "step"}
    )
    with pytest.raises(UserError, match=r"view 1: the circles' centres give no pose to start from"):
        pose.solve_edges([two], mirror_offset=lab.nominal)
