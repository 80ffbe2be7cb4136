"""Measures of the package see what they are there to see."""

from __future__ import annotations

import measures
import pytest

#: A package with one of everything, three rooms and a module in none.
FILES = {
    "__init__.py": '"""Whether there is one."""\n',
    "errors.py": "class Problem: ...\n",
    "upper/__init__.py": '"""The upper room."""\n',
    "upper/one.py": (
        "from typing import TYPE_CHECKING\n"
        "import numpy\n"
        "if TYPE_CHECKING:\n"
        "    from house.middle import two\n"
        "class Twice:\n"
        '    """What it is."""\n'
    ),
    "middle/__init__.py": "from house.errors import Problem\n",
    "middle/two.py": (
        "def f():\n"
        '    """Open the house."""\n'
        "    from .three import Twice, g\n"
        "    def inner():\n"
        "        import cholespy.core as core\n"
    ),
    "middle/three.py": (
        "from ..upper.one import Twice\nfrom . import Problem, two\nclass Twice: ...\n"
    ),
    "lower/__init__.py": "",
    "lower/four.py": "import house.lower.four\nimport house.middle.three, house.errors\n",
}
LAYERS = ["upper", "middle : (attic)", "lower", "errors"]


@pytest.fixture
def house(tmp_path):
    for name, content in FILES.items():
        file = tmp_path / "house" / name
        file.parent.mkdir(exist_ok=True, parents=True)
        file.write_text(content)
    return measures.modules_of(tmp_path / "house")


def test_modules_are_named_as_they_are_imported(house):
    assert "house" in house
    assert "house.middle" in house
    assert house["house.upper.one"].lines == 6
    assert measures.loose_modules(house) == ["house.errors"]


def test_imports_anywhere_in_a_module_are_found(house):
    assert sorted(measures.imports(house)) == [
        ("house.lower.four", "house.errors"),
        ("house.lower.four", "house.middle.three"),
        ("house.middle", "house.errors"),
        ("house.middle.three", "house.middle"),
        ("house.middle.three", "house.middle.two"),
        ("house.middle.three", "house.upper.one"),
        ("house.middle.two", "house.middle.three"),
        ("house.upper.one", "house.middle.two"),
    ]


def test_modules_that_lead_to_each_other_are_one_circle(house):
    [circle] = measures.circles(house)
    assert sorted(circle) == ["house.middle.three", "house.middle.two", "house.upper.one"]


def test_imports_of_a_room_above_are_found(house):
    assert sorted(measures.upward_imports(house, LAYERS)) == [
        ("house.lower.four", "house.middle.three"),
        ("house.middle.three", "house.upper.one"),
    ]


def test_a_class_name_that_exists_twice_is_found(house):
    assert measures.repeated_class_names(house) == {
        "Twice": ["house.middle.three", "house.upper.one"]
    }


def test_imports_inside_functions_are_counted_once(house, monkeypatch, tmp_path):
    monkeypatch.setattr(measures, "PACKAGE", tmp_path / "house")
    assert measures.imports_inside_functions(house) == [
        ("house/middle/two.py:3", "house.middle.three.Twice"),
        ("house/middle/two.py:5", "cholespy.core"),
    ]
    assert measures.is_optional("cholespy.core")
    assert not measures.is_optional("house.middle")


def test_blocks_of_imports_for_types_are_counted(house):
    assert measures.type_checking_blocks(house) == ["house.upper.one"]


def test_beginnings_of_docstrings_are_counted(house):
    told = measures.docstrings(house)
    assert sorted(told) == [
        "Open the house.",
        "The upper room.",
        "What it is.",
        "Whether there is one.",
    ]
    assert sum(map(measures.begins_empty, told)) == 3
    assert not measures.begins_empty("Theory of plates.")


@pytest.mark.whole
def test_files_behind_a_sentence_about_a_misspelt_key_are_counted():
    found = measures.loaded_for_a_mistake()
    assert "sldvexp.cli.main" in found
    assert "sldvexp.pose.registration" in found
    assert "sldvexp.pipeline.runner" not in found
    assert len(found) == len(set(found))
