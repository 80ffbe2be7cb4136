"""Units and headings come from one place."""

from __future__ import annotations

import ast
import math
from pathlib import Path

import pytest

from sldvexp.dataset import DAC, FREQUENCY, VARIABLES, Variable
from sldvexp.dataset.variable import FACTORS

ROOT = Path(__file__).parents[2] / "sldvexp"
READERS = [f for room in ("plot", "report", "check") for f in (ROOT / room).rglob("*.py")]


@pytest.mark.parametrize(
    ("variable", "title", "factor"),
    [
        (VARIABLES["pose"]["residual"], "residual, DAC steps", 1.0),
        (VARIABLES["examined/truth"]["rms_error"], "r.m.s. error, mm/s", 1e3),
        (VARIABLES["examined/pose_methods"]["rotation_error"], "axes by, deg", 180 / math.pi),
        (VARIABLES["examined/truth"]["covered"], "covered", 1.0),
        (FREQUENCY, "frequency, Hz", 1.0),
    ],
)
def test_a_heading_is_a_label_with_the_shown_unit(variable: Variable, title: str, factor: float):
    assert variable.titled() == title
    assert variable.factor == factor


def test_a_shown_unit_is_the_datasets_or_has_a_factor():
    known = {*FACTORS, DAC, "squared DAC steps"}
    for group in VARIABLES.values():
        for variable in group.values():
            assert variable.shown_unit in {variable.units.replace("1", ""), *known, variable.units}


@pytest.mark.parametrize("file", READERS, ids=lambda file: str(file.relative_to(ROOT)))
def test_no_figure_table_or_page_spells_the_units_of_a_reading_or_a_velocity(file: Path):
    tree = ast.parse(file.read_text())
    documented = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Module | ast.FunctionDef | ast.ClassDef)
        and isinstance(node.body[0], ast.Expr)
    }
    texts = [
        node.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
        if id(node) not in documented
    ]
    assert [text for text in texts if DAC in text or "mm/s" in text] == []
