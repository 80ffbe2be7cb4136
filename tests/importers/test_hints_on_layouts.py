"""Hints on names and orders of a file lead to right numbers, or to another question; never back."""

from __future__ import annotations

import re
from itertools import permutations

import numpy as np
import pytest
import scipy.io
import yaml

from sldvexp.dataset import take_findings
from sldvexp.errors import UserError
from sldvexp.importers.velocity_file import File

VIEWS, POINTS, FREQUENCIES = 4, 6, 2
DIMS = {
    "velocity": ("view", "point", "frequency"),
    "direction_cosines": ("view", "point", "axis"),
    "position": ("point", "axis"),
}
RNG = np.random.default_rng(8)
COSINES = RNG.normal(size=(VIEWS, POINTS, 3))
COSINES /= np.linalg.norm(COSINES, axis=-1, keepdims=True)
VELOCITY = RNG.normal(size=(VIEWS, POINTS, FREQUENCIES))
PLACES = RNG.normal(size=(POINTS, 3))


def stored(tmp_path, order, others=None, places=True, **more):
    """Write arrays in an order of their dimensions, directions perhaps in another."""
    path = tmp_path / "mine.mat"
    arrays = {}
    known = {"velocity": VELOCITY, "direction_cosines": COSINES}
    for name, values in (known | ({"position": PLACES} if places else {})).items():
        own = (others or order) if name == "direction_cosines" else order
        dims = [d for d in own if d in DIMS[name]]
        arrays[name] = values.transpose([DIMS[name].index(d) for d in dims])
    scipy.io.savemat(path, arrays | {"frequency": [10.0, 20.0]} | more)
    return path


def asked(path, **settings):
    with pytest.raises(UserError) as error:
        File(path=str(path), **settings).read()
    return str(error.value)


def orders_in(said):
    return [order.split(",") for order in re.findall(r"instrument\.order=\[([a-z,]+)\]", said)]


def right(group):
    np.testing.assert_allclose(group["velocity"], VELOCITY)
    np.testing.assert_allclose(group["direction_cosines"], COSINES)


@pytest.mark.parametrize("order", list(permutations(("view", "point", "frequency", "axis"))))
def test_order_that_is_named_gives_the_right_numbers(tmp_path, order):
    path = stored(tmp_path, order)
    ours = all([d for d in order if d in dims] == list(dims) for dims in DIMS.values())
    settings = {}
    if not ours:
        said = asked(path)
        (found,) = orders_in(said)
        assert "only instrument.order=" in said
        settings = {"order": found}
    right(File(path=str(path), **settings).read())


def test_orders_that_lengths_cannot_tell_apart_are_all_named(tmp_path):
    path = tmp_path / "mine.mat"
    cosines = np.moveaxis(COSINES[:, :VIEWS], 2, 0)
    velocity = np.moveaxis(VELOCITY[:, :VIEWS], 2, 0)
    scipy.io.savemat(path, {"velocity": velocity, "direction_cosines": cosines})
    said = asked(path)
    assert "by their lengths" in said
    assert len(orders_in(said)) >= 2


def test_arrays_in_orders_of_their_own_are_not_sent_in_a_circle(tmp_path):
    path = stored(tmp_path, ("frequency", "point", "view"), ("view", "point", "axis"), False)
    said = asked(path)
    assert not orders_in(said)
    assert "bring them into one order in the file, as with permute of MATLAB" in said
    said = asked(path, order=["frequency", "axis", "point", "view"])
    assert "no one order of dimensions (also not [frequency,axis,point,view]) fits all" in said


def test_views_and_points_that_may_be_exchanged_are_both_named(tmp_path):
    path = stored(tmp_path, ("frequency", "point", "view", "axis"), places=False)
    orders = orders_in(asked(path))
    assert len(orders) == 2
    groups = [File(path=str(path), order=order).read() for order in orders]
    assert sorted(group.sizes["view"] for group in groups) == [VIEWS, POINTS]
    right(next(group for group in groups if group.sizes["view"] == VIEWS))


def test_many_views_of_few_points_are_asked_about(tmp_path):
    path = tmp_path / "mine.mat"
    cosines, velocity = np.tile(COSINES[:, :1], (1, 40, 1)), np.ones((VIEWS, 40, 1))
    arrays = {"velocity": velocity.swapaxes(0, 1), "direction_cosines": cosines.swapaxes(0, 1)}
    scipy.io.savemat(path, arrays)
    said = asked(path)
    assert "has 40 views of 4 points, if its arrays begin with views" in said
    sizes = {File(path=str(path), order=o).read().sizes["view"] for o in orders_in(said)}
    assert sizes == {4, 40}


HEAD = "view,dx,dy,dz,real,{}\na,0,0,1,1,{}\nb,0.6,0,0.8,2,{}\n"


@pytest.mark.parametrize("extra", ["coherence", "coherence,remark"])
def test_columns_of_no_use_are_ignored_by_the_setting_that_the_hint_names(tmp_path, extra):
    path = tmp_path / "mine.csv"
    cells = ",".join("9" for _ in extra.split(","))
    path.write_text(HEAD.format(extra, cells, cells))
    said = asked(path)
    mapping = re.search(r"instrument\.mapping=(\{.*?\})", said)
    assert mapping is not None
    assert "ignore if" in said
    blank = yaml.safe_load(mapping[1])
    group = File(path=str(path), mapping=dict.fromkeys(blank, "ignore")).read()
    np.testing.assert_allclose(group["velocity"].values.ravel(), [1.0, 2.0])
    (note,) = take_findings({"line_of_sight": group})
    assert f"instrument.mapping leaves out {extra.replace(',', ', ')}" in note.text


def test_arrays_of_no_use_are_ignored_even_if_they_have_a_name_of_ours(tmp_path):
    path = stored(tmp_path, ("view", "point", "frequency", "axis"), std=np.ones(7))
    assert "standard errors have the shape" in asked(path)
    group = File(path=str(path), mapping={"std": "ignore"}).read()
    right(group)
    assert "velocity_std" not in group
