"""Every function that a room's face names has an example, and the examples are right."""

from __future__ import annotations

import doctest
import importlib
import inspect
import pkgutil

import pytest

import sldvexp

ROOMS = ["sldvexp"] + [
    f"sldvexp.{module.name}" for module in pkgutil.iter_modules(sldvexp.__path__) if module.ispkg
]


def named():
    """Every public name of the rooms, with what it stands for."""
    for room in ROOMS:
        face = importlib.import_module(room)
        for name in getattr(face, "__all__", ()):
            thing = getattr(face, name)
            if getattr(thing, "__module__", "").startswith("sldvexp."):
                yield f"{room}.{name}", thing


NAMED = dict(named())
#: Whose examples take longest, of functions that other tests call as well.
LONG = {
    *("sldvexp.verdict.examine_views", "sldvexp.planner.plan", "sldvexp.planner.next_stand"),
    *("sldvexp.field.estimate_field", "sldvexp.shell.estimate_surface"),
}
EXAMPLES = [
    pytest.param(name, marks=[pytest.mark.whole] * (name in LONG))
    for name, thing in NAMED.items()
    if ">>>" in (inspect.getdoc(thing) or "")
]


def test_rooms_have_faces():
    assert len(NAMED) > 60
    assert NAMED.keys() >= LONG


@pytest.mark.parametrize("name", [n for n, t in NAMED.items() if inspect.isfunction(t)])
def test_functions_have_an_example(name):
    assert ">>>" in (inspect.getdoc(NAMED[name]) or ""), name


@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_are_right(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    thing = NAMED[name]
    flags = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    runner = doctest.DocTestRunner(optionflags=flags)
    names = dict(vars(inspect.getmodule(thing)))
    for test in doctest.DocTestFinder(recurse=False).find(thing, name, globs=names):
        runner.run(test)
    assert runner.failures == 0, capsys.readouterr().out
    assert runner.tries > 0


def test_names_are_documented():
    assert [name for name, thing in NAMED.items() if not inspect.getdoc(thing)] == []


def test_the_page_of_the_package_is_right(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    done = doctest.testmod(sldvexp, optionflags=doctest.ELLIPSIS)
    assert done.failed == 0, capsys.readouterr().out
    assert done.attempted > 10
