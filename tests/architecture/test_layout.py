"""The layout keeps its promises: imports flow one way, and modules stay readable."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LONGEST = 600


@pytest.mark.whole  # as `lint-imports`, which a change must pass, too
def test_imports_flow_one_way():
    lint = Path(sys.executable).with_name("lint-imports")
    done = subprocess.run([lint], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


def test_no_module_is_too_long():
    modules = (ROOT / "sldvexp").rglob("*.py")
    long = {
        str(m.relative_to(ROOT)): n
        for m in modules
        if (n := len(m.read_text().splitlines())) > LONGEST
    }
    assert long == {}


def test_configurations_name_no_code():
    assert [p for p in (ROOT / "conf").rglob("*.yaml") if "_target_" in p.read_text()] == []


@pytest.mark.whole
def test_plugins_load_nothing_heavy(loaded_by):
    """Composing a configuration imports what it chooses, which must not take a second."""
    code = (
        "import importlib; from sldvexp.config.registry import BUILT_IN\n"
        "for group in BUILT_IN.values(): [importlib.import_module(m) for m in group.values()]\n"
        "print(len(BUILT_IN))"
    )
    libraries, said = loaded_by(code)
    assert int(said) > 10
    assert libraries == ""


@pytest.mark.whole
def test_nothing_optional_is_needed_to_import_a_module(loaded_by):
    """A plain installation has none of the extras; every module must load all the same."""
    code = (
        "import importlib, pkgutil, sys, sldvexp\n"
        "extras = ('dask', 'distributed', 'meshio', 'cholespy', 'cv2', 'numba')\n"
        "for extra in extras: sys.modules[extra] = None\n"
        "found = [m.name for m in pkgutil.walk_packages(sldvexp.__path__, 'sldvexp.')]\n"
        "for name in found: importlib.import_module(name)\n"
        "print(len(found))"
    )
    assert int(loaded_by(code)[1]) > 250
