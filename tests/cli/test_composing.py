"""What is composed quickly is what Hydra composes."""

from __future__ import annotations

import inspect
import pickle
from copy import deepcopy
from dataclasses import dataclass, field
from types import ModuleType

import omegaconf.omegaconf
import pytest
from hydra import version
from hydra._internal import config_loader_impl, defaults_list
from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra._internal.utils import create_config_search_path
from hydra.errors import ConfigCompositionException
from hydra.types import RunMode
from omegaconf import Container, DictConfig, OmegaConf, open_dict

from sldvexp.config import naming_loader, schema
from sldvexp.config.cached_loader import RememberingLoader
from sldvexp.config.naming_loader import NamingLoader
from sldvexp.config.paths import conf_dir
from sldvexp.config.quick_copies import quick_copies
from sldvexp.config.repository import RememberingRepository, copies_of

OVERRIDES = {
    "nothing": [],
    "values": ["seed=3", "scan.structure.pixels=[5,4]", "pose.max_iterations=9"],
    "more of Hydra": ["hydra.job.chdir=true", "+hydra.job.env_set.A=b", "seed=2"],
    "a table": ["volume={size:[0.2,0.2],shape:[5,4]}"],
    "of Hydra": ["hydra.run.dir=here", "hydra/job_logging=disabled", "seed=1"],
    "choices": ["experiment=pose", "solver=cholesky", "target=dissertation"],
    "folders of Hydra": ["hydra.sweep.dir=there", "hydra.job.config.override_dirname.kv_sep=:"],
    "added and deleted": ["+check.again={plugin:love}", "~check.surface"],
    "deleted choices": ["~experiment", "target=dissertation"],
    "in any order": ["seed=1", "solver=direct", "seed=2"],
}
REFUSED = {
    "a misspelt key": ["experiment=point", "sead=3"],
    "a misspelt choice": ["solver=choleski"],
    "a wrong type": ["seed=many"],
    "not a setting": ["seed=[1"],
    "a sweep in a single run": ["seed=1,2"],
}


@dataclass
class Unions:
    """Nodes that hold others."""

    limit: int | str = 4
    limits: dict[str, int | None] = field(default_factory=lambda: {"a": 1, "b": None})


@pytest.fixture(scope="module")
def loaders():
    path = create_config_search_path(str(conf_dir()))
    version.setbase("1.3")  # as a command does: the last one in this process may not have
    return RememberingLoader(path), ConfigLoaderImpl(path)


def described(node):
    """All that a configuration is: values, types and flags of every node."""
    flags = dict(node._metadata.flags or {})
    kind = node._metadata.ref_type, node._metadata.object_type, node._metadata.optional
    if isinstance(node, Container) and not node._is_none() and not node._is_missing():
        keys = node.keys() if OmegaConf.is_dict(node) else range(len(node))
        return kind, flags, {key: described(node._get_node(key)) for key in keys}
    return kind, flags, node._value()


@pytest.mark.one_in(10)
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


@pytest.mark.one_in(6)
@pytest.mark.parametrize("overrides", REFUSED.values(), ids=REFUSED)
def test_what_is_refused(loaders, overrides):
    told = []
    for loader in loaders:
        with pytest.raises(Exception) as caught:  # noqa: PT011 (Hydra raises many kinds)
            loader.load_configuration("config", list(overrides), RunMode.RUN)
        told.append((type(caught.value), str(caught.value)))
    assert told[0] == told[1]


def test_nothing_is_composed_anew_for_a_value_that_is_wrong(loaders, monkeypatch):
    loaders[0].load_configuration("config", ["experiment=point"], RunMode.RUN)
    monkeypatch.setattr(ConfigLoaderImpl, "_load_configuration_impl", None)
    with pytest.raises(ConfigCompositionException, match="Could not override 'sead'"):
        loaders[0].load_configuration("config", ["experiment=point", "sead=3"], RunMode.RUN)


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
        quick.load_configuration("config", ["experiment=point", *overrides], RunMode.RUN)
    assert len(read) == 2


def parents(node, parent):
    """All that a copy shares with what it is of, or that has another parent than it is in."""
    if node._get_parent() is not parent:
        yield node
    if isinstance(node, Container) and not node._is_none() and not node._is_missing():
        for key in node.keys() if OmegaConf.is_dict(node) else range(len(node)):
            yield from parents(node._get_node(key), node)


def test_quick_copies_are_copies(loaders):
    whole = loaders[0].load_configuration("config", [], RunMode.RUN)
    whole._metadata.resolver_cache["now"]["%H"] = "12"
    for node in (whole, whole.scan, OmegaConf.structured(Unions), whole.scan.structure.pixels):
        usual = deepcopy(node)
        with quick_copies():
            quick = deepcopy(node)
        assert described(quick) == described(usual) == described(node)
        assert quick._metadata == usual._metadata
        assert [*parents(quick, node._get_parent())] == []
    with quick_copies():
        quick = deepcopy(whole)
    whole._metadata.resolver_cache["now"]["%H"] = "13"
    assert quick._metadata.resolver_cache["now"]["%H"] == "12"
    quick.hydra.job.name, quick.scan.structure.pixels[0] = "other", 99
    OmegaConf.set_readonly(quick.scan, True)
    assert (whole.hydra.job.name, whole.scan.structure.pixels[0]) != ("other", 99)
    assert not OmegaConf.is_readonly(whole.scan)


def test_schemas_of_entries_are_made_once_and_are_nobody_elses(loaders, monkeypatch):
    def built():
        config = loaders[0].load_configuration("config", ["experiment=plate"], RunMode.RUN)
        with open_dict(config):
            del config["hydra"]
        return schema.build(config)

    first, made, usual = built(), [], OmegaConf.structured
    said = repr(first)
    assert first.expect
    assert first.check

    def structured(cls, **more):
        made.append(cls)
        return usual(cls, **more)

    monkeypatch.setattr(OmegaConf, "structured", structured)
    for entry in first.expect.values():
        entry.at_most["mine"] = 1.0
        entry.finds.append("sign of view 4")
    assert repr(first) != said
    assert repr(built()) == said
    assert made == []


def test_nodes_are_told_what_they_are_in_and_forget_its_flags(loaders):
    whole = loaders[0].load_configuration("config", [], RunMode.RUN)
    for node in (whole, OmegaConf.structured(Unions)):
        inner = node._get_node("scan" if node is whole else "limits")
        inner._get_node("structure" if node is whole else "a")._set_parent(None)
        inner._set_parent(OmegaConf.create({}, flags={"readonly": True}))
        assert inner._get_flag("readonly")
        with quick_copies():
            node._re_parent()
        assert [*parents(node, None)] == []
        assert not inner._get_flag("readonly")


def test_texts_are_the_usual_ones(loaders):
    whole = loaders[0].load_configuration("config", ["experiment=plate_frf"], RunMode.RUN)
    odd = OmegaConf.create({"a": ["on", "1e3", "é °: µ", "", "- x", 40 * "long ", None, 1e-9]})
    for config in (whole, odd):
        usual = OmegaConf.to_yaml(config)
        with quick_copies():
            assert OmegaConf.to_yaml(config) == usual


def test_what_has_no_emitter_in_c_writes_as_usual(monkeypatch):
    monkeypatch.setattr("sldvexp.config.quick_copies._EMITTER", None)
    with quick_copies():
        assert OmegaConf.to_yaml(OmegaConf.create({"a": "on"})) == "a: 'on'\n"


def test_copies_are_quick_only_for_who_asks():
    usual = DictConfig.__deepcopy__, DictConfig._re_parent
    writer = omegaconf.omegaconf.get_omega_conf_dumper()
    with quick_copies(), quick_copies():
        assert DictConfig.__deepcopy__ is not usual[0]
        assert DictConfig._re_parent is not usual[1]
        assert omegaconf.omegaconf.get_omega_conf_dumper() is not writer
    assert (DictConfig.__deepcopy__, DictConfig._re_parent) == usual
    assert omegaconf.omegaconf.get_omega_conf_dumper() is writer


def test_choices_are_known_to_defaults_that_refer_to_them(tmp_path):
    (tmp_path / "mine.yaml").write_text(
        "defaults:\n- config\n- extra: ${solver}_one\n- _self_\n- override solver: direct\n"
    )
    (tmp_path / "extra").mkdir()
    (tmp_path / "extra" / "direct_one.yaml").write_text("# @package _global_\nseed: 77\n")
    path = create_config_search_path(str(conf_dir()))
    path.prepend("command-line", f"file://{tmp_path}")
    assert RememberingLoader(path).load_configuration("mine", [], RunMode.RUN).seed == 77


def test_a_hydra_that_makes_choices_known_by_another_function(loaders, monkeypatch):
    usual = defaults_list._create_interpolation_map
    # As if that function had another name, by which Hydra itself calls it.
    code = inspect.getsource(defaults_list).replace("_create_interpolation_map", "_other_name")
    other = ModuleType(defaults_list.__name__)
    exec(compile(code, defaults_list.__file__, "exec"), vars(other))
    assert not hasattr(other, usual.__name__)
    monkeypatch.setattr(naming_loader, "defaults_list", other)
    monkeypatch.setattr(config_loader_impl, "create_defaults_list", other.create_defaults_list)
    path = create_config_search_path(str(conf_dir()))
    overrides = ["experiment=point", "solver=direct", "seed=5"]
    composed = NamingLoader(path).load_configuration("config", overrides, RunMode.RUN)
    expected = loaders[0].load_configuration("config", overrides, RunMode.RUN)
    assert described(composed) == described(expected)


def test_a_file_that_changes_is_read_anew(tmp_path):
    (tmp_path / "solver").mkdir()
    path = create_config_search_path(str(conf_dir()))
    path.prepend("command-line", f"file://{tmp_path}")
    for most in (7, 8):
        (tmp_path / "solver" / "own.yaml").write_text(f"plugin: direct\nmore: {most}\n")
        assert RememberingRepository(path).load_config("solver/own").config.more == most


def test_schemas_that_cannot_be_pickled():
    """Hydra's search for plugins may import a module once more, which makes its classes others."""

    @dataclass
    class Local:
        seed: int = 4

    copies = copies_of(OmegaConf.structured(Local))
    first, second = copies(), copies()
    first.seed = 5
    assert second.seed == 4
