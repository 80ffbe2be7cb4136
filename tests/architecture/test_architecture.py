"""The package stays as it was designed: what must not be is not, and bounds are kept."""

from __future__ import annotations

import pytest
from measures import (
    BROUGHT_BY,
    OPTIONAL,
    PACKAGE,
    begins_empty,
    circles,
    contract,
    docstrings,
    imports_inside_functions,
    is_optional,
    modules_of,
    repeated_class_names,
    settings,
    type_checking_blocks,
    upward_imports,
)

#: Most imports inside functions, most blocks of imports for types, and the largest part of the
#: docstrings that may begin with a word that says nothing.
INSIDE, FOR_TYPES, EMPTY = 15, 5, 0.02


@pytest.fixture(scope="module")
def modules():
    return modules_of(PACKAGE)


def test_every_room_has_its_place_in_the_layers():
    layers = contract("one-way")
    assert layers["type"] == "layers"
    assert layers["containers"] == ["sldvexp"]
    assert layers["exhaustive"] is True


@pytest.mark.whole
def test_imports_that_the_contract_lets_pass_are_for_tests_alone(modules):
    upward = upward_imports(modules, contract("one-way")["layers"])
    assert [name for _, name in upward if not name.startswith("sldvexp.testing.")] == []


def test_what_may_be_imported_inside_functions_comes_with_an_extra():
    project = settings()["project"]
    for library, extra in OPTIONAL.items():
        package = BROUGHT_BY.get(library, library)
        needed = project["optional-dependencies"][extra]
        assert any(requirement.startswith(package) for requirement in needed), library
        assert not any(requirement.startswith(package) for requirement in project["dependencies"])


@pytest.mark.whole
def test_no_modules_import_each_other_in_a_circle(modules):
    assert circles(modules) == []


def test_no_class_name_exists_twice(modules):
    assert repeated_class_names(modules) == {}


def test_only_what_need_not_be_installed_is_imported_inside_functions(modules):
    inside = imports_inside_functions(modules)
    assert [f"{place}: {name}" for place, name in inside if not is_optional(name)] == []
    assert len(inside) <= INSIDE


def test_few_blocks_of_imports_are_for_types_alone(modules):
    assert len(blocks := type_checking_blocks(modules)) <= FOR_TYPES, blocks


def test_docstrings_begin_with_what_is_done_or_what_something_is(modules):
    told = docstrings(modules)
    empty = [text.partition("\n")[0] for text in told if begins_empty(text)]
    assert len(empty) <= EMPTY * len(told), empty
