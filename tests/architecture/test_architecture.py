"""The package stays as it was designed: what must not be is not, and bounds are kept."""

from __future__ import annotations

import pytest
from measures import (
    OPTIONAL,
    PACKAGE,
    contract,
    modules_of,
    settings,
    upward_imports,
)


@pytest.fixture(scope="module")
def modules():
    return modules_of(PACKAGE)


def test_every_room_has_its_place_in_the_layers():
    layers = contract("one-way")
    assert layers["type"] == "layers"
    assert layers["containers"] == ["sldvexp"]
    assert layers["exhaustive"] is True


def test_imports_that_the_contract_lets_pass_are_for_tests_alone(modules):
    upward = upward_imports(modules, contract("one-way")["layers"])
    assert [name for _, name in upward if not name.startswith("sldvexp.testing.")] == []


def test_what_may_be_imported_inside_functions_comes_with_an_extra():
    project = settings()["project"]
    for library, extra in OPTIONAL.items():
        needed = project["optional-dependencies"][extra]
        assert any(requirement.startswith(library) for requirement in needed), library
        assert not any(requirement.startswith(library) for requirement in project["dependencies"])
