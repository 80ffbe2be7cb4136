"""What is composed lasts in the user's cache: as it was, while nothing changes, if it is safe."""

from __future__ import annotations

import os

import pytest
from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra._internal.utils import create_config_search_path
from hydra.types import RunMode
from omegaconf import OmegaConf

from sldvexp.config import cached_loader, kept, registry
from sldvexp.config.cached_loader import LOOKED_UP, LastingMemory, RememberingLoader
from sldvexp.config.kept import CACHE, KeptFiles
from sldvexp.config.paths import conf_dir
from sldvexp.config.repository import Memory

CHOICES = ["solver=cholesky", "seed=3"]


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    registry.load_installed.cache_clear()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / CACHE


def compose(overrides=CHOICES, folder=None):
    """Compose as a new process does, without an experiment, which takes longest."""
    path = create_config_search_path(str(conf_dir()))
    if folder is not None:
        path.prepend("command-line", f"file://{folder}")
    loader = RememberingLoader(path)
    loader._known = Memory()
    found = loader.load_configuration("config", ["~experiment", *overrides], RunMode.RUN)
    return OmegaConf.to_container(found)


@pytest.fixture
def composed(monkeypatch):
    """How often Hydra composed."""
    times, usual = [], ConfigLoaderImpl._load_configuration_impl

    def counted(self, *arguments, **settings):
        times.append(arguments)
        return usual(self, *arguments, **settings)

    monkeypatch.setattr(ConfigLoaderImpl, "_load_configuration_impl", counted)
    return times


def test_a_second_process_reads_the_same(cache, composed):
    first = compose()
    assert compose() == first
    assert compose(["solver=cholesky", "seed=4"])["seed"] == 4
    assert len(composed) == 1
    [file] = cache.iterdir()
    assert cache.stat().st_mode & 0o777 == 0o700
    assert file.stat().st_mode & 0o777 == 0o600


def test_other_choices_are_composed(composed):
    compose()
    assert compose(["solver=direct"]) != compose()
    assert len(composed) == 2


@pytest.mark.parametrize("change", ["content", "another file", "code"])
def test_a_change_is_seen(tmp_path, composed, change, monkeypatch):
    mine = tmp_path / "mine" / "solver"
    mine.mkdir(parents=True)
    (mine / "own.yaml").write_text("plugin: iterative\ntolerance: 1e-9\n")
    first = compose(["solver=own"], tmp_path / "mine")
    if change == "content":
        (mine / "own.yaml").write_text("plugin: iterative\ntolerance: 1e-8\n")
    elif change == "another file":
        (mine / "other.yaml").write_text("plugin: iterative\n")
    else:
        monkeypatch.setattr(cached_loader.omegaconf, "__version__", "2.3.9")
    second = compose(["solver=own"], tmp_path / "mine")
    assert len(composed) == 2
    assert (second == first) == (change != "content")


def damaged(file):
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)


def cut(file):
    file.write_bytes(file.read_bytes()[:100])


def linked(file):
    other = file.with_name("other")
    file.replace(other)
    file.symlink_to(other)


def writable(file):
    file.chmod(0o622)


def emptied(file):
    file.write_bytes(b"")


@pytest.mark.one_in(5)
@pytest.mark.parametrize("spoil", [damaged, cut, linked, writable, emptied])
def test_what_is_not_whole_or_not_safe_is_composed_anew(cache, composed, spoil):
    first = compose()
    spoil(next(cache.iterdir()))
    assert compose() == first
    assert len(composed) == 2
    assert compose() == first
    assert len(composed) == 2


@pytest.mark.one_in(3)
@pytest.mark.parametrize("mode", [0o755, 0o770, 0o702])
def test_a_folder_of_others_too_is_left_alone(cache, composed, mode):
    cache.mkdir(parents=True)
    cache.chmod(mode)
    assert compose() == compose()
    assert len(composed) == 2
    assert not list(cache.iterdir())


def test_a_cache_that_cannot_be_made_is_none(cache, composed):
    cache.parent.write_text("a file")
    assert compose() == compose()
    assert len(composed) == 2


def test_what_is_looked_up_elsewhere_does_not_last(tmp_path, cache, composed, monkeypatch):
    mine = tmp_path / "mine" / "solver"
    mine.mkdir(parents=True)
    (mine / "own.yaml").write_text("plugin: iterative\ntolerance: ${oc.env:TOLERANCE,1e-9}\n")
    compose(["solver=own"], tmp_path / "mine")
    assert not list(cache.iterdir())


def test_of_a_folder_with_more_than_configurations_nothing_is_kept(tmp_path, cache, monkeypatch):
    mine = tmp_path / "mine" / "solver"
    mine.mkdir(parents=True)
    (mine / "own.yaml").write_text("plugin: iterative\n")
    monkeypatch.setattr(cached_loader, "MOST_ENTRIES", 200)
    for k in range(300):
        (mine / f"picture_{k}.png").touch()
    compose(["solver=own"], tmp_path / "mine")
    assert not list(cache.iterdir())


def test_own_configurations_look_nothing_up():
    """Their content is not searched for it, since times and sizes tell a change."""
    assert not [f for f in conf_dir().rglob("*.yaml") if LOOKED_UP.search(f.read_bytes())]


def test_the_oldest_go(cache, monkeypatch):
    monkeypatch.setattr(kept, "MOST_KEPT", 3)
    memory = LastingMemory()
    for k in range(5):
        memory.keep(f"{k}", OmegaConf.create({"k": k}))
        os.utime(cache / f"{k}", (k, k))
    assert sorted(file.name for file in cache.iterdir()) == ["2", "3", "4"]
    assert memory.recall("4")() == {"k": 4}
    assert memory.recall("0") is None


def test_the_name_changes_with_the_program(tmp_path, monkeypatch):
    package = tmp_path / "lib" / "package"
    (package / "config").mkdir(parents=True)
    (package.parent / "conf").mkdir()
    code, settings = package / "config" / "kept.py", package.parent / "conf" / "config.yaml"
    for file in (code, settings):
        file.write_text("one")
    monkeypatch.setattr(kept, "__file__", str(code))
    names = [kept.name_of("a"), kept.name_of("b"), kept.name_of("a")]
    assert names[0] == names[2] != names[1]
    for file in (code, settings):
        about = file.stat()
        file.write_text("two")
        os.utime(file, ns=(about.st_atime_ns, about.st_mtime_ns))  # no program hides a change
        names.append(kept.name_of("a"))
    assert len(set(names)) == 4
    assert KeptFiles().read(names[0]) is None
