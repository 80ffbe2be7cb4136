"""Packages of others: a method with its configuration, installed by pip, and broken ones."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest

from sldvexp import dataset
from sldvexp.config import registry

EXAMPLE = Path(__file__).with_name("example_package")
PIP = "pip install --quiet --no-index --no-deps --no-build-isolation --no-compile --target"
SCRIPT = Path(sys.executable).with_name("sldvexp")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A folder on the path of which pip has installed the example package."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", *PIP.split(), str(folder), str(EXAMPLE)]
    environment = {**os.environ, "PIP_DISABLE_PIP_VERSION_CHECK": "1"}
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture
def installed(site, monkeypatch):
    """The example package, and more, in this process; forgotten afterwards."""
    monkeypatch.syspath_prepend(site)
    registry.load_installed.cache_clear()
    yield
    for name in ("sldvexp_example", "sldvexp_example.neighbours", "stranger", "single"):
        sys.modules.pop(name, None)
    registry._forget(registry._others())
    registry._packages.clear()
    registry.load_installed.cache_clear()


def package(folder, name, code):
    """What pip leaves of a package that has one module."""
    info = folder / f"{name}-2.1.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 2.1\n")
    (info / "entry_points.txt").write_text(f"[sldvexp.plugins]\nextra = {name}\n")
    (folder / f"{name}.py").write_text(code)


@pytest.mark.whole
def test_method_is_chosen_like_any_other_after_pip_install(site, tmp_path):
    arguments = "-m experiment=point,neighbours reconstruction=neighbours hydra.sweep.dir=sweep"
    done = subprocess.run(
        [SCRIPT, *arguments.split()],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(site)},
    )
    assert (done.returncode, done.stderr) == (0, "")
    (own,) = (tmp_path / "sweep").glob("experiment=neighbours*/run.nc")
    with dataset.load(own) as tree:  # the package's own experiment
        assert tree["check/passed"].values.all()
    (other,) = (tmp_path / "sweep").glob("experiment=point*/run.nc")
    with dataset.load(other) as tree:
        views = list(tree["line_of_sight/view"].values)
        rows = [f"{later}-{view}" for view, later in pairwise(views)]
        assert tree["point"].attrs["rows"] == ",".join(rows)
        assert json.loads(tree.attrs["plugins"])["reconstruction"] == "neighbours"
        assert json.loads(tree.attrs["packages"])["sldvexp-example"] == "1.0"


def test_without_the_package_there_is_no_such_method(sldvexp):
    done = sldvexp("experiment=point", "reconstruction=neighbours")
    assert done.err.startswith("sldvexp: command line: there is no reconstruction=neighbours; ")


@pytest.mark.whole
def test_choices_of_a_package_are_listed_and_shown(sldvexp, installed, site):
    out = sldvexp("list").out
    assert "  neighbours     Rows are differences of neighbouring views" in out
    assert " [sldvexp-example 1.0]" in " ".join(out.split())
    assert re.search(r"^  neighbours +The velocity \(2, 2, 50\) of Table 5.1", out, re.MULTILINE)
    out = sldvexp("show", "reconstruction=neighbours").out
    assert "plugin  neighbours, sldvexp_example.neighbours (sldvexp-example 1.0)\n" in out
    conf = site / "sldvexp_example/conf"
    assert f"file {conf}/reconstruction/neighbours.yaml: Differences of views" in " ".join(
        out.split()
    )
    assert "  apart: 1\n      int. How many places" in out
    assert (
        f"file  {conf}/experiment/neighbours.yaml\n" in sldvexp("show", "experiment=neighbours").out
    )
    assert ", neighbours" in sldvexp("--help").out


@pytest.mark.whole
def test_users_folder_builds_on_a_package(sldvexp, installed, tmp_path):
    file = tmp_path / "lab/experiment/mine.yaml"
    file.parent.mkdir(parents=True)
    file.write_text(
        "# @package _global_\ndefaults: [point, _self_, override /reconstruction: neighbours]\n"
        "reconstruction: {apart: 2}\n"
    )
    shown = sldvexp("--config-dir", "lab", "experiment=mine", "--cfg", "job")
    assert "  apart: 2\n" in shown.out
    file.write_text(file.read_text().replace("apart", "apert"))
    done = sldvexp("--config-dir", "lab", "experiment=mine")
    assert done.err.startswith(
        "sldvexp: lab/experiment/mine.yaml: reconstruction.apert is not a known setting; did you "
    )


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("arguments", "answer"),
    [
        ("reconstruction=neighbour", "command line: there is no reconstruction=neighbour; did you"),
        ("reconstruction.apart=0", "command line: reconstruction.apart must be at least 1, not 0"),
        ("reconstruction.apart=9", "reconstruction: of 5 views no two are 9 places apart"),
    ],
)
def test_mistakes_are_told_as_those_about_other_methods(sldvexp, installed, arguments, answer):
    done = sldvexp("experiment=neighbours", arguments)
    assert done.status == 1
    assert done.err.startswith(f"sldvexp: {answer}")


GOOD = """
from dataclasses import dataclass
from sldvexp.registry import register
@register("{group}", "{name}")
@dataclass
class Extra:
    number: {type} = 1
"""


@pytest.mark.parametrize(
    ("code", "reason"),
    [
        ("import nowhere_to_be_found", "ModuleNotFoundError: No module named"),
        ("raise SystemExit(3)", "SystemExit: 3"),
        ("def (", "SyntaxError: "),
        ('raise ValueError("two\\nlines")', "ValueError: two lines"),
        (
            GOOD.format(group="poze", name="x", type="int"),
            "UserError: there is no group poze for x",
        ),
        (GOOD.format(group="pose", name="given", type="int"), "UserError: two plugins are called"),
        (GOOD.format(group="pose", name="x", type="complex"), "ValidationError: Unexpected type"),
    ],
)
def test_broken_package_names_itself_and_breaks_nothing(
    installed, tmp_path, monkeypatch, code, reason
):
    package(tmp_path / "broken", "stranger", code)
    monkeypatch.syspath_prepend(tmp_path / "broken")
    told = f"the plugin extra of the package stranger cannot be loaded: {reason}"
    with pytest.warns(registry.PluginWarning, match=re.escape(told)):
        assert registry.load_installed()
    assert registry.known("reconstruction", "neighbours")
    assert "x" not in registry.names("pose")
    assert registry.get("pose", "given").__module__ == "sldvexp.pose.given"


@pytest.mark.whole
def test_broken_package_gets_one_line(tmp_path):
    package(tmp_path / "broken", "stranger", "1 / 0")
    done = subprocess.run(
        [SCRIPT, "list", "pose"],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": str(tmp_path / "broken")},
    )
    assert (done.returncode, done.stderr) == (
        0,
        "sldvexp: the plugin extra of the package stranger cannot be loaded: ZeroDivisionError: "
        "division by zero\n",
    )


def test_one_module_has_no_folder_of_files(sldvexp, installed, tmp_path, monkeypatch):
    package(tmp_path / "good", "single", GOOD.format(group="pose", name="x", type="int"))
    (tmp_path / "good/conf/pose").mkdir(parents=True)  # of somebody else's
    (tmp_path / "good/conf/pose/y.yaml").write_text("# Not ours.\n")
    monkeypatch.syspath_prepend(tmp_path / "good")
    out = sldvexp("list", "pose").out
    assert "[single 2.1]" in out
    assert "  number: 1\n" in sldvexp("show", "pose=x").out
    assert "there is no pose=y; " in sldvexp("show", "pose=y").err


@pytest.mark.whole
def test_files_of_a_package_are_no_strangers(sldvexp, installed, tmp_path):
    for folder, key in (("package", "JOB"), ("lab", "LAB")):
        file = tmp_path / f"{folder}/experiment/of_{folder}.yaml"
        file.parent.mkdir(parents=True)
        file.write_text(f"# @package _global_\nhydra: {{job: {{env_set: {{{key}: a}}}}}}\n")
    registry.load_installed()
    registry._packages.append((registry.Package("more", "1", tmp_path / "package"), []))
    done = sldvexp("--config-dir", "lab", "experiment=of_package", "--cfg", "hydra")
    assert "JOB: a" in done.out
    done = sldvexp("--config-dir", "lab", "experiment=of_lab", "--cfg", "hydra")
    assert "hydra.job.env_set is refused" in done.err


FAILS = """
from dataclasses import dataclass
from sldvexp.registry import register
from sldvexp.reconstruction.base import Reconstruction
@register("reconstruction", "{name}")
@dataclass
class Failing(Reconstruction):
    def __post_init__(self):
        {at_once}
    def reconstruct(self, *given, **named):
        {later}
"""


@pytest.mark.one_in(5)
@pytest.mark.parametrize(
    ("at_once", "later", "told"),
    [
        ("1 / 0", "", "ZeroDivisionError: division by zero"),
        ("pass", "1 / 0", "ZeroDivisionError: division by zero"),
        ("pass", "raise SystemExit(3)", "SystemExit: 3"),
        ("pass", r"raise ValueError('two\nlines \x1b[2J')", r"ValueError: two lines \x1b[2J"),
        ("pass", "return None", "AttributeError: 'NoneType' object has no attribute 'to_dataset'"),
    ],
)
def test_failure_of_a_plugin_names_its_package_and_its_place_on_demand(
    sldvexp, installed, tmp_path, monkeypatch, at_once, later, told
):
    name = f"failing_{abs(hash((at_once, later)))}"  # compositions are kept from test to test
    code = FAILS.format(name=name, at_once=at_once, later=later or "pass")
    package(tmp_path / "failing", "stranger", code)
    monkeypatch.syspath_prepend(tmp_path / "failing")
    call = ("experiment=point", f"reconstruction={name}", "report=none")
    done = sldvexp(*call)
    assert done.status == 1
    assert done.err == (
        "sldvexp: a plugin of the package stranger 2.1 failed, or gave what does not fit: "
        f"{told}; with HYDRA_FULL_ERROR=1 in the environment it shows where\n"
    )
    monkeypatch.setenv("HYDRA_FULL_ERROR", "1")
    if "SystemExit" in told:
        assert sldvexp(*call).status == 3
        return
    with pytest.raises((ZeroDivisionError, ValueError, AttributeError)) as raised:
        sldvexp(*call)
    assert any("stranger" in str(e.path) or "base.py" in str(e.path) for e in raised.traceback)
