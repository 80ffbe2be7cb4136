"""What is composed quickly is what Hydra composes."""

from __future__ import annotations

import pickle
from dataclasses import dataclass

import pytest
from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra._internal.utils import create_config_search_path
from hydra.types import RunMode
from omegaconf import Container, OmegaConf

from sldvexp.config import hydra_plugin
from sldvexp.config.cached_loader import RememberingLoader
from sldvexp.config.paths import conf_dir
from sldvexp.config.repository import copies_of

OVERRIDES = {
    "nothing": [],
    "values": ["seed=3", "scan.structure.pixels=[5,4]", "pose.max_iterations=9"],
    "choices": ["experiment=pose", "solver=cholesky", "target=dissertation"],
    "a table": ["volume={size:[0.2,0.2],shape:[5,4]}"],
    "of Hydra": ["hydra.run.dir=here", "hydra/job_logging=disabled", "seed=1"],
    "more of Hydra": ["hydra.job.chdir=true", "+hydra.job.env_set.A=b", "seed=2"],
    "folders of Hydra": ["hydra.sweep.dir=there", "hydra.job.config.override_dirname.kv_sep=:"],
    "added and deleted": ["+check.again={plugin:love}", "~check.surface"],
    "deleted choices": ["~experiment", "target=dissertation"],
    "in any order": ["seed=1", "solver=direct", "seed=2"],
}
REFUSED = {
    "a misspelt key": ["sead=3"],
    "a misspelt choice": ["solver=choleski"],
    "a wrong type": ["seed=many"],
    "not a setting": ["seed=[1"],
    "a sweep in a single run": ["seed=1,2"],
}


@pytest.fixture(scope="module")
def loaders():
    hydra_plugin.install()
    path = create_config_search_path(str(conf_dir()))
    return RememberingLoader(path), ConfigLoaderImpl(path)


def described(node):
    """All that a configuration is: values, types and flags of every node."""
    flags = dict(node._metadata.flags or {})
    kind = node._metadata.ref_type, node._metadata.object_type, node._metadata.optional
    if isinstance(node, Container) and not node._is_none() and not node._is_missing():
        keys = node.keys() if OmegaConf.is_dict(node) else range(len(node))
        return kind, flags, {key: described(node._get_node(key)) for key in keys}
    return kind, flags, node._value()


@pytest.mark.one_in(5)
@pytest.mark.parametrize("mode", RunMode, ids=lambda mode: mode.name)
@pytest.mark.parametrize("overrides", OVERRIDES.values(), ids=OVERRIDES)
def test_what_is_composed(loaders, overrides, mode):
    quick, usual = (x.load_configuration("config", list(overrides), mode) for x in loaders)
    assert described(quick) == described(usual)


@pytest.mark.whole
def test_the_master_configuration_of_a_sweep(loaders):
    overrides = ["seed=1,2", "solver=iterative,direct", "volume.size=[0.2,0.1]"]
    quick, usual = (x.load_configuration("config", overrides, RunMode.MULTIRUN) for x in loaders)
    assert described(quick) == described(usual)


@pytest.mark.one_in(3)
@pytest.mark.parametrize("overrides", REFUSED.values(), ids=REFUSED)
def test_what_is_refused(loaders, overrides):
    told = []
    for loader in loaders:
        with pytest.raises(Exception) as caught:  # noqa: PT011 (Hydra raises many kinds)
            loader.load_configuration("config", list(overrides), RunMode.RUN)
        told.append((type(caught.value), str(caught.value)))
    assert told[0] == told[1]


def test_names_that_are_numbers(loaders):
    views = "scan.calibration.views={1: {dac: [[0, 0]]}, front: {dac: [[1, 1]]}}"
    found = loaders[0].load_configuration("config", [views], RunMode.RUN)
    assert {"1", "front"} <= set(found.scan.calibration.views)


def test_jobs_share_nothing_that_can_change(loaders):
    first, second = (
        loaders[0].load_configuration("config", [f"seed={n}"], RunMode.RUN) for n in (1, 2)
    )
    first.scan.structure.pixels = [3, 3]
    assert (first.seed, second.seed) == (1, 2)
    assert second.scan.structure.pixels != [3, 3]


def test_files_are_read_once_for_the_same_choices(loaders, monkeypatch):
    quick = pickle.loads(pickle.dumps(loaders[0]))  # remembers nothing in another process
    quick._lasting.folder = ""
    read = []
    whole = ConfigLoaderImpl._load_configuration_impl

    def composed(self, *args, **more):
        read.append(args)
        return whole(self, *args, **more)

    monkeypatch.setattr(ConfigLoaderImpl, "_load_configuration_impl", composed)
    for overrides in (
        ["seed=1"],
        ["hydra.run.dir=a"],
        ["solver=direct"],
        ["solver=direct", "seed=4"],
    ):
        quick.load_configuration("config", overrides, RunMode.RUN)
    assert len(read) == 2


def test_schemas_that_cannot_be_pickled():
    """Hydra's search for plugins may import a module once more, which makes its classes others."""

    @dataclass
    class Local:
        seed: int = 4

    copies = copies_of(OmegaConf.structured(Local))
    first, second = copies(), copies()
    first.seed = 5
    assert second.seed == 4
