"""What is only shown is composed of schemas that were kept: the same text, and no plugin loaded."""

from __future__ import annotations

import subprocess
import sys

import pytest
from hydra import version
from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra._internal.utils import create_config_search_path
from hydra.types import RunMode
from omegaconf import OmegaConf

from sldvexp.config import schema_table
from sldvexp.config.cached_loader import RememberingLoader, ShowingLoader
from sldvexp.config.kept import CACHE
from sldvexp.config.paths import conf_dir
from sldvexp.config.schema_table import SchemaTable

#: Loads what a process that composes nothing has loaded, and prints which modules more came.
PROGRAM = """
import sys
from sldvexp.cli import main
try:
    main.main()
finally:
    heavy = [m for m in sys.modules if m.startswith(("numpy._core", "sldvexp.field."))]
    print(sorted(heavy), file=sys.stderr)
"""
#: The quickest of them first, which is tried by default.
EXPERIMENTS = sorted(
    (f.stem for f in (conf_dir() / "experiment").glob("*.yaml")), key=lambda n: (n != "point", n)
)


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    version.setbase("1.3")  # as a command does, and what is composed is kept for other tests
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / CACHE


def shown(loader, overrides, folder=None):
    path = create_config_search_path(str(conf_dir()))
    if folder is not None:
        path.prepend("command-line", f"file://{folder}")
    config = loader(path).load_configuration("config", list(overrides), RunMode.RUN)
    del config.hydra
    return OmegaConf.to_yaml(config)


@pytest.fixture
def stand_ins(monkeypatch):
    """Classes have stand-ins although they are loaded, and what was shown with them."""
    monkeypatch.setattr(schema_table, "_is_loaded", lambda module: ".config." in module)
    schema_table._class_of.cache_clear()
    composed, usual = [], ShowingLoader._of_table

    def counted(self, *asked):
        composed.append(usual(self, *asked))
        return composed[-1]

    monkeypatch.setattr(ShowingLoader, "_of_table", counted)
    yield composed
    schema_table._class_of.cache_clear()


@pytest.mark.one_in(20)
@pytest.mark.parametrize("name", EXPERIMENTS)
def test_every_experiment_is_shown_as_it_is_composed(name, stand_ins):
    expected = shown(ConfigLoaderImpl, [f"experiment={name}"])
    assert shown(ShowingLoader, [f"experiment={name}"]) == expected
    assert shown(ShowingLoader, [f"experiment={name}"]) == expected
    assert len(stand_ins) == 2
    kinds = {OmegaConf.get_type(node) for node in stand_ins[1].values() if OmegaConf.is_dict(node)}
    assert any(issubclass(kind, schema_table.StandIn) for kind in kinds)


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    "settings",
    [
        ["scene.pointing=chapter_4", "on_doubt=stop"],
        ["+check.mine={plugin:love}", "~report", "target=dissertation"],
        ["export.x={plugin:vtu}", "reconstruction=shell", "seed=3"],
    ],
    ids=lambda settings: settings[0],
)
def test_settings_are_shown_as_they_are_composed(settings, stand_ins):
    """Those of an enumeration, and of tables that make more entries of a class."""
    expected = shown(RememberingLoader, settings)
    assert shown(ShowingLoader, settings) == expected
    assert len(stand_ins) == 1


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    "wrong",
    [["experiment=point", "seed=[1]"], ["pose.sead=1"], ["scene.pointing=no"]],
    ids=lambda wrong: wrong[-1],
)
def test_what_is_wrong_is_told_of_the_classes(wrong, stand_ins):
    with pytest.raises(Exception) as expected:  # noqa: PT011
        shown(RememberingLoader, wrong)
    with pytest.raises(type(expected.value)) as told:
        shown(ShowingLoader, wrong)
    assert str(told.value) == str(expected.value)
    assert not stand_ins


def test_a_file_of_the_user_is_read_every_time(tmp_path, stand_ins):
    mine = tmp_path / "mine" / "solver"
    mine.mkdir(parents=True)
    for tolerance in ("1.0e-09", "1.0e-08"):
        (mine / "own.yaml").write_text(
            f"defaults: [schema/iterative@_here_, _self_]\ntolerance: {tolerance}\n"
        )
        assert f"tolerance: {tolerance}\n" in shown(
            ShowingLoader, ["~experiment", "solver=own"], tmp_path / "mine"
        )
    assert len(stand_ins) == 2


@pytest.mark.one_in(3)
@pytest.mark.parametrize("content", [b"not a table", b"", None])
def test_a_table_that_is_spoiled_is_made_anew(cache, content):
    first = shown(ShowingLoader, ["experiment=point"])
    [file] = cache.iterdir()
    if content is None:
        SchemaTable()._files.write(file.name, b"no pickle")
    else:
        file.write_bytes(content)
    assert shown(ShowingLoader, ["experiment=point"]) == first
    whole = file.stat().st_mtime_ns
    assert shown(ShowingLoader, ["experiment=point"]) == first
    assert file.stat().st_mtime_ns == whole, "what is known is not written again"


@pytest.mark.whole
def test_a_new_choice_of_known_plugins_loads_none_of_them(tmp_path):
    def modules(*settings):
        call = [sys.executable, "-c", PROGRAM, *settings, "--cfg", "job"]
        done = subprocess.run(call, cwd=tmp_path, capture_output=True, text=True, check=True)
        return done.stdout, done.stderr.splitlines()[-1]

    assert "numpy._core" in modules("solver=direct", "reconstruction=relative")[1]
    assert "sldvexp.field." in modules()[1]
    page, loaded = modules("reconstruction=relative")
    assert "seed: 0\n" in page
    assert loaded == "[]"


def test_another_omegaconf_composes_of_the_classes(monkeypatch):
    expected = shown(ConfigLoaderImpl, ["experiment=point"])
    monkeypatch.setattr(schema_table, "_usual", None)
    assert shown(ShowingLoader, ["experiment=point"]) == expected
