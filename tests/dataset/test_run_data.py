"""A run is read the same way whatever it is given as, and opened with one sentence or none."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp import dataset
from sldvexp.dataset import RunData, open_run
from sldvexp.errors import UserError

VELOCITY = np.array([0.01, 0.02j, -0.03])


@pytest.fixture
def groups():
    point = dataset.group("point", {}, velocity=VELOCITY)
    return {"point": point, "image/front": dataset.group("image", {}, velocity=VELOCITY)}


@pytest.fixture
def path(groups, tmp_path):
    dataset.save(groups, {"config": "{seed: 1}", "plugins": "[]"}, tmp_path / "run.nc")
    return tmp_path / "run.nc"


def test_a_run_is_the_same_from_its_path_its_tree_and_its_groups(groups, path):
    with open_run(path, lazy=True) as tree:
        for source in (path, str(path), tree, groups):
            run = RunData.from_source(source)
            assert run.groups.keys() == groups.keys()
            assert all(run.groups[name].identical(groups[name]) for name in groups)
        assert RunData.from_source(tree).folder == path.parent
    assert RunData.from_source(run) is run
    assert list(run.below("image", "velocity")) == ["front"]
    assert run.below("image", "flags") == {}


def test_what_the_root_records_is_read_or_refused_in_a_sentence(path):
    run = RunData.from_source(path)
    assert run.config == {"seed": 1}
    with pytest.raises(UserError, match=r"run\.nc: plugins: must be a table"):
        _ = run.plugins
    with pytest.raises(UserError, match="has no attribute config; it is not the file of a run"):
        _ = RunData({}).config


@pytest.mark.parametrize("lazy", [False, True])
def test_a_run_is_opened_by_its_file_or_its_folder(path, lazy):
    for where in (path, str(path.parent)):
        with open_run(where, lazy=lazy) as tree:
            np.testing.assert_array_equal(tree["point/velocity"], VELOCITY)


def test_a_run_in_memory_needs_its_file_no_more(path):
    tree = open_run(path)
    path.unlink()
    np.testing.assert_array_equal(tree["image/front/velocity"], VELOCITY)


def test_a_run_that_is_not_there_is_told_in_a_sentence(tmp_path):
    with pytest.raises(UserError, match=r"run\.nc: there is no such file; a run's dataset is "):
        open_run(tmp_path)
    (tmp_path / "run.nc").write_text("no dataset")
    with pytest.raises(UserError, match="is not a readable netCDF-4 file"):
        open_run(tmp_path)
